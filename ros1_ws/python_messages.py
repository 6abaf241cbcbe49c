#!/usr/bin/env python3
"""Makes Python classes of this workspace's message packages without catkin, by the genpy of Debian or of /opt/ros.

    ros1_ws/python_messages.py SRC OUT

SRC is ros1_ws/src. OUT/share gets the packages, with the messages of their actions; OUT/lib gets their Python modules.
"""

import glob
import os
import shutil
import subprocess
import sys


def ros_prefixes():
    """Where ROS may be installed, best first."""
    listed = [prefix for prefix in os.environ.get("CMAKE_PREFIX_PATH", "").split(":") if prefix]
    return [*listed, *sorted(glob.glob("/opt/ros/*")), "/usr"]


def find_tool(path):
    """A program of ROS under the first prefix that has it."""
    for prefix in ros_prefixes():
        if os.path.exists(found := os.path.join(prefix, path)):
            return found
    sys.exit(f"python_messages.py: {path} is in none of {', '.join(ros_prefixes())}; on Debian: "
             "apt-get install python3-genpy libactionlib-msgs-dev")


def run(script, *words):
    modules = [os.path.join(prefix, "lib/python3/dist-packages") for prefix in ros_prefixes() if prefix != "/usr"]
    path = ":".join([*modules, os.environ.get("PYTHONPATH", "")])
    subprocess.run([sys.executable, script, *words], check=True, stdout=subprocess.DEVNULL,
                   env=dict(os.environ, PYTHONPATH=path))


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    src, out = sys.argv[1:]
    folders = {}
    listed = [folder for folder in os.environ.get("ROSRUST_MSG_PATH", "").split(":") if folder]
    for share in [*listed, *(os.path.join(prefix, "share") for prefix in ros_prefixes())]:
        for folder in glob.glob(os.path.join(share, "*_msgs", "msg")):
            folders.setdefault(os.path.basename(os.path.dirname(folder)), folder)

    packages = [os.path.join(src, "proact_msgs"), *sorted(glob.glob(os.path.join(src, "compat", "*")))]
    for package in packages:
        name = os.path.basename(package)
        staged = os.path.join(out, "share", name)
        shutil.copytree(package, staged, ignore=shutil.ignore_patterns("CMakeLists.txt"))
        messages = os.path.join(staged, "msg")
        for action in sorted(glob.glob(os.path.join(staged, "action", "*.action"))):
            os.makedirs(messages, exist_ok=True)
            run(find_tool("lib/actionlib_msgs/genaction.py"), action, "-o", messages)
        folders[name] = messages

    includes = [f"-I{name}:{folder}" for name, folder in folders.items()]
    for package in packages:
        name = os.path.basename(package)
        for kind in ("msg", "srv"):
            files = sorted(glob.glob(os.path.join(out, "share", name, kind, f"*.{kind}")))
            if not files:
                continue
            target = os.path.join(out, "lib", name, kind)
            os.makedirs(target)
            open(os.path.join(out, "lib", name, "__init__.py"), "a").close()
            run(find_tool(f"lib/genpy/gen{kind}_py.py"), *files, *includes, "-p", name, "-o", target)
            with open(os.path.join(target, "__init__.py"), "w") as init:
                init.writelines(f"from ._{os.path.basename(file).rsplit('.', 1)[0]} import *\n" for file in files)


main()
