"""Runs the claims of the documents and compares the figures that come out with those on the page.

    claims.py PROACT [--long] [--update] DOCUMENT...

--long also runs claims that are marked long; --update writes the measured figures into the page. CONTRIBUTING.md has the syntax of a claim.
The claims of a page run one after the other in one folder, which has `proact`, `docs` and `tests`. Recordings are looked for in data/emg of the
folder that PROACT_SHARED names, or of ../shared beside the repository; a claim that needs them finds them in $RECORDINGS.
"""

import argparse
import csv
import json
import os
import re
import statistics
import sys
import tempfile
import time

from documents import FENCE, REPOSITORY, run_script

CLAIM = re.compile(r"^<!-- claim\b([^\n]*)\n(.*?)^-->$", re.MULTILINE | re.DOTALL)
CLAIM_OPTIONS = {"long", "recordings", "block"}
DEFINITION = re.compile(r"^(\w+)(?:\((\w+(?:, \w+)*)\))? = (.+)$")
PLACEHOLDER = re.compile(r"\{(~?[^{}]+)\}")
ANYTHING = r"(?:(?!\n\n).)*?"
NUMBER_WORDS = ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
NUMBER = r"([-+]?\d+(?:,\d{3})*(?:\.\d+)?(?:e-?\d+)?|(?i:" + "|".join(rf"\b{word}\b" for word in [*NUMBER_WORDS, "none"]) + "))"
# A script that takes longer hangs, s.
SCRIPT_LIMIT = 3600


class ClaimError(Exception):
    """A claim that cannot be compared, with the reason."""


class Record(dict):
    """A JSON object whose keys are attributes, so that a claim can say `d.outcomes[0].block`."""

    def __getattr__(self, name):
        if name not in self:
            raise ClaimError(f"no key {name!r}, expected one of: {', '.join(self)}")
        return self[name]


class Table:
    """Rows of a CSV file. A statistic of a column leaves empty cells out."""

    STATISTICS = {"mean": statistics.mean, "median": statistics.median, "sd": statistics.stdev, "sum": sum, "min": min, "max": max, "count": len}

    def __init__(self, rows):
        self.rows = rows

    def where(self, **values):
        for key in values:
            self.check_column(key)
        return Table([row for row in self.rows if all(row[key] == str(value) for key, value in values.items())])

    def check_column(self, name):
        if self.rows and name not in self.rows[0]:
            raise ClaimError(f"no column {name!r}, expected one of: {', '.join(self.rows[0])}")

    def column(self, name):
        self.check_column(name)
        return [float(row[name]) for row in self.rows if row[name] != ""]

    def __len__(self):
        return len(self.rows)

    def __getattr__(self, statistic):
        if statistic not in self.STATISTICS:
            raise AttributeError(statistic)
        return lambda name: self.STATISTICS[statistic](self.column(name))


class ClaimNamespace(dict):
    """What expressions of a page may use: functions, the claim's definitions, and NAME for what NAME.json of the page's folder holds."""

    def __init__(self, place):
        functions = {function.__name__: function for function in (len, min, max, sum, abs, range, round, sorted)}
        super().__init__(functions, __builtins__={}, table=self.table, lines=self.lines, mean=statistics.mean, median=statistics.median)
        self.place = place

    def table(self, path, **where):
        with open(os.path.join(self.place, path), encoding="utf-8", newline="") as file:
            return Table(list(csv.DictReader(file))).where(**where)

    def lines(self, path):
        with open(os.path.join(self.place, path), encoding="utf-8") as file:
            return [json.loads(line, object_hook=Record) for line in file]

    def read_json(self, expression):
        """Names of JSON files that the expression mentions become known."""
        for name in re.findall(r"(?<![.\w'\"])[a-zA-Z_]\w*", expression):
            path = os.path.join(self.place, name + ".json")
            if name not in self and os.path.exists(path):
                with open(path, encoding="utf-8") as file:
                    self[name] = json.load(file, object_hook=Record)

    def define(self, name, parameters, expression):
        self[name] = self.value(f"lambda {parameters}: {expression}" if parameters else expression)

    def value(self, expression):
        self.read_json(expression)
        try:
            # Text of this repository, as the commands beside it are.
            return eval(expression, self)
        except Exception as error:
            raise ClaimError(f"{expression!r} has no value: {type(error).__name__}: {error}") from None


def as_printed(value, page):
    """The value as the page writes this figure: as a word, or with as many digits and separators."""
    if isinstance(value, str):
        return value
    if page.lower() in NUMBER_WORDS or page.lower() == "none":
        word = NUMBER_WORDS[int(value)] if value in range(1, len(NUMBER_WORDS)) else "none" if value == 0 else str(value)
        if value == 0 and page.lower() in ("no", "none"):
            return page
        return word.capitalize() if page[0].isupper() else word
    digits = len(page.partition("e")[0].partition(".")[2])
    if "e" in page:
        mantissa, exponent = f"{value:.{digits}e}".split("e")
        return f"{mantissa}e{int(exponent)}"
    text = f"{value:{'+' if page[0] == '+' else ''}{',' if ',' in page else ''}.{digits}f}"
    return text.lstrip("-") if float(text.replace(",", "")) == 0 else text


class Figures:
    """A line of a claim: text of the page with measured values in it."""

    def __init__(self, line, names):
        self.line, self.values, self.times = line, [], []
        parts = PLACEHOLDER.split(line)
        words = parts[0::2]
        if not re.search(r"[^\W\d_]", " ".join(words)):
            raise ClaimError(f"the line {line!r} has no words of the page, so that its figures could be anywhere")
        pattern = literal(parts[0])
        for expression, text in zip(parts[1::2], parts[2::2]):
            if expression == "...":
                pattern += ANYTHING + literal(text)
                continue
            value = names.value(expression.removeprefix("~"))
            if isinstance(value, bool) or not isinstance(value, (int, float, str)):
                raise ClaimError(f"{expression!r} is {value!r}, expected a number or a text")
            self.values.append(value)
            self.times.append(expression.startswith("~"))
            pattern += (r"(\w[\w-]*)" if isinstance(value, str) else NUMBER) + literal(text)
        if not self.values:
            raise ClaimError(f"the line {line!r} has no figure in braces")
        # A figure at an end of the line is not a part of a longer one.
        self.pattern = re.compile(r"(?<![\w.-])" + pattern + r"(?![\d]|\.\d|,\d{3})", re.DOTALL)


def literal(text):
    """A pattern of some text of the page, wherever its lines break."""
    return r"\s+".join(re.escape(word) for word in re.split(r"\s+", text))


class Page:
    """A document, and what became of its claims."""

    def __init__(self, path, counts):
        self.path, self.counts = path, counts
        with open(path, encoding="utf-8") as file:
            self.text = file.read()
        # Where wrong figures begin and end, and what was measured.
        self.changes = []

    def claims(self):
        """Each claim with the end of the text that it speaks of, which is the next claim."""
        found = list(CLAIM.finditer(self.text))
        broken = len(re.findall(r"<!--\s*claim\b", self.text)) - len(found)
        if broken:
            raise ClaimError(f"{broken} claims are not a line '<!-- claim', lines, and a line '-->'")
        return list(zip(found, [claim.start() for claim in found[1:]] + [len(self.text)]))

    def check(self, claim, end, place, options):
        marks = set(claim[1].split())
        if marks - CLAIM_OPTIONS:
            raise ClaimError(f"unknown marks {sorted(marks - CLAIM_OPTIONS)}, expected some of {sorted(CLAIM_OPTIONS)}")
        lines = [line for line in claim[2].splitlines() if line.strip()]
        if all(line.startswith("$ ") or DEFINITION.match(line) for line in lines):
            raise ClaimError("no figure is compared; expected a line of the page's text with {EXPRESSION} in the place of each figure")
        if "long" in marks and not options.long:
            return "skipped", "takes long; the lane claims_long runs it"
        if "recordings" in marks and not os.path.isdir(options.recordings):
            return "skipped", f"no recordings in {options.recordings}; PROACT_SHARED names another folder around data/emg"
        script, scope = "", claim.end()
        if "block" in marks:
            block = FENCE.search(self.text, scope, end)
            if not block:
                raise ClaimError("is marked block, and no block of commands follows")
            script, scope = block[1], block.end()
        script += "".join(line[2:] + "\n" for line in lines if line.startswith("$ "))
        failure = run_script(script, place, {"RECORDINGS": options.recordings}, SCRIPT_LIMIT)
        if failure:
            raise ClaimError(failure)
        names, wrong = ClaimNamespace(place), 0
        for line in lines:
            definition = DEFINITION.match(line)
            if definition:
                names.define(*definition.groups())
            elif not line.startswith("$ "):
                figures = Figures(line, names)
                found = figures.pattern.search(self.text, scope, end)
                if not found:
                    measured = ", ".join(map(str, figures.values))
                    raise ClaimError(f"the page lacks the text {line!r} between this claim, or its line before, and the next claim; measured: {measured}")
                scope = found.end()
                wrong += self.compare(figures, found)
        return ("failed", f"{wrong} figures are wrong") if wrong else ("passed", "")

    def compare(self, figures, found):
        wrong, shown = 0, []
        for index, (value, is_time) in enumerate(zip(figures.values, figures.times), 1):
            page, measured = found[index], as_printed(value, found[index])
            if is_time:
                self.counts["times printed"] += 1
                shown.append(f"{page} (now {measured})")
            elif page == measured:
                self.counts["figures compared"] += 1
                shown.append(page)
            else:
                self.counts["figures compared"] += 1
                wrong += 1
                self.changes.append((*found.span(index), measured))
                shown.append(f"{page} (WRONG: measured {measured}, {value!r})")
        rest = iter(shown)
        print("      " + PLACEHOLDER.sub(lambda placeholder: "..." if placeholder[1] == "..." else next(rest), figures.line))
        return wrong

    def run(self, options):
        name = os.path.relpath(self.path)
        try:
            claims = self.claims()
        except ClaimError as error:
            self.counts["failed"] += 1
            print(f"FAILED   {name}: {error}")
            return
        with tempfile.TemporaryDirectory() as place:
            os.symlink(os.path.abspath(options.proact), os.path.join(place, "proact"))
            for folder in ("docs", "tests"):
                os.symlink(os.path.join(REPOSITORY, folder), os.path.join(place, folder))
            for claim, end in claims:
                start, line = time.monotonic(), self.text.count("\n", 0, claim.start()) + 1
                try:
                    outcome, reason = self.check(claim, end, place, options)
                except ClaimError as error:
                    outcome, reason = "failed", str(error)
                self.counts[outcome] += 1
                word = {"passed": "ok", "failed": "FAILED"}.get(outcome, outcome)
                print(f"{word:<8} {name}:{line} {reason or 'as on the page'} ({time.monotonic() - start:.1f} s)", flush=True)

    def update(self):
        for start, end, measured in sorted(self.changes, reverse=True):
            self.text = self.text[:start] + measured + self.text[end:]
        with open(self.path, "w", encoding="utf-8") as file:
            file.write(self.text)
        print(f"{os.path.relpath(self.path)}: {len(self.changes)} figures written")


def main(words):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("proact")
    parser.add_argument("documents", nargs="+")
    parser.add_argument("--long", action="store_true")
    parser.add_argument("--update", action="store_true")
    options = parser.parse_args(words)
    options.recordings = os.path.join(os.environ.get("PROACT_SHARED") or os.path.join(REPOSITORY, "../shared"), "data/emg")
    counts = dict.fromkeys(("passed", "failed", "skipped", "figures compared", "times printed"), 0)
    for path in options.documents:
        page = Page(path, counts)
        page.run(options)
        if options.update and page.changes:
            page.update()
    print(", ".join(f"{count} {what}" for what, count in counts.items()))
    if counts["passed"] + counts["failed"] + counts["skipped"] == 0:
        print("FAILED: no claim is marked")
    if counts["failed"] or not counts["passed"] + counts["skipped"]:
        return 1
    return 0 if counts["passed"] else 77


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
