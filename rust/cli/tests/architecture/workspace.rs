//! The facts: packages and their dependencies from `cargo metadata`, and the files of the repository.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;

/// When a dependency is needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    Normal,
    Build,
    Dev,
}

/// One package of the workspace.
#[derive(Debug, Clone, Default)]
pub struct Member {
    /// Direct dependencies by package name, of the workspace and of others.
    pub dependencies: BTreeSet<(String, Kind)>,
    /// Names of all packages that end up in it: normal dependencies, theirs, and so on.
    pub closure: BTreeSet<String>,
}

/// The workspace as Cargo sees it on this platform.
#[derive(Debug, Clone)]
pub struct Workspace {
    /// Members by package name.
    pub members: BTreeMap<String, Member>,
    /// Licence expression of every third-party package that is resolved, by "name version".
    pub licences: BTreeMap<String, String>,
}

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
    workspace_members: BTreeSet<String>,
    resolve: Resolve,
}

#[derive(Deserialize)]
struct Package {
    id: String,
    name: String,
    version: String,
    license: Option<String>,
    dependencies: Vec<Dependency>,
}

#[derive(Deserialize)]
struct Dependency {
    name: String,
    kind: Option<String>,
}

#[derive(Deserialize)]
struct Resolve {
    nodes: Vec<Node>,
}

#[derive(Deserialize)]
struct Node {
    id: String,
    deps: Vec<NodeDependency>,
}

#[derive(Deserialize)]
struct NodeDependency {
    pkg: String,
    dep_kinds: Vec<DependencyKind>,
}

#[derive(Deserialize)]
struct DependencyKind {
    kind: Option<String>,
}

/// The repository's root folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .canonicalize()
        .expect("the crate lies in the repository")
}

/// The text of a file of the repository.
pub fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path} cannot be read: {error}"))
}

/// Every text file of the repository that people write, with its path from the root.
pub fn files() -> Vec<(String, String)> {
    const LEFT_OUT: [&str; 7] = [".git", "target", "build", "node_modules", "dist", "trials", "output"];
    let mut found = Vec::new();
    let mut folders = vec![root()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder of the repository can be listed") {
            let path = entry.expect("its entries can be read").path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if path.is_dir() {
                if !LEFT_OUT.contains(&name.as_ref()) {
                    folders.push(path);
                }
            } else if let Ok(text) = fs::read_to_string(&path) {
                // Files that are not UTF-8 are pictures and meshes.
                let shown = path.strip_prefix(root()).expect("it was found under the root");
                found.push((shown.display().to_string(), text));
            }
        }
    }
    found.sort();
    assert!(found.len() > 20, "the repository has more files than {}", found.len());
    found
}

/// Asks Cargo about the workspace. Needs no network: the tests were just built from the same lock file.
pub fn load() -> Workspace {
    let host = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--format-version",
            "1",
            "--offline",
            "--filter-platform",
            &host,
            "--manifest-path",
        ])
        .arg(root().join("Cargo.toml"))
        .output()
        .expect("cargo runs: it started this test");
    assert!(output.status.success(), "cargo metadata failed: {}", String::from_utf8_lossy(&output.stderr));
    let metadata: Metadata =
        serde_json::from_slice(&output.stdout).expect("cargo metadata has the fields it documents");
    digest(&metadata)
}

fn digest(metadata: &Metadata) -> Workspace {
    let packages: BTreeMap<&str, &Package> = metadata.packages.iter().map(|p| (p.id.as_str(), p)).collect();
    let nodes: BTreeMap<&str, &Node> =
        metadata.resolve.nodes.iter().map(|node| (node.id.as_str(), node)).collect();

    let mut members = BTreeMap::new();
    for id in &metadata.workspace_members {
        let package = packages[id.as_str()];
        let dependencies =
            package.dependencies.iter().map(|d| (d.name.clone(), kind(d.kind.as_deref()))).collect();

        // Walk the normal dependencies only: what a build script or a test uses is not in the crate.
        let mut closure = BTreeSet::new();
        let mut open = vec![id.as_str()];
        while let Some(current) = open.pop() {
            for dependency in &nodes[current].deps {
                let normal = dependency.dep_kinds.iter().any(|d| kind(d.kind.as_deref()) == Kind::Normal);
                let name = &packages[dependency.pkg.as_str()].name;
                if normal && closure.insert(name.clone()) {
                    open.push(&dependency.pkg);
                }
            }
        }
        members.insert(package.name.clone(), Member { dependencies, closure });
    }

    let licenses = metadata
        .packages
        .iter()
        .filter(|package| !metadata.workspace_members.contains(&package.id))
        .map(|package| {
            (format!("{} {}", package.name, package.version), package.license.clone().unwrap_or_default())
        })
        .collect();
    Workspace { members, licences: licenses }
}

fn kind(name: Option<&str>) -> Kind {
    match name {
        None => Kind::Normal,
        Some("build") => Kind::Build,
        Some("dev") => Kind::Dev,
        Some(other) => panic!("cargo metadata names a dependency kind {other:?} that did not exist before"),
    }
}
