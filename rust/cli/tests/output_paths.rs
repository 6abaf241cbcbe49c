//! Where an output is named: links, pipes and devices of each command that writes a file, one in each way that there is to
//! write one.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of files and processes.

use std::{
    fs,
    os::unix::fs::{FileTypeExt, PermissionsExt, symlink},
    path::Path,
    process::{Command, Output},
    thread,
};

fn proact(dir: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_proact")).args(words).current_dir(dir).output().unwrap()
}

/// A text as a whole, a stream of chunks, and a file that is read again: each with the word for its place last.
const WRITERS: [&[&str]; 3] = [
    &[
        "emg",
        "features",
        "--csv",
        "s.csv",
        "--window",
        "20",
        "--increment",
        "10",
        "--unit",
        "samples",
        "--out",
    ],
    &["export", "trial", "--xdf"],
    &["study", "archive", "pilot", "--out"],
];

/// What the writers need.
fn place() -> tempfile::TempDir {
    let temp_dir = tempfile::tempdir().unwrap();
    // Noise: a column that counts is no muscle and is refused.
    let mut seed = 1_u32;
    let mut sample = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (f64::from(seed >> 24) - 127.5).to_string()
    };
    let rows = (0..200).map(|_| (0..8).map(|_| sample()).collect::<Vec<_>>().join(",") + "\n");
    let text: String = rows.collect();
    fs::write(temp_dir.path().join("s.csv"), text).unwrap();
    for words in [
        ["demo", "--headless", "--set", "limit_secs=0.5", "--out", "trial"].as_slice(),
        &["study", "new", "pilot"],
    ] {
        let made = proact(temp_dir.path(), words);
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    }
    temp_dir
}

fn written(dir: &Path, writer: &[&str], out: &str) -> Output {
    proact(dir, &[writer, &[out]].concat())
}

fn wrote(dir: &Path, writer: &[&str], out: &str) {
    let done = written(dir, writer, out);
    assert!(done.status.success(), "{writer:?} {out}: {}", String::from_utf8_lossy(&done.stderr));
}

#[test]
fn every_command_writes_where_links_lead_and_through_pipes() {
    // A link became a file, and a pipe was refused or replaced.
    let temp_dir = place();
    let dir = temp_dir.path();
    fs::create_dir(dir.join("elsewhere")).unwrap();
    for (k, writer) in WRITERS.into_iter().enumerate() {
        let [plain, link, pipe] = ["plain", "link", "pipe"].map(|name| format!("{name}{k}"));
        wrote(dir, writer, &plain);
        let expected = fs::read(dir.join(&plain)).unwrap();
        assert!(!expected.is_empty());

        symlink(format!("elsewhere/{k}"), dir.join(&link)).unwrap();
        wrote(dir, writer, &link);
        assert!(dir.join(&link).is_symlink(), "{writer:?}");
        assert!(fs::read(dir.join("elsewhere").join(k.to_string())).unwrap() == expected, "{writer:?}");

        let pipe = dir.join(pipe);
        assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let reader = thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).unwrap()
        });
        wrote(dir, writer, pipe.to_str().unwrap());
        assert!(reader.join().unwrap() == expected, "{writer:?}");
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo(), "{writer:?}");

        // Standard output is a pipe here, and gets the file before what the command says.
        let output = written(dir, writer, "/dev/stdout");
        assert!(output.status.success() && output.stdout.starts_with(&expected), "{writer:?}");
    }
}

#[test]
fn every_command_names_a_full_device_and_leaves_it_a_device() {
    // As root each replaced /dev/full by a file; the export said only that there was no space.
    let temp_dir = place();
    for writer in WRITERS {
        let done = written(temp_dir.path(), writer, "/dev/full");
        let error = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(!done.status.success() && error.contains("/dev/full: No space left"), "{writer:?}: {error}");
        wrote(temp_dir.path(), writer, "/dev/null");
        for device in ["/dev/full", "/dev/null"] {
            assert!(fs::metadata(device).unwrap().file_type().is_char_device(), "{writer:?}");
        }
    }
}

#[test]
fn a_file_keeps_its_mode_and_a_folder_that_is_not_there_is_refused() {
    let temp_dir = place();
    let out = temp_dir.path().join("features.csv");
    fs::write(&out, "old").unwrap();
    fs::set_permissions(&out, fs::Permissions::from_mode(0o600)).unwrap();
    wrote(temp_dir.path(), WRITERS[0], "features.csv");
    assert_ne!(fs::read_to_string(&out).unwrap(), "old");
    assert_eq!(fs::metadata(&out).unwrap().permissions().mode() & 0o7777, 0o600);
    for writer in WRITERS {
        let done = written(temp_dir.path(), writer, "none/out");
        let error = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(!done.status.success() && error.contains("none/out: No such file"), "{writer:?}: {error}");
    }
}

#[test]
fn a_link_to_a_folder_that_is_not_there_yet_gets_its_folder() {
    let temp_dir = place();
    for (link, words) in [
        ("trials", ["demo", "--headless", "--set", "limit_secs=0.5", "--out", "trials"].as_slice()),
        ("tables", &["study", "export", "pilot", "--out", "tables"]),
        ("arm", &["model", "size", "mpl_right", "--stature", "1.7", "--out", "arm"]),
    ] {
        symlink(format!("of-{link}"), temp_dir.path().join(link)).unwrap();
        let done = proact(temp_dir.path(), words);
        assert!(done.status.success(), "{words:?}: {}", String::from_utf8_lossy(&done.stderr));
        assert!(temp_dir.path().join(link).is_symlink());
        assert!(
            fs::read_dir(temp_dir.path().join(format!("of-{link}"))).unwrap().next().is_some(),
            "{words:?}"
        );
    }
}

#[test]
fn a_report_that_does_not_fit_leaves_nothing_that_looks_whole() {
    // A page stayed that said it was not finished, with half of the tables.
    let temp_dir = place();
    let dir = temp_dir.path();
    // Files of more than 8 KiB are refused, as a full disk refuses them: tables fit, figures do not.
    let analyze = |limit: &str| {
        let command = format!("ulimit -f {limit}; exec \"$0\" analyze trial --out report");
        Command::new("bash")
            .args(["-c", &command, env!("CARGO_BIN_EXE_proact")])
            .current_dir(dir)
            .output()
            .unwrap()
    };
    let done = analyze("8");
    let error = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(!done.status.success() && error.contains("report/"), "{error}");
    assert!(!dir.join("report").exists(), "{error}");
    assert!(analyze("unlimited").status.success());
    // What a lab has put beside an earlier report stays.
    fs::write(dir.join("report/tables/notes.txt"), "mine").unwrap();
    assert!(!analyze("8").status.success());
    let page = fs::read_to_string(dir.join("report/report.html")).unwrap();
    assert!(page.contains("not finished"), "{page}");
    let left = |name: &str| fs::read_dir(dir.join("report").join(name)).map_or(0, Iterator::count);
    assert_eq!((left(""), left("tables")), (2, 1), "the page, and the notes");
    assert!(analyze("unlimited").status.success());
}
