"""Turns a Dockerfile into a script for a bare root: the same commands, in the same order.

Knows FROM, ENV, SHELL, WORKDIR, COPY . ., RUN, ENTRYPOINT and CMD; anything else is an error. The environment and the
entry point are left in /environment for whoever runs the image.
"""

import json
import shlex
import sys


def instructions(path):
    """Instructions with their continued lines joined and comments left out."""
    joined = ""
    for line in open(path):
        if line.lstrip().startswith("#") or (not joined and not line.strip()):
            continue
        joined += line.rstrip("\n")
        if joined.endswith("\\"):
            joined = joined[:-1] + " "
        else:
            yield joined.strip().split(None, 1)
            joined = ""


def main(path):
    print("set -eu")
    kept = []
    for word, rest in instructions(path):
        if word == "FROM":
            assert rest == "debian:12", f"FROM {rest}: expected debian:12"
        elif word == "ENV":
            for pair in shlex.split(rest):
                kept.append(f"export {pair}")
                print(f"export {pair}")
        elif word == "SHELL":
            assert json.loads(rest) == ["/bin/bash", "-o", "pipefail", "-c"], rest
        elif word == "WORKDIR":
            print(f"mkdir -p {rest} && cd {rest}")
        elif word == "COPY":
            assert rest == ". .", f"COPY {rest}: expected . ."
            print("cp -a /context/. .")
        elif word == "RUN":
            # A shell for each, as Docker has it; it starts where the one before was told to be.
            print("echo '+ RUN' " + shlex.quote(rest[:60]))
            print("/bin/bash -o pipefail -c " + shlex.quote(rest))
        elif word == "ENTRYPOINT":
            kept.append("entry_point=" + json.loads(rest)[0])
        elif word == "CMD":
            json.loads(rest)
        else:
            sys.exit(f"{path}: no rule for {word}")
    print("cat >/environment <<'END'\n" + "\n".join(kept) + "\nEND")


main(sys.argv[1])
