//! Outside methods that the command line names by their files.

use proact_app::method_process::read_method_file;
use proact_control::MethodRegistry;
use std::{error::Error, ffi::OsString, path::Path};

/// `methods` with those whose files follow `--method` among `words`, and the words with their names in the place of the
/// files: what comes after knows names only.
///
/// # Errors
/// A file that cannot be read or describes no method, a name that exists already.
pub(crate) fn register_method_files(
    mut methods: MethodRegistry,
    mut words: Vec<OsString>,
) -> Result<(MethodRegistry, Vec<OsString>), Box<dyn Error>> {
    let mut follows = false;
    for word in &mut words {
        let Some(text) = word.to_str() else {
            follows = false;
            continue;
        };
        let (before, value) = match text.strip_prefix("--method=") {
            Some(value) => ("--method=", value),
            None if follows => ("", text),
            None => {
                follows = text == "--method";
                continue;
            }
        };
        follows = false;
        let path = Path::new(value);
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let entry = read_method_file(path)?;
        let name = format!("{before}{}", entry.info().name);
        methods = methods.with(entry).map_err(|error| format!("{}: {error}", path.display()))?;
        *word = name.into();
    }
    Ok((methods, words))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &[&str]) -> Vec<OsString> {
        text.iter().map(OsString::from).collect()
    }

    #[test]
    fn a_file_becomes_a_method_under_its_name_and_its_program_lies_beside_it() {
        let temp_dir = tempfile::tempdir().unwrap();
        let path = temp_dir.path().join("nod.toml");
        std::fs::write(
            &path,
            "name = \"nod\"\ntitle = \"by nodding\"\ncommand = [\"python3\", \"./nod.py\"]\n",
        )
        .unwrap();
        let file = path.to_str().unwrap();
        let joined = format!("--method={file}");
        for given in [vec!["proact", "demo", "--method", file], vec!["proact", "demo", &joined]] {
            let (methods, words) = register_method_files(MethodRegistry::standard(), words(&given)).unwrap();
            assert!(words.last().unwrap().to_str().unwrap().ends_with("nod"), "{words:?}");
            let command = methods.get("nod").unwrap().program().unwrap().command.clone();
            assert_eq!(command, ["python3".to_owned(), temp_dir.path().join("nod.py").display().to_string()]);
        }
        let plain = words(&["proact", "demo", "--method", "A", "nod.toml"]);
        let (methods, same) = register_method_files(MethodRegistry::standard(), plain.clone()).unwrap();
        assert_eq!((methods.names().len(), same), (4, plain));
        let error =
            register_method_files(MethodRegistry::standard(), words(&["--method", "none.toml"])).unwrap_err();
        assert!(error.to_string().starts_with("cannot read none.toml: "), "{error}");
        std::fs::write(&path, "name = \"D\"\ntitle = \"twice\"\ncommand = [\"nod\"]\n").unwrap();
        let error =
            register_method_files(MethodRegistry::standard(), words(&["--method", file])).unwrap_err();
        assert!(error.to_string().contains("method \"D\" exists already"), "{error}");
    }
}
