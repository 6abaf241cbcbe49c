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

BLOCK = re.compile(r"^<!-- run -->\n+```\w*\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def main(proact, documents):
    count = 0
    for document in documents:
        with open(document, encoding="utf-8") as file:
            blocks = BLOCK.findall(file.read())
        with tempfile.TemporaryDirectory() as place:
            os.symlink(os.path.abspath(proact), os.path.join(place, "proact"))
            environment = {**os.environ, "PATH": place + ":" + os.environ["PATH"]}
            for block in blocks:
                start = time.monotonic()
                done = subprocess.run(["bash", "-euo", "pipefail", "-c", block], cwd=place, env=environment, stdin=subprocess.DEVNULL,
                                      capture_output=True, text=True)
                if done.returncode:
                    sys.exit(f"FAILED: {document}: exit code {done.returncode} of\n{block}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}")
                count += 1
                print(f"ok  {os.path.basename(document)}: {block.splitlines()[0]} ({time.monotonic() - start:.1f} s)")
    if not count:
        sys.exit("FAILED: no block is marked")
    print(f"{count} passed, 0 failed")


main(sys.argv[1], sys.argv[2:])
