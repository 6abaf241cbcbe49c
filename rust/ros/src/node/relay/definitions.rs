//! Message definitions where the program runs: those of installed packages, and those that it was compiled with.

use proact_messages::{MessageType, ServiceType};
use std::{
    collections::BTreeMap,
    env, fs,
    path::{Path, PathBuf},
    sync::Arc,
};

/// What the program was compiled with.
const COMPILED: &str = include_str!(concat!(env!("OUT_DIR"), "/share/definitions.txt"));

/// A message type as connections announce it.
#[derive(Clone, Debug, PartialEq)]
pub struct MessageDefinition {
    /// The type.
    pub kind: Arc<MessageType>,
    /// Its text, then those of the types that it needs, each after a line of `=` and `MSG: name`.
    pub text: String,
}

/// Where definitions are looked for.
#[derive(Debug)]
pub struct DefinitionSources {
    /// Folders of packages, best first.
    folders: Vec<PathBuf>,
    compiled: BTreeMap<&'static str, &'static str>,
}

impl Default for DefinitionSources {
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
        Self::with_folders(folders)
    }
}

impl DefinitionSources {
    fn with_folders(folders: Vec<PathBuf>) -> Self {
        let parts = COMPILED.split(">>> ").filter_map(|part| part.split_once('\n'));
        Self { folders, compiled: parts.collect() }
    }

    /// The message type of that name; none if it, or one that it needs, is nowhere or cannot be read.
    pub fn message(&self, name: &str) -> Option<MessageDefinition> {
        let (own, source) = (self.source("msg", name)?, |needed: &str| self.source("msg", needed));
        let kind = MessageType::load(name, &own, &source).ok()?;
        let text = kind.full_text_from(&own, &source);
        Some(MessageDefinition { kind, text })
    }

    /// The service type of that name.
    pub fn service(&self, name: &str) -> Option<ServiceType> {
        ServiceType::load(name, &self.source("srv", name)?, &|needed| self.source("msg", needed)).ok()
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use rosrust::{Message, ServicePair};

    /// Without any package on the machine.
    fn compiled() -> DefinitionSources {
        DefinitionSources::with_folders(vec![])
    }

    #[test]
    fn checksums_are_those_of_the_compiled_types() {
        use crate::messages::{diagnostic_msgs, gazebo_msgs, proact_msgs, sensor_msgs, visualization_msgs};
        fn check<M: Message>() {
            let found = compiled().message(&M::msg_type()).unwrap();
            assert_eq!(found.kind.md5(), M::md5sum(), "{}", found.kind.name);
            // What other nodes make of the text is the same type.
            let again = MessageType::from_text(&found.kind.name, &found.text).unwrap();
            assert_eq!(again, found.kind);
        }
        check::<diagnostic_msgs::DiagnosticArray>();
        check::<gazebo_msgs::ModelStates>();
        check::<proact_msgs::Frame>();
        check::<sensor_msgs::JointState>();
        check::<visualization_msgs::MarkerArray>();
        fn serve<S: ServicePair>() {
            let found = compiled().service(&S::msg_type()).unwrap();
            assert_eq!(found.md5(), S::md5sum(), "{}", found.name);
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
        let found =
            DefinitionSources::with_folders(vec![folder.join("src")]).message("lab_msgs/Dose").unwrap();
        assert!(found.text.contains("MSG: std_msgs/Header\n"), "{}", found.text);
        // By genmsg, for the same file.
        assert_eq!(found.kind.md5(), "136e9e3d26e764c419656eec175a6928");
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_name_that_leads_elsewhere_or_nowhere_is_none() {
        for name in ["std_msgs/../../x", "String", "std_msgs/Nothing", "/String", "std_msgs/"] {
            assert_eq!(compiled().message(name), None, "{name}");
        }
    }
}
