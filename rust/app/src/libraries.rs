//! The native libraries that this process has loaded.

use proact_recording::UNKNOWN_COMMIT;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
};

/// What this program is called among the versions of a record.
pub const PROGRAM_NAME: &str = "proact";

/// The commit that the program was built from; only its `main` knows.
static COMMIT: OnceLock<String> = OnceLock::new();

/// Takes the commit that the program was built from, once at its start, for the records that it writes.
pub fn set_source_commit(commit: &str) {
    // A second one is that of the same program.
    let _ = COMMIT.set(commit.to_owned());
}

/// The commit that the program was built from; `unknown` without one.
pub fn source_commit() -> &'static str {
    COMMIT.get().map_or(UNKNOWN_COMMIT, String::as_str)
}

/// The native libraries: name for people, beginning of the file name, Debian package with the headers.
pub const LIBRARIES: [(&str, &str, &str); 6] = [
    ("KDL", "liborocos-kdl.so", "liborocos-kdl-dev"),
    ("OMPL", "libompl.so", "libompl-dev"),
    ("ODE", "libode.so", "libode-dev"),
    ("urdfdom", "liburdfdom_model.so", "liburdfdom-dev"),
    ("FCL", "libfcl.so", "libfcl-dev"),
    ("libccd", "libccd.so", "libccd-dev"),
];

/// The files of [`LIBRARIES`] that this process has loaded, and their Debian versions.
pub fn loaded_libraries() -> (Vec<Option<PathBuf>>, BTreeMap<PathBuf, String>) {
    // Only Linux has this file; elsewhere every library is reported as not found, which is the truth there.
    let map = fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let loaded: Vec<Option<PathBuf>> =
        LIBRARIES.iter().map(|(_, file, _)| loaded_library(&map, file)).collect();
    let versions = debian_versions(&loaded.iter().flatten().cloned().collect::<Vec<_>>());
    (loaded, versions)
}

/// The version of each native library that this process has loaded, by its name for people: Debian's, or else the name
/// of its file.
pub fn library_versions() -> BTreeMap<&'static str, String> {
    let (loaded, versions) = loaded_libraries();
    let version = |path: PathBuf| {
        let file = || path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        versions.get(&path).cloned().unwrap_or_else(file)
    };
    LIBRARIES.iter().zip(loaded).filter_map(|((name, ..), path)| Some((*name, version(path?)))).collect()
}

/// What a record is compared with: the version of this program, and the file of each native library that it has loaded,
/// whose name ends in the library's version.
pub fn versions() -> BTreeMap<String, String> {
    let map = fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let file = |path: PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let of = |(name, prefix, _): &(&str, &str, &str)| {
        loaded_library(&map, prefix).map(|path| ((*name).to_owned(), file(path)))
    };
    let libraries = LIBRARIES.iter().filter_map(of);
    libraries.chain([(PROGRAM_NAME.to_owned(), env!("CARGO_PKG_VERSION").to_owned())]).collect()
}

/// The file of a library whose name begins with `file`, as mapped into this process.
///
/// `map` is the text of `/proc/self/maps`: the path is the sixth column, and a library has several lines.
fn loaded_library(map: &str, file: &str) -> Option<PathBuf> {
    map.lines()
        .filter_map(|line| line.find('/').map(|start| Path::new(&line[start..])))
        .find(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(file)))
        .map(Path::to_path_buf)
}

/// The Debian version of each file that belongs to a package. Empty where there is no dpkg.
fn debian_versions(paths: &[PathBuf]) -> BTreeMap<PathBuf, String> {
    if paths.is_empty() {
        return BTreeMap::new();
    }
    // `dpkg-query -S` prints "package:architecture: path" and fails for files of no package, after printing the rest.
    let searched = Command::new("dpkg-query").arg("-S").args(paths).output();
    let Ok(searched) = searched else { return BTreeMap::new() };
    let owners: Vec<(String, PathBuf)> = String::from_utf8_lossy(&searched.stdout)
        .lines()
        .filter_map(|line| line.split_once(": "))
        .map(|(package, path)| (package.to_owned(), PathBuf::from(path)))
        .collect();
    owners
        .into_iter()
        .filter_map(|(package, path)| {
            command_output("dpkg-query", &["-W", "-f", "${Version}", &package]).map(|version| (path, version))
        })
        .collect()
}

/// First line of what a program prints, or nothing when it cannot be run or fails.
pub fn command_output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.lines().next().unwrap_or_default().trim();
    (output.status.success() && !line.is_empty()).then(|| line.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: &str = "\
7f0000000000-7f0000001000 r--p 00000000 fe:00 1    /usr/lib/x86_64-linux-gnu/libode.so.8.2.0
7f0000001000-7f0000002000 r-xp 00001000 fe:00 1    /usr/lib/x86_64-linux-gnu/libode.so.8.2.0
7f0000002000-7f0000003000 rw-p 00000000 00:00 0
7f0000003000-7f0000004000 rw-p 00000000 00:00 0    [heap]
";

    #[test]
    fn a_loaded_library_is_found_by_the_beginning_of_its_file_name() {
        let path = loaded_library(MAP, "libode.so").expect("the map lists it");
        assert_eq!(path, Path::new("/usr/lib/x86_64-linux-gnu/libode.so.8.2.0"));
    }

    #[test]
    fn a_library_that_is_not_loaded_is_not_found() {
        assert_eq!(loaded_library(MAP, "libompl.so"), None);
        assert_eq!(loaded_library("", "libode.so"), None);
    }
}
