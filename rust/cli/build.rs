//! Tells the program the commit that it is built from, which `--version` and its records say.

// A build script reads files and the environment.
#![allow(clippy::disallowed_methods)]

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

fn main() {
    println!("cargo:rerun-if-env-changed=PROACT_COMMIT");
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    // Whoever builds from sources without git can say it.
    let commit = std::env::var("PROACT_COMMIT").ok().or_else(|| commit_of(&root));
    println!("cargo:rustc-env=PROACT_COMMIT={}", commit.unwrap_or_default());
}

/// The commit that is checked out in `root`, and whether files of it are changed; none where git does not know the sources.
fn commit_of(root: &Path) -> Option<String> {
    let git = |words: &[&str]| {
        // Asking must not write into the repository.
        let done =
            Command::new("git").arg("-C").arg(root).arg("--no-optional-locks").args(words).output().ok()?;
        let text = String::from_utf8(done.stdout).ok().filter(|_| done.status.success())?;
        Some(text.trim().to_owned())
    };
    for file in ["HEAD", "logs/HEAD"] {
        watch(root.join(git(&["rev-parse", "--git-path", file])?));
    }
    // Unpacked sources may lie in a repository of something else.
    git(&["ls-files", "--error-unmatch", "rust/cli/build.rs"])?;
    // What a change of makes another program.
    for part in ["Cargo.toml", "Cargo.lock", "cpp"] {
        watch(root.join(part));
    }
    for member in fs::read_dir(root.join("rust")).ok()?.flatten() {
        watch(member.path().join("Cargo.toml"));
        watch(member.path().join("src"));
    }
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let changed = git(&["status", "--porcelain", "--untracked-files=no"])?;
    Some(if changed.is_empty() { commit } else { format!("{commit}, changed") })
}

/// Has this asked again when `path` changes. A missing one would be asked about in every build.
fn watch(path: PathBuf) {
    if path.exists() {
        println!("cargo:rerun-if-changed={}", path.display());
    }
}
