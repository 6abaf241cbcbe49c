"""Stages the documentation for mdBook: pages of the repository's top folder and of docs/, and a reference that the program writes.

    python3 docs/site.py REPOSITORY PROGRAM OUT

OUT gets book.toml and src/. Links that leave the site become text: the sources are not in it. A page of docs/ that the summary does not
name is an error, since mdBook would leave it out.
"""

import os
import re
import shutil
import subprocess
import sys

# Pages of the top folder that the site has too.
TOP = ["README.md", "ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md", "THIRD_PARTY.md"]
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^()\s]+)\)")


def rewrite_links(text, page, staged):
    """The text of a page, `page` being its place in the repository, with links as the site has them."""

    def link(match):
        picture, label, target = match.groups()
        path, mark, anchor = target.partition("#")
        if ":" in target or not path:
            return match.group(0)
        place = os.path.normpath(os.path.join(os.path.dirname(page), path))
        if place.rstrip("/") in ("docs/methods", "docs/tasks"):
            place += "/README.md"
        there = place.removeprefix("docs/") if place.startswith("docs/") or place in TOP else None
        if there is None or there not in staged:
            return label
        # A folder's README becomes its index.html.
        there = re.sub(r"README\.md$", "index.md", there)
        here = os.path.dirname(page.removeprefix("docs/"))
        return f"{picture}[{label}]({os.path.relpath(there, here or '.')}{mark}{anchor})"

    # What stands in code is no link.
    parts = re.split(r"(^```.*?^```[^\n]*$)", text, flags=re.MULTILINE | re.DOTALL)
    return "".join(part if part.startswith("```") else LINK.sub(link, part) for part in parts)


def main(repository, program, out):
    docs = os.path.join(repository, "docs")
    src = os.path.join(out, "src")
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(docs, src, ignore=shutil.ignore_patterns("site.*"))
    shutil.move(os.path.join(src, "book.toml"), os.path.join(out, "book.toml"))
    for name in TOP:
        shutil.copy(os.path.join(repository, name), src)
    subprocess.run([program, "reference", os.path.join(src, "reference")], check=True)
    staged = {os.path.relpath(os.path.join(folder, name), src) for folder, _, names in os.walk(src) for name in names}

    summary = open(os.path.join(src, "SUMMARY.md"), encoding="utf-8").read()
    named = {target for _, _, target in LINK.findall(summary)}
    pages = {name for name in staged if name.endswith(".md") and name != "SUMMARY.md"}
    if named != pages:
        sys.exit(f"docs/SUMMARY.md names pages that are not there: {sorted(named - pages)}; "
                 f"it does not name: {sorted(pages - named)}")
    for name in sorted(pages):
        path = os.path.join(src, name)
        page = name if name in TOP else f"docs/{name}"
        with open(path, encoding="utf-8") as file:
            text = file.read()
        os.remove(path)
        with open(re.sub(r"README\.md$", "index.md", path), "w", encoding="utf-8") as file:
            file.write(rewrite_links(text, page, staged))
    with open(os.path.join(src, "SUMMARY.md"), "w", encoding="utf-8") as file:
        file.write(summary.replace("README.md)", "index.md)"))
    print(f"{len(pages)} pages are in {src}", file=sys.stderr)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
