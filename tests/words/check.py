#!/usr/bin/python3
"""Checks names and prose against the vocabulary of the project: `./proact test words`.

    tests/words/check.py [--list]

The rules are in words.toml beside this file. Exit code 0 only if no file breaks one. Files whose prose is not done yet stand
in prose_to_do.txt, which may only get shorter; `--list` prints them.
"""

import argparse
import os
import pathlib
import re
import subprocess
import sys
import tomllib

HERE = pathlib.Path(__file__).resolve().parent
CODE = {".rs", ".cpp", ".hpp", ".ts", ".mjs", ".py", ".sh"}
TEXT = {".md", ".html"}
PAGE = "rust/bridge/web/src/"

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--root", type=pathlib.Path, default=HERE.parents[1], help="the repository (default: this one)")
parser.add_argument("--list", action="store_true", help="print the files whose prose breaks a rule")
options = parser.parse_args()
root = options.root.resolve()
rules = tomllib.loads((HERE / "words.toml").read_text())

# Comments, strings and code of each language, in one pass.
STRINGS = r'"(?:\\.|[^"\\])*"'
TOKENS = {
    ".rs": re.compile(r'(?P<comment>//[^\n]*|/\*.*?\*/)|(?P<string>b?r(?P<hash>#*)".*?"(?P=hash)|b?%s|b?\'(?:\\.[^\']*|[^\'\\])\')' % STRINGS, re.S),
    ".ts": re.compile(r'(?P<comment>//[^\n]*|/\*.*?\*/)|(?P<string>%s|\'(?:\\.|[^\'\\\n])*\'|`(?:\\.|[^`\\])*`)' % STRINGS, re.S),
    ".py": re.compile(r'(?P<comment>\#[^\n]*|""".*?""")|(?P<string>%s|\'(?:\\.|[^\'\\\n])*\')' % r'"(?:\\.|[^"\\\n])*"', re.S),
    ".sh": re.compile(r'(?P<comment>(?:(?<=\s)|^)\#[^\n]*)|(?P<string>%s|\'[^\']*\')' % STRINGS, re.S | re.M),
}
TOKENS[".cpp"] = TOKENS[".hpp"] = TOKENS[".mjs"] = TOKENS[".ts"]


SENTENCE = re.compile(r"\b(?:fn|def|test) +[a-z0-9]+(?:_[a-z0-9]+){4,}")


def blank(text):
    """Spaces in place of a text, so that line numbers stay."""
    return re.sub(r"[^\n]", " ", text)


def parts(path, text):
    """A file's identifiers, prose and strings, each as a text of the same lines."""
    if path.suffix not in CODE:
        return {"prose": text}
    code, comments, strings, end = [], [], [], 0
    for match in TOKENS[path.suffix].finditer(text):
        between, token = text[end:match.start()], match[0]
        is_comment = match.group("comment") is not None
        code += [between, blank(token)]
        comments += [blank(between), token if is_comment else blank(token)]
        strings += [blank(between), blank(token) if is_comment else token]
        end = match.end()
    code.append(text[end:])
    # The name of a test is a sentence, so it is prose. Product code comes before the tests of a Rust file.
    code = "".join(code)
    product = 0 if path.suffix != ".rs" or "test" in str(path) else re.search(r"#\[cfg\(test\)\]|#\[test\]|$(?![\s\S])", code).start()
    code = code[:product] + SENTENCE.sub(lambda match: blank(match[0]), code[product:])
    return {"identifier": code, "prose": "".join(comments), "string": "".join(strings)}


def line_of(text, at):
    return text.count("\n", 0, at) + 1


present = subprocess.run(["git", "-C", root, "ls-files", "--cached", "--others", "--exclude-standard", "-z"], capture_output=True, check=True).stdout.decode()
names = [name for name in present.split("\0") if name and (root / name).is_file()]
skipped = [re.compile(pattern) for pattern in rules["skip"]]
names = [name for name in names if not any(pattern.search(name) for pattern in skipped)]

PLACES = {"identifier", "file", "prose", "page"}
for rule in rules["rule"]:
    unknown = rule.keys() - {"words", "in", "use", "files", "except"}
    if unknown or not PLACES.issuperset(rule["in"]):
        sys.exit(f"words.toml: a rule has {sorted(unknown) or rule['in']}, expected words, in = {sorted(PLACES)}, use, files, except")


def patterns(place):
    """Each rule of a place: the pattern of its words, what to use, exempt files, pattern of the files that it is for. A word of an
    identifier stands between underscores or capitals."""
    found = []
    for rule in rules["rule"]:
        if place not in rule["in"]:
            continue
        words = "|".join(rule["words"])
        if place in ("identifier", "file"):
            capitals = "|".join("".join(part.title() for part in word.split("_")) for word in rule["words"])
            upper = words.upper()
            pattern = re.compile(rf"(?<![a-z])(?:{words})(?![a-z])|(?<![A-Z])(?:{capitals})(?![a-z])|(?<![A-Z])(?:{upper})(?![A-Z])")
        else:
            pattern = re.compile(rf"\b(?:{words})\b", re.I)
        exempt = {entry["file"] for entry in rule.get("except", []) if entry["reason"]}
        found.append((pattern, rule["use"], exempt, re.compile(rule.get("files", ""))))
    return found


IDENTIFIER, FILE, PROSE, PAGE_STRINGS = (patterns(place) for place in ("identifier", "file", "prose", "page"))
faults, prose_faults = [], {}


def read_list(text):
    return [line for line in text.splitlines() if line and not line.startswith("#")]


types = {}
PUBLIC = re.compile(r"^\s*pub(?:\([^)]*\))? (?:struct|enum|trait|type|union) (\w+)", re.M)


def look(found, name, place, text, rules_of_place):
    for pattern, use, exempt, files in rules_of_place:
        if name in exempt or not files.search(name):
            continue
        for match in pattern.finditer(text):
            found.append(f"{name}:{line_of(text, match.start())}: {place} \"{match[0]}\": use {use}")


for name in names:
    path = root / name
    stem = name.rsplit(".", 1)[0]
    for pattern, use, exempt, files in FILE:
        match = pattern.search(stem)
        if match and name not in exempt and files.search(name):
            faults.append(f"{name}:1: file name \"{match[0]}\": use {use}")
    if re.match(r"rust/[^/]+/src/(?:.*_test|(?:.*/)?test_[^/]*)\.rs$", name):
        faults.append(f"{name}:1: file name: a product file is named like a test: use another name")
    if path.suffix not in CODE | TEXT:
        continue
    pieces = parts(pathlib.Path(name), path.read_text(encoding="utf-8"))
    if "identifier" in pieces:
        look(faults, name, "identifier", pieces["identifier"], IDENTIFIER)
    if name.startswith(PAGE) and "string" in pieces:
        look(prose_faults.setdefault(name, []), name, "page text", pieces["string"], PAGE_STRINGS)
    look(prose_faults.setdefault(name, []), name, "prose", pieces["prose"], PROSE)
    crate = re.match(r"rust/([^/]+)/src/", name)
    if crate and path.suffix == ".rs":
        for match in PUBLIC.finditer(pieces["identifier"]):
            place = f"{name}:{line_of(pieces['identifier'], match.start(1))}"
            types.setdefault(match[1], {}).setdefault(crate[1], place)

# One public name, one thing.
allowed = {entry["name"] for entry in rules["twice"] if entry["reason"]}
if len(allowed) > 2:
    faults.append("tests/words/words.toml:1: more than two names are allowed twice")
for word, crates in sorted(types.items()):
    if len(crates) > 1 and word not in allowed:
        places = list(crates.values())
        faults.append(f"{places[0]}: type \"{word}\" is also in {', '.join(places[1:])}: use a name of its own for each")

# Prose that is not done yet. The list only gets shorter.
if options.list:
    print("\n".join(sorted(name for name, found in prose_faults.items() if found)))
    sys.exit(0)
base = os.environ.get("PROACT_BASE") or "HEAD~1"
path = "tests/words/prose_to_do.txt"
to_do = read_list((root / path).read_text())
for name, found in sorted(prose_faults.items()):
    if found and name not in to_do:
        faults += found
faults += [f"{path}: {name} breaks no rule any more: take it out" for name in to_do if not prose_faults.get(name)]
before = subprocess.run(["git", "-C", root, "show", f"{base}:{path}"], capture_output=True, text=True)
if before.returncode == 0:
    for name in sorted(set(to_do) - set(read_list(before.stdout))):
        # A file that was renamed keeps its place.
        if subprocess.run(["git", "-C", root, "cat-file", "-e", f"{base}:{name}"], capture_output=True).returncode == 0:
            faults.append(f"{path}: {name} is new in the list: correct the file instead")

# Spelling, in American English for identifiers by the rules above; here any misspelling of prose.
try:
    spelling = subprocess.run(
        ["codespell", "--ignore-words", HERE / "spelling.txt", *[n for n in names if pathlib.Path(n).suffix in CODE | TEXT]],
        cwd=root, capture_output=True, text=True)
    faults += [f"{line.removeprefix('./')} (spelling)" for line in spelling.stdout.splitlines()]
except FileNotFoundError:
    print("codespell is not on this machine: spelling is not checked", file=sys.stderr)

for fault in faults:
    print(f"FAILED {fault}")
print(f"{len(names)} files, {len(faults)} faults; prose to do: {len(to_do)} files")
sys.exit(bool(faults))
