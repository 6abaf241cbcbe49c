//! Message definitions where the program runs: those of installed packages, and those that it was compiled with.

use md5::{Digest, Md5};
use std::{
    collections::BTreeMap,
    env, fs,
    path::{Path, PathBuf},
};

/// Definitions nest at most this deep.
const DEEPEST: usize = 32;
/// What the program was compiled with.
const COMPILED: &str = include_str!(concat!(env!("OUT_DIR"), "/share/definitions.txt"));

/// A message type as connections announce it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Definition {
    /// Such as `std_msgs/String`.
    pub name: String,
    /// ROS's checksum over it and what it contains.
    pub md5: String,
    /// Its text, then those of the types that it needs, each after a line of `=` and `MSG: name`.
    pub text: String,
}

/// A service type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServiceDefinition {
    /// Such as `std_srvs/Empty`.
    pub name: String,
    /// ROS's checksum over request and response.
    pub md5: String,
    /// What is asked.
    pub request: Definition,
    /// What is answered.
    pub response: Definition,
}

/// Where definitions are looked for.
#[derive(Debug)]
pub struct Definitions {
    /// Folders of packages, best first.
    folders: Vec<PathBuf>,
    compiled: BTreeMap<&'static str, &'static str>,
}

impl Default for Definitions {
    /// Looks in `ROS_PACKAGE_PATH`, the prefixes in `CMAKE_PREFIX_PATH`, `/usr/share` and `/opt/ros`.
    fn default() -> Self {
        let listed = |name: &str| env::var_os(name).unwrap_or_default();
        let mut folders: Vec<PathBuf> = env::split_paths(&listed("ROS_PACKAGE_PATH")).collect();
        folders.extend(env::split_paths(&listed("CMAKE_PREFIX_PATH")).map(|prefix| prefix.join("share")));
        folders.push("/usr/share".into());
        if let Ok(distributions) = fs::read_dir("/opt/ros") {
            folders.extend(distributions.flatten().map(|d| d.path().join("share")));
        }
        folders.retain(|folder| folder.is_absolute());
        Self::within(folders)
    }
}

impl Definitions {
    fn within(folders: Vec<PathBuf>) -> Self {
        let parts = COMPILED.split(">>> ").filter_map(|part| part.split_once('\n'));
        Self { folders, compiled: parts.collect() }
    }

    /// The message type of that name; none if it, or one that it needs, is nowhere.
    pub fn message(&self, name: &str) -> Option<Definition> {
        self.define(name, &self.source("msg", name)?)
    }

    /// The service type of that name.
    pub fn service(&self, name: &str) -> Option<ServiceDefinition> {
        let source = self.source("srv", name)?;
        let (mut halves, mut half) = ([String::new(), String::new()], 0);
        for line in source.lines() {
            if line.trim() == "---" {
                half = 1;
            } else {
                halves[half] += line;
                halves[half].push('\n');
            }
        }
        let mut both = Md5::new();
        for text in &halves {
            both.update(self.checksum_text(name, text, 0)?);
        }
        let request = self.define(&format!("{name}Request"), &halves[0])?;
        let response = self.define(&format!("{name}Response"), &halves[1])?;
        Some(ServiceDefinition { name: name.to_owned(), md5: hexadecimal(both), request, response })
    }

    fn define(&self, name: &str, source: &str) -> Option<Definition> {
        let md5 = hexadecimal(Md5::new_with_prefix(self.checksum_text(name, source, 0)?));
        let mut text = source.trim_end().to_owned() + "\n";
        let mut needed = Vec::new();
        self.collect(name, source, &mut needed, 0)?;
        for (inner, source) in needed {
            text += &format!("{}\nMSG: {inner}\n{}\n", "=".repeat(80), source.trim_end());
        }
        Some(Definition { name: name.to_owned(), md5, text })
    }

    /// The text of a definition: the first package of its name that has it, then what was compiled in.
    fn source(&self, kind: &str, name: &str) -> Option<String> {
        let (package, short) = name.split_once('/')?;
        let plain = |word: &str| !word.is_empty() && word.chars().all(|c| c.is_alphanumeric() || c == '_');
        // The name comes from other programs; it must not lead out of the folders.
        if !plain(package) || !plain(short) {
            return None;
        }
        let file = Path::new(kind).join(format!("{short}.{kind}"));
        let installed = self.folders.iter().find_map(|folder| {
            let own = folder.file_name().is_some_and(|name| name == package).then(|| folder.join(&file));
            let inside = Some(folder.join(package).join(&file));
            // A source folder may group its packages.
            let grouped = fs::read_dir(folder)
                .into_iter()
                .filter(|_| folder.ends_with("src"))
                .flatten()
                .flatten()
                .map(|entry| entry.path().join(package).join(&file));
            own.into_iter().chain(inside).chain(grouped).find_map(|path| fs::read_to_string(path).ok())
        });
        installed.or_else(|| Some((*self.compiled.get(&*format!("{package}/{kind}/{short}"))?).to_owned()))
    }

    /// What ROS's checksum is made of: constants, then fields, with checksums for the types of messages.
    fn checksum_text(&self, name: &str, source: &str, depth: usize) -> Option<String> {
        if depth > DEEPEST {
            return None;
        }
        let (mut constants, mut fields) = (Vec::new(), Vec::new());
        for line in source.lines() {
            match Line::read(name, line)? {
                Line::Nothing => {}
                Line::Constant(text) => constants.push(text),
                Line::Field { kind, array, field, message: None } => {
                    fields.push(format!("{kind}{array} {field}"))
                }
                Line::Field { field, message: Some(inner), .. } => {
                    let text = self.checksum_text(&inner, &self.source("msg", &inner)?, depth + 1)?;
                    fields.push(format!("{} {field}", hexadecimal(Md5::new_with_prefix(text))));
                }
            }
        }
        constants.extend(fields);
        Some(constants.join("\n"))
    }

    /// The types that a definition needs, each once.
    fn collect(
        &self,
        name: &str,
        source: &str,
        found: &mut Vec<(String, String)>,
        depth: usize,
    ) -> Option<()> {
        if depth > DEEPEST {
            return None;
        }
        for line in source.lines() {
            if let Line::Field { message: Some(inner), .. } = Line::read(name, line)?
                && !found.iter().any(|(known, _)| *known == inner)
            {
                let source = self.source("msg", &inner)?;
                found.push((inner.clone(), source.clone()));
                self.collect(&inner, &source, found, depth + 1)?;
            }
        }
        Some(())
    }
}

/// A line of a definition.
enum Line {
    Nothing,
    /// As it enters the checksum.
    Constant(String),
    Field {
        kind: String,
        /// `[]`, `[4]` or nothing.
        array: String,
        field: String,
        /// The full name of its type, if that is a message.
        message: Option<String>,
    },
}

impl Line {
    fn read(of: &str, line: &str) -> Option<Line> {
        let plain = line.split('#').next().unwrap_or_default().trim();
        if plain.is_empty() {
            return Some(Line::Nothing);
        }
        let (kind, rest) = plain.split_once([' ', '\t'])?;
        if rest.contains('=') {
            // The value of a text goes to the end of the line, `#` and all.
            let whole = if kind == "string" { line.trim() } else { plain };
            let (declared, value) = whole.split_once('=')?;
            let name = declared.split_whitespace().nth(1)?;
            return Some(Line::Constant(format!("{kind} {name}={}", value.trim())));
        }
        let (kind, array) = kind.find('[').map_or((kind, ""), |at| kind.split_at(at));
        let package = of.split('/').next().unwrap_or_default();
        let message = match kind {
            "bool" | "byte" | "char" | "int8" | "uint8" | "int16" | "uint16" | "int32" | "uint32"
            | "int64" | "uint64" | "float32" | "float64" | "string" | "time" | "duration" => None,
            "Header" => Some("std_msgs/Header".to_owned()),
            full if full.contains('/') => Some(full.to_owned()),
            local => Some(format!("{package}/{local}")),
        };
        Some(Line::Field {
            kind: kind.to_owned(),
            array: array.to_owned(),
            field: rest.trim().to_owned(),
            message,
        })
    }
}

fn hexadecimal(sum: Md5) -> String {
    sum.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rosrust::{Message, ServicePair};

    /// Without any package on the machine.
    fn compiled() -> Definitions {
        Definitions::within(vec![])
    }

    #[test]
    fn checksums_are_those_of_the_compiled_types() {
        use crate::messages::{diagnostic_msgs, gazebo_msgs, proact_msgs, sensor_msgs, visualization_msgs};
        fn check<M: Message>() {
            let found = compiled().message(&M::msg_type()).unwrap();
            assert_eq!(found.md5, M::md5sum(), "{}", found.name);
        }
        check::<diagnostic_msgs::DiagnosticArray>();
        check::<gazebo_msgs::ModelStates>();
        check::<proact_msgs::Frame>();
        check::<sensor_msgs::JointState>();
        check::<visualization_msgs::MarkerArray>();
        fn serve<S: ServicePair>() {
            let found = compiled().service(&S::msg_type()).unwrap();
            assert_eq!(found.md5, S::md5sum(), "{}", found.name);
        }
        serve::<crate::messages::std_srvs::Empty>();
        serve::<crate::messages::gazebo_msgs::GetModelState>();
        serve::<crate::messages::controller_manager_msgs::SwitchController>();
    }

    #[test]
    fn a_package_of_the_workspace_comes_before_the_compiled_one_and_may_be_new() {
        let folder = env::temp_dir().join(format!("proact-definitions-{}", std::process::id()));
        let package = folder.join("src/lab_msgs/msg");
        fs::create_dir_all(&package).unwrap();
        fs::write(package.join("Dose.msg"), "uint8 FULL=3 # most\nHeader header\nfloat32 amount\n").unwrap();
        let found = Definitions::within(vec![folder.join("src")]).message("lab_msgs/Dose").unwrap();
        assert!(found.text.contains("MSG: std_msgs/Header\n"), "{}", found.text);
        // By genmsg, for the same file.
        assert_eq!(found.md5, "136e9e3d26e764c419656eec175a6928");
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_name_that_leads_elsewhere_or_nowhere_is_none() {
        for name in ["std_msgs/../../x", "String", "std_msgs/Nothing", "/String", "std_msgs/"] {
            assert_eq!(compiled().message(name), None, "{name}");
        }
    }
}
