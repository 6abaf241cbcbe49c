//! What a path may lead to, and what is there afterwards.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of files, with a reader beside it.

use nix::{sys::stat::Mode, unistd::mkfifo};
use proact_files::{
    OutputFile, WriteError, check_folder, check_output, check_output_dir_claim, claim_output_dir,
    create_in_place, make_folder, write_atomically,
};
use std::{
    fs,
    io::{ErrorKind, Read, Write},
    os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, chown, symlink},
    path::Path,
    process::Command,
    thread,
};

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn links_stay_and_what_they_lead_to_is_written() {
    // A link was replaced by a file, and what it led to kept its old content.
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("elsewhere")).unwrap();
    fs::write(at("elsewhere/target"), "old").unwrap();
    symlink("elsewhere/target", at("link")).unwrap();
    symlink("link", at("chain")).unwrap();
    symlink(at("elsewhere/new"), at("dangling")).unwrap();
    symlink("elsewhere", at("folder")).unwrap();
    for (name, target) in
        [("link", "target"), ("chain", "target"), ("dangling", "new"), ("folder/other", "other")]
    {
        let text = format!("through {name}");
        check_output(&at(name)).unwrap();
        write_atomically(&at(name), &text).unwrap();
        assert_eq!(fs::read_to_string(at("elsewhere").join(target)).unwrap(), text);
    }
    for link in ["link", "chain", "dangling", "folder"] {
        assert!(fs::symlink_metadata(at(link)).unwrap().is_symlink(), "{link}");
    }
    assert_eq!(names(folder.path()), ["chain", "dangling", "elsewhere", "folder", "link"]);
    assert_eq!(names(&at("elsewhere")), ["new", "other", "target"]);
}

#[test]
fn folders_and_links_without_an_end_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    symlink("there", at("here")).unwrap();
    symlink("here", at("there")).unwrap();
    symlink(".", at("self")).unwrap();
    for (name, why) in
        [("here", "symbolic links"), ("self", "a folder, expected a file"), ("none/x", "No such file")]
    {
        let error = check_output(&at(name)).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains(why), "{error}");
        assert_eq!(write_atomically(&at(name), "x").unwrap_err().to_string(), error);
    }
    assert_eq!(names(folder.path()), ["here", "self", "there"]);
}

#[test]
fn a_pipe_is_written_through_and_stays_a_pipe() {
    let folder = tempfile::tempdir().unwrap();
    let (pipe, link) = (folder.path().join("pipe"), folder.path().join("link"));
    mkfifo(&pipe, Mode::S_IRWXU).unwrap();
    symlink("pipe", &link).unwrap();
    // Does not wait for a reader, which a check must not need.
    check_output(&link).unwrap();
    // More than a pipe holds.
    let text = "0123456789".repeat(50_000);
    for path in [&pipe, &link] {
        let read = thread::spawn({
            let pipe = pipe.clone();
            move || fs::read_to_string(pipe).unwrap()
        });
        write_atomically(path, &text).unwrap();
        assert!(read.join().unwrap() == text, "{}", path.display());
    }
    let read = thread::spawn({
        let pipe = pipe.clone();
        move || fs::read_to_string(pipe).unwrap()
    });
    create_in_place(&pipe).unwrap().write_all(b"piece by piece").unwrap();
    assert_eq!(read.join().unwrap(), "piece by piece");
    assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
}

#[test]
fn devices_are_written_through_and_stay_devices() {
    // As root this replaced /dev/full by a regular file.
    let error = write_atomically(Path::new("/dev/full"), "text").unwrap_err();
    assert!(error.to_string().contains("/dev/full: No space left"), "{error}");
    write_atomically(Path::new("/dev/null"), "text").unwrap();
    for device in ["/dev/full", "/dev/null"] {
        assert!(fs::metadata(device).unwrap().file_type().is_char_device(), "{device}");
    }
    let folder = tempfile::tempdir().unwrap();
    let node = folder.path().join("node");
    let made = Command::new("mknod").arg(&node).args(["c", "1", "3"]).output().unwrap();
    // A system may let root make the node and not open it.
    if !made.status.success() || fs::read(&node).is_err() {
        eprintln!("skipped: no device node can be made here: {}", String::from_utf8_lossy(&made.stderr));
        return;
    }
    let before = fs::metadata(&node).unwrap();
    write_atomically(&node, "text").unwrap();
    let after = fs::metadata(&node).unwrap();
    assert!(after.file_type().is_char_device());
    assert_eq!((before.ino(), before.rdev()), (after.ino(), after.rdev()));
}

#[test]
fn owner_and_mode_of_a_file_stay() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("private");
    fs::write(&path, "old").unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
    if fs::metadata("/proc/self").unwrap().uid() == 0 {
        chown(&path, Some(65534), Some(65533)).unwrap();
    } else {
        eprintln!("skipped: only root can give a file to another owner");
    }
    let before = fs::metadata(&path).unwrap();
    write_atomically(&path, "new").unwrap();
    let after = fs::metadata(&path).unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "new");
    assert_eq!((before.mode(), before.uid(), before.gid()), (after.mode(), after.uid(), after.gid()));
    // A new one is as any that this user makes.
    fs::write(folder.path().join("plain"), "").unwrap();
    write_atomically(&folder.path().join("whole"), "").unwrap();
    let mode = |name: &str| fs::metadata(folder.path().join(name)).unwrap().mode();
    assert_eq!(mode("whole"), mode("plain"));
}

#[test]
fn what_is_not_finished_leaves_the_old_file_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.json");
    fs::write(&path, "old").unwrap();
    let mut file = OutputFile::create(&path).unwrap();
    file.write_all(b"half of the n").unwrap();
    drop(file);
    assert_eq!(fs::read_to_string(&path).unwrap(), "old");
    assert_eq!(names(folder.path()), ["model.json"]);
}

#[test]
fn a_file_that_is_to_be_new_is_never_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let (path, link) = (folder.path().join("a.xdf"), folder.path().join("link"));
    symlink("a.xdf", &link).unwrap();
    let mut late = OutputFile::create_new(&path).unwrap();
    late.write_all(b"late").unwrap();
    let mut file = OutputFile::create_new(&link).unwrap();
    file.write_all(b"first").unwrap();
    file.finish().unwrap();
    assert!(matches!(OutputFile::create_new(&link), Err(WriteError::Exists { .. })));
    assert!(matches!(late.finish(), Err(WriteError::Exists { .. })), "it came meanwhile");
    assert_eq!(create_in_place(&link).unwrap_err().kind(), ErrorKind::AlreadyExists);
    let mut text = String::new();
    fs::File::open(&path).unwrap().read_to_string(&mut text).unwrap();
    assert_eq!(text, "first");
    OutputFile::create_new(Path::new("/dev/null")).unwrap().finish().unwrap();
}

#[test]
fn a_name_as_long_as_the_system_allows_is_written() {
    let folder = tempfile::tempdir().unwrap();
    write_atomically(&folder.path().join("x".repeat(255)), "text").unwrap();
    assert!(write_atomically(&folder.path().join("x".repeat(256)), "text").is_err());
}

#[test]
fn folders_are_made_where_links_lead_and_checked_without_a_trace() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    symlink("new", at("dangling")).unwrap();
    check_folder(&at("dangling/deep/er")).unwrap();
    check_folder(&at("dangling")).unwrap();
    assert_eq!(names(folder.path()), ["dangling"]);
    make_folder(&at("dangling")).unwrap();
    assert!(at("new").is_dir() && at("dangling").is_symlink());

    fs::write(at("file"), "").unwrap();
    // The kernel's folder takes no files, not even of root.
    for (path, why) in [(at("file/x"), "Not a directory"), ("/proc/proact".into(), "/proc/proact")] {
        let error = check_folder(&path).unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
        make_folder(&path).unwrap_err();
    }
}

#[test]
fn a_folder_is_claimed_only_if_it_is_empty_or_ours() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    claim_output_dir(&out, "first.csv", "export").unwrap();
    // What a kill in the first file leaves.
    fs::write(out.join(".proact-x1.partial"), "half").unwrap();
    claim_output_dir(&out, "first.csv", "export").unwrap();
    fs::write(out.join("thesis.txt"), "all of it").unwrap();
    let error = check_output_dir_claim(&out, "first.csv", "export").unwrap_err();
    assert!(error.to_string().contains("is not empty, and is no earlier export"), "{error}");
    fs::write(out.join("first.csv"), "").unwrap();
    claim_output_dir(&out, "first.csv", "export").unwrap();
}
