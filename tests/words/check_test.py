"""One offence of each kind in a repository of a few files: the check names file, line and the word to use."""

import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve().parent

CLEAN = {
    "rust/one/src/lib.rs": "//! Reads a sample.\npub struct Reader;\n",
    "rust/two/src/lib.rs": "//! Writes a sample.\npub struct Writer;\n",
    "rust/bridge/web/src/main.ts": 'export const title = "Start";\n',
    "docs/page.md": "The node stops the arm.\n",
}


class Words(unittest.TestCase):
    def check(self, files=(), to_do="", committed_to_do=""):
        """Exit code and lines for the clean repository with these files changed."""
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)

            def git(*words):
                subprocess.run(["git", "-C", folder, "-c", "user.name=t", "-c", "user.email=t@t", *words], check=True, capture_output=True)

            def write(path, text):
                (root / path).parent.mkdir(parents=True, exist_ok=True)
                (root / path).write_text(text)

            git("init", "-q")
            for name in ("check.py", "words.toml", "spelling.txt"):
                (root / "tests/words").mkdir(parents=True, exist_ok=True)
                shutil.copy(HERE / name, root / "tests/words" / name)
            for path, text in CLEAN.items():
                write(path, text)
            write("tests/words/prose_to_do.txt", committed_to_do)
            git("add", "-A")
            git("commit", "-qm", "clean")
            for path, text in dict(files).items():
                write(path, text)
            write("tests/words/prose_to_do.txt", to_do)
            git("add", "-A")
            git("commit", "-qm", "changed", "--allow-empty")
            run = subprocess.run(
                [sys.executable, root / "tests/words/check.py"], capture_output=True, text=True, env={"PATH": "/usr/bin:/bin"})
            return run.returncode, [line for line in run.stdout.splitlines() if line.startswith("FAILED")]

    def refuse(self, files, *parts, **lists):
        code, lines = self.check(files, **lists)
        self.assertEqual(code, 1)
        self.assertEqual(len(lines), 1, lines)
        for part in parts:
            self.assertIn(part, lines[0])

    def test_a_clean_repository_passes(self):
        self.assertEqual(self.check(), (0, []))

    def test_an_identifier(self):
        self.refuse({"rust/one/src/lib.rs": "//! Reads.\nfn film_of_bag() {}\n"}, "rust/one/src/lib.rs:2", '"film"', "use playback")
        self.refuse({"rust/one/src/lib.rs": "//! Reads.\nconst FILM_RATE: u32 = 1;\n"}, '"FILM"', "use playback")
        self.refuse({"rust/one/src/lib.rs": "//! Reads.\nfn a_film_of_the_whole_trial() {}\n"}, '"film"', "use playback")
        self.refuse({"rust/one/src/lib.rs": "//! Reads.\nstruct EndlessJoints;\n"}, "rust/one/src/lib.rs:2", '"Endless"', "continuous")

    def test_words_of_strings_and_of_sentences_are_no_identifiers(self):
        text = '//! Reads.\nconst NAME: &str = "film";\n#[test]\nfn a_film_that_was_cut_is_read() {}\n'
        self.assertEqual(self.check({"rust/one/src/lib.rs": text}), (0, []))

    def test_a_file_name(self):
        self.refuse({"rust/one/src/studio.rs": ""}, "rust/one/src/studio.rs", "renderer")
        self.refuse({"rust/one/src/studio/mod.rs": ""}, "rust/one/src/studio/mod.rs", "renderer")
        self.refuse({"rust/one/src/test_motion.rs": ""}, "rust/one/src/test_motion.rs", "named like a test")
        self.refuse({"rust/one/src/motion_test.rs": ""}, "rust/one/src/motion_test.rs", "named like a test")

    def test_prose_of_a_comment_and_of_a_page(self):
        self.refuse({"rust/one/src/lib.rs": "//! For whoever reads.\n"}, "rust/one/src/lib.rs:1", '"whoever"', "anyone who")
        self.refuse({"docs/page.md": "One.\nThis is none.\n"}, "docs/page.md:2", "invalid")
        self.refuse({"rust/bridge/web/src/main.ts": 'export const t = "nobody drives";\n'}, "main.ts:1", "page text")

    def test_a_type_that_two_crates_have(self):
        self.refuse({"rust/two/src/lib.rs": "//! Writes.\npub struct Reader;\n"}, '"Reader"', "rust/two/src/lib.rs:2")

    def test_the_list_of_prose_gets_only_shorter(self):
        whoever = {"docs/page.md": "Whoever.\n"}
        self.assertEqual(self.check(whoever, to_do="docs/page.md\n", committed_to_do="docs/page.md\n"), (0, []))
        self.refuse(whoever, "docs/page.md is new in the list", to_do="docs/page.md\n")
        self.refuse({}, "take it out", to_do="docs/page.md\n", committed_to_do="docs/page.md\n")

    @unittest.skipUnless(shutil.which("codespell"), "codespell is not on this machine")
    def test_a_misspelling(self):
        self.refuse({"docs/page.md": "The arm recieves a command.\n"}, "docs/page.md:1", "recieves")


if __name__ == "__main__":
    unittest.main()
