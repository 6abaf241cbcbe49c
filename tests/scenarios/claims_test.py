"""Pages with right and wrong claims before the checker of claims: python3 tests/scenarios/claims_test.py. Needs no program."""

import contextlib
import io
import os
import tempfile
import unittest

import claims

RIGHT = """# Page

<!-- claim
$ echo '{"score": 3, "share": 0.98349, "loss": 0.0671, "seconds": 80.2, "who": "on_target", "runs": [1, 2]}' > trial.json
$ printf 'method,blocks\\nA,2\\nA,3\\nB,\\n' > blocks.csv
of(m) = table("blocks.csv", method=m)
brings {trial.score} blocks of four, {100 * trial.share} % of windows
took {~trial.seconds} s
| A | {of("A").mean("blocks")} | {...} | {len(trial.runs)} |
and none with B ({of("B").count("blocks")}), {trial.who}
-->

The person brings three blocks
of four, 98.3 % of windows, and took 79 s.

| method | blocks | note | runs |
|---|---|---|---|
| A | 2.50 | of 1,000 | 2 |

With A some, and none with B (0), on_target. Log loss is 0.067.
"""


class Claims(unittest.TestCase):
    def check(self, text, *words, recordings=None):
        """Exit code and output of the checker on one page, and the page afterwards."""
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "page.md")
            with open(path, "w", encoding="utf-8") as file:
                file.write(text)
            output = io.StringIO()
            before = os.environ.get("PROACT_SHARED")
            os.environ["PROACT_SHARED"] = recordings or folder
            with contextlib.redirect_stdout(output):
                code = claims.main(["/bin/true", path, *words])
            if before is None:
                del os.environ["PROACT_SHARED"]
            else:
                os.environ["PROACT_SHARED"] = before
            with open(path, encoding="utf-8") as file:
                return code, output.getvalue(), file.read()

    def assert_refused(self, text, *expected):
        code, output, _ = self.check(text)
        self.assertEqual(code, 1, output)
        for words in expected:
            self.assertIn(words, output)

    def test_a_page_whose_figures_are_measured_again_passes(self):
        code, output, _ = self.check(RIGHT)
        self.assertEqual(code, 0, output)
        self.assertIn("1 passed, 0 failed, 0 skipped, 6 figures compared, 1 times printed", output)

    def test_a_time_is_printed_and_not_compared(self):
        self.assertIn("took 79 (now 80) s", self.check(RIGHT)[1])

    def test_each_wrong_figure_on_the_page_fails(self):
        for right, wrong in [("three blocks", "four blocks"), ("98.3 %", "98.4 %"), ("2.50", "2.51"), ("| 2 |\n\nWith", "| 3 |\n\nWith"),
                             ("(0)", "(1)"), ("on_target.", "dropped."), ("three blocks", "3.1 blocks")]:
            with self.subTest(wrong=wrong):
                self.assertIn(right, RIGHT)
                self.assert_refused(RIGHT.replace(right, wrong), "WRONG: measured", "1 failed")

    def test_a_figure_that_the_page_does_not_have_fails(self):
        self.assert_refused(RIGHT.replace("three blocks\nof four", "blocks"), "the page lacks the text 'brings {trial.score} blocks", "measured: 3")

    def test_figures_in_another_order_or_of_the_next_claim_are_not_found(self):
        claim = "<!-- claim\n$ echo '{\"x\": 1}' > a.json\nfirst {a.x}\nsecond {a.x}\n-->\n"
        self.assert_refused(claim + "second 1, first 1", "lacks the text 'second {a.x}'")
        self.assert_refused(claim + "first 1\n\n" + claim + "first 1, second 1", "lacks the text 'second {a.x}'", "1 passed, 1 failed")

    def test_a_command_that_fails_fails_with_what_it_said(self):
        text = "<!-- claim\n$ echo lost >&2; false\nscore {1}\n-->\nscore 1"
        self.assert_refused(text, "exit code 1", "lost")
        self.assert_refused(text.replace("false", "false | cat"), "exit code 1")

    def test_a_claim_that_compares_nothing_fails(self):
        self.assert_refused("<!-- claim\n$ echo 3\n-->\nscore 3", "no figure is compared")
        self.assert_refused("<!-- claim\n$ echo 3\nscore 3\n-->\nscore 3", "has no figure in braces")
        self.assert_refused("<!-- claim\n{3} | {4}\n-->\n3 | 4", "has no words of the page")
        self.assert_refused("# Page\n\nscore 3", "no claim is marked")

    def test_a_claim_of_another_form_fails(self):
        self.assert_refused("<!-- claim score {3} -->\nscore 3", "1 claims are not")
        self.assert_refused("<!-- claim lang\nscore {3}\n-->\nscore 3", "unknown marks ['lang']")
        self.assert_refused("<!-- claim block\nscore {3}\n-->\nscore 3", "no block of commands follows")

    def test_a_value_that_is_not_there_fails_by_name(self):
        self.assert_refused(RIGHT.replace("trial.score", "trial.scores"), "no key 'scores'", "score, share")
        self.assert_refused(RIGHT.replace("trial.score}", "trails.score}"), "trails")
        self.assert_refused(RIGHT.replace('mean("blocks")', 'mean("cubes")'), "no column 'cubes'")

    def test_the_block_after_a_claim_is_run(self):
        text = "<!-- claim block\n$ echo '{\"x\": 2}' > b.json\nsum {a.x + b.x}\n-->\n\n```sh\necho '{\"x\": 1}' > a.json\n```\n\nThe sum 3.\n"
        self.assertEqual(self.check(text)[0], 0)
        self.assert_refused(text.replace("sum 3", "sum 4"), "sum 4 (WRONG: measured 3")

    def test_a_skipped_claim_is_counted_as_skipped(self):
        recorded = "<!-- claim recordings\n$ ls $RECORDINGS > names\nscore {3}\n-->\nscore 3"
        code, output, _ = self.check(recorded)
        self.assertEqual(code, 77, output)
        self.assertIn("0 passed, 0 failed, 1 skipped", output)
        with tempfile.TemporaryDirectory() as shared:
            os.makedirs(os.path.join(shared, "data/emg"))
            self.assertEqual(self.check(recorded, recordings=shared)[0], 0)
        long = recorded.replace("recordings", "long").replace("ls $RECORDINGS", "true")
        self.assertEqual(self.check(long)[0], 77)
        self.assertEqual(self.check(long, "--long")[0], 0)

    def test_an_update_writes_measured_figures_and_nothing_else(self):
        wrong = RIGHT.replace("three blocks", "four blocks").replace("98.3", "91.0").replace("2.50", "9.99")
        code, output, after = self.check(wrong, "--update")
        self.assertEqual((code, after), (1, RIGHT), output)
        # Times are left to who measures on a quiet machine.
        self.assertIn("took 79 s", after)
        self.assertEqual(self.check(wrong)[2], wrong)

    def test_figures_are_written_as_the_page_writes_them(self):
        for value, page, printed in [(1919, "1,919", "1,919"), (-0.001, "0.00", "0.00"), (2.8e-5, "2.7e-5", "2.8e-5"), (0, "none", "none"),
                                     (2.0, "Three", "Two"), (13, "twelve", "13"), (0.125, "0.13", "0.12"), (-1.18, "-1.18", "-1.18"), (0.46, "+0.40", "+0.46"), (-0.2, "+0.46", "-0.20")]:
            self.assertEqual(claims.as_printed(value, page), printed)


if __name__ == "__main__":
    unittest.main()
