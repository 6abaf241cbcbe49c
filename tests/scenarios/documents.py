"""Runs the code blocks of the documents that a line `<!-- run -->` before them marks, one after the other in an empty folder.

    documents.py PROACT DOCUMENT...

A block is a script of bash that ends with its first failing command. `proact` and `./proact` are the program.
"""

import os
import re
import subprocess
import sys
import tempfile
import time

REPOSITORY = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
FENCE = re.compile(r"^```\w*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r"^<!-- run -->\n+" + FENCE.pattern.removeprefix("^"), re.MULTILINE | re.DOTALL)


def run_script(script, place, variables=None, timeout=None):
    """Runs a script of bash in the folder `place`, where the program lies as `proact`. Returns why it failed, None if it did not."""
    environment = {**os.environ, "PATH": place + ":" + os.environ["PATH"], **(variables or {})}
    try:
        done = subprocess.run(["bash", "-euo", "pipefail", "-c", script], cwd=place, env=environment, stdin=subprocess.DEVNULL,
                              capture_output=True, text=True, timeout=timeout)
    except subprocess.TimeoutExpired:
        return f"no end after {timeout} s of\n{script}"
    return f"exit code {done.returncode} of\n{script}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}" if done.returncode else None


def main(proact, documents):
    count = 0
    for document in documents:
        with open(document, encoding="utf-8") as file:
            blocks = BLOCK.findall(file.read())
        with tempfile.TemporaryDirectory() as place:
            os.symlink(os.path.abspath(proact), os.path.join(place, "proact"))
            for block in blocks:
                start = time.monotonic()
                failure = run_script(block, place)
                if failure:
                    sys.exit(f"FAILED: {document}: {failure}")
                count += 1
                print(f"ok  {os.path.basename(document)}: {block.splitlines()[0]} ({time.monotonic() - start:.1f} s)")
    if not count:
        sys.exit("FAILED: no block is marked")
    print(f"{count} passed, 0 failed")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
