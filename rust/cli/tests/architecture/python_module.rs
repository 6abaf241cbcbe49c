//! The Python module exports what its stub file says: a rename in Rust is no rename in Python.

use crate::workspace::read;
use std::collections::BTreeSet;

/// Names that `lib` adds to the module; `source` gives the text of a file of the crate.
fn exported(lib: &str, source: impl Fn(&str) -> String) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for line in lib.lines() {
        let path = |start: &str, end: char| {
            let rest = &line[line.find(start)? + start.len()..];
            rest[..rest.find(end)?].split_once("::")
        };
        if let Some((_, function)) = path("wrap_pyfunction!(", ',') {
            names.insert(function.to_owned());
        } else if let Some((module, class)) = path("add_class::<", '>') {
            let text = source(&format!("rust/python/src/{module}.rs"));
            let before = text.split(&format!("struct {class} ")).next().unwrap_or_default();
            let attribute = before.rsplit("#[pyclass(").next().unwrap_or_default();
            let named = attribute.strip_prefix("name = \"").and_then(|rest| rest.split('"').next());
            names.insert(named.unwrap_or(class).to_owned());
        }
    }
    names
}

/// Names that the stub file declares.
fn declared(stub: &str) -> BTreeSet<String> {
    let name = |line: &str| {
        let rest = line.strip_prefix("class ").or_else(|| line.strip_prefix("def "))?;
        Some(rest.split(['(', ':']).next()?.to_owned())
    };
    stub.lines().filter_map(name).collect()
}

#[test]
fn the_module_exports_what_its_stub_file_declares() {
    let exported = exported(&read("rust/python/src/lib.rs"), read);
    assert!(exported.len() > 5, "{exported:?}");
    assert_eq!(exported, declared(&read("python/proact/_proact.pyi")));
}

#[test]
fn a_class_that_was_renamed_in_rust_alone_is_found() {
    let lib = "module.add_class::<agent::PyTrial>()?;\nmodule.add_function(wrap_pyfunction!(emg::outer, module)?)?;";
    let source =
        |attribute: &str| format!("#[pyclass({attribute}module = \"m\")]\npub(crate) struct PyTrial {{");
    let names = |attribute: &str| exported(lib, |_| source(attribute)).into_iter().collect::<Vec<_>>();
    assert_eq!(names(""), ["PyTrial", "outer"]);
    assert_eq!(names("name = \"Trial\", "), ["Trial", "outer"]);
    assert_eq!(declared("class Trial:\n    def step(self): ...\ndef outer(): ...").len(), 2);
}
