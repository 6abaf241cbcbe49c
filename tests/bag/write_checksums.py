#!/usr/bin/python3
"""Writes ROS's checksum of each type in rust/messages/src/messages.txt to rust/messages/src/checksums.txt.

Run it with Debian's Python where ROS's message packages are installed; it uses genmsg, and reads the definitions of the
installed packages and of the workspace here.
"""

import pathlib

import genmsg
import genmsg.gentools
import genmsg.msg_loader

ROOT = pathlib.Path(__file__).resolve().parents[2]
SOURCES = ROOT / "rust/messages/src"
PACKAGE_FOLDERS = [pathlib.Path("/usr/share"), ROOT / "ros1_ws/src", ROOT / "ros1_ws/src/compat"]
# Of a package that Debian splits so that its messages need all of it.
EXTRA = {"tf/tfMessage": "geometry_msgs/TransformStamped[] transforms\n"}


def main():
    paths = {}
    for place in PACKAGE_FOLDERS:
        for folder in place.glob("*/msg"):
            paths.setdefault(folder.parent.name, []).append(str(folder))
    context = genmsg.MsgContext.create_default()
    lines = []
    for line in (SOURCES / "messages.txt").read_text().splitlines():
        if line.startswith("#"):
            continue
        name = line.split(":")[0]
        if name in EXTRA:
            spec = genmsg.msg_loader.load_msg_from_string(context, EXTRA[name], name)
        else:
            spec = genmsg.msg_loader.load_msg_by_type(context, name, paths)
        genmsg.msg_loader.load_depends(context, spec, paths)
        lines.append(f"{name} {genmsg.gentools.compute_md5(context, spec)}\n")
    (SOURCES / "checksums.txt").write_text("".join(lines))


main()
