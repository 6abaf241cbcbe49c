//! The arm of a trial: one that ships with the program, or a lab's own from its folder.

use proact_arm::ArmModel;
use proact_bridge::MeshFile;
use proact_description::{ArmFolder, DescriptionError, FolderError, mesh_uris, read_text};
use proact_testbed::{PinnedContent, TrialConfig};
use std::{
    borrow::Cow,
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    sync::Arc,
};

/// A lab's own arm in the directory of a trial.
const URDF_FILE: &str = "arm.urdf";
const SRDF_FILE: &str = "arm.srdf";
const SETTINGS_FILE: &str = "arm.toml";
/// Its meshes there, numbered in the order of their addresses: a trial's directory has no folders in it.
const MESH_FILE: &str = "arm.mesh.";

/// Poses that every trial needs: group, name.
const REQUIRED_POSES: [(&str, &str); 3] = [("arm", "start"), ("hand", "open"), ("hand", "closed")];

/// Why there is no arm.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArmError {
    /// Neither an arm that ships with the program nor a folder.
    #[error("arm {got:?} is unknown; expected {}, or a folder with a URDF file", shipped_names())]
    Unknown {
        /// What was asked for.
        got: String,
    },
    /// A record of an arm that did not ship with the program, without its description.
    #[error(
        "the trial was made with arm {name:?}, which does not ship with this program, and its directory has no \
         {URDF_FILE}; expected {}, or that file",
        shipped_names()
    )]
    NotRecorded {
        /// The arm's name.
        name: String,
    },
    /// The folder.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// A pose that a trial needs is not in the description.
    #[error(
        "arm {arm:?} has no pose {pose:?} of the {group}; expected <group_state name=\"{pose}\"> for that group in its \
         SRDF file, beside: {known}"
    )]
    Pose {
        /// The arm.
        arm: String,
        /// Name of the pose.
        pose: &'static str,
        /// `arm` or `hand`.
        group: &'static str,
        /// Poses that there are.
        known: String,
    },
    /// A file of a record that cannot be read.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A description that cannot be used.
    #[error("{}: {source}", path.display())]
    Description {
        /// The folder or file.
        path: PathBuf,
        /// Why.
        source: DescriptionError,
    },
}

/// The names there are, for errors.
fn shipped_names() -> String {
    ArmFolder::shipped_names().join(", ")
}

/// An arm and the folder that it was read from.
#[derive(Clone, Debug)]
pub struct Arm {
    model: Arc<ArmModel>,
    folder: Arc<ArmFolder>,
    hash: String,
    /// It ships with the program.
    shipped: bool,
}

impl Arm {
    /// The arm called `name` of those that ship with the program, or else the one in the folder `name`.
    ///
    /// # Errors
    /// [`ArmError`]: no such arm, a folder that does not hold just one, a mesh or a pose that is missing.
    pub fn load(name: &str) -> Result<Self, ArmError> {
        match Self::load_shipped(name)? {
            Some(arm) => Ok(arm),
            None if Path::new(name).is_dir() => Self::in_folder(Path::new(name)),
            None => Err(ArmError::Unknown { got: name.to_owned() }),
        }
    }

    /// The arm of a configuration, of those that ship with the program.
    ///
    /// # Errors
    /// [`ArmError::Unknown`].
    pub fn from_config(config: &TrialConfig) -> Result<Self, ArmError> {
        let name = &config.arm.name;
        Self::load_shipped(name)?.ok_or_else(|| ArmError::Unknown { got: name.clone() })
    }

    /// The arm of the trial that is recorded in `dir`. Whether it is the one that the trial was made with is seen when
    /// the testbed is put together.
    ///
    /// # Errors
    /// [`ArmError`].
    pub fn from_record(dir: &Path, config: &TrialConfig) -> Result<Self, ArmError> {
        let name = &config.arm.name;
        if !dir.join(URDF_FILE).is_file() {
            return Self::load_shipped(name)?.ok_or_else(|| ArmError::NotRecorded { name: name.clone() });
        }
        let text = |file: &str| {
            let path = dir.join(file);
            read_text(&path).map_err(|source| ArmError::Description { path, source })
        };
        let optional = |file: &str| dir.join(file).is_file().then(|| text(file)).transpose();
        let mut folder = ArmFolder {
            name: name.clone(),
            urdf: text(URDF_FILE)?,
            srdf: optional(SRDF_FILE)?,
            settings: optional(SETTINGS_FILE)?,
            meshes: BTreeMap::new(),
        };
        let model = folder.model();
        let model = model.map_err(|source| ArmError::Description { path: dir.to_owned(), source })?;
        for (number, address) in mesh_uris(&model).into_keys().enumerate() {
            let path = dir.join(format!("{MESH_FILE}{number}"));
            let bytes = fs::read(&path).map_err(|source| ArmError::File { path, source })?;
            folder.meshes.insert(address, Cow::Owned(bytes));
        }
        Self::from_folder(folder, dir, false)
    }

    fn load_shipped(name: &str) -> Result<Option<Self>, ArmError> {
        let folder = ArmFolder::shipped(name);
        folder.map(|folder| Self::from_folder(folder, Path::new(name), true)).transpose()
    }

    /// The arm in `folder`.
    ///
    /// # Errors
    /// [`ArmError`]: not one description, one that cannot be used, a mesh or a pose that is missing.
    pub fn in_folder(folder: &Path) -> Result<Self, ArmError> {
        Self::from_folder(ArmFolder::read(folder)?, folder, false)
    }

    /// The arm of the files in `folder`, which were read from `path`.
    ///
    /// # Errors
    /// As [`Arm::in_folder`].
    pub fn from_folder(folder: ArmFolder, path: &Path, shipped: bool) -> Result<Self, ArmError> {
        let model = folder.model();
        let model = model.map_err(|source| ArmError::Description { path: path.to_owned(), source })?;
        for (group, pose) in REQUIRED_POSES {
            if model.pose(group, pose).is_err() {
                let names: Vec<String> =
                    model.poses.iter().map(|pose| format!("{} ({})", pose.name, pose.group)).collect();
                let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
                return Err(ArmError::Pose { arm: folder.name, pose, group, known });
            }
        }
        let hash = folder.hash();
        Ok(Self { model: Arc::new(model), folder: Arc::new(folder), hash, shipped })
    }

    /// The arm.
    pub fn model(&self) -> &Arc<ArmModel> {
        &self.model
    }

    /// Its files.
    pub fn folder(&self) -> &Arc<ArmFolder> {
        &self.folder
    }

    /// What a configuration calls it, with the hash of its folder.
    pub fn pinned(&self) -> PinnedContent {
        PinnedContent { name: self.folder.name.clone(), hash: Some(self.hash.clone()) }
    }

    /// Writes the arm's present name over a former one in `config`.
    pub(crate) fn write_current_name(&self, config: &mut TrialConfig) {
        if self.shipped && self.folder.aliases().contains(&config.arm.name) {
            config.arm.name.clone_from(&self.folder.name);
        }
    }

    /// What the page draws it with.
    pub fn meshes(&self) -> Vec<MeshFile> {
        let file = |(address, bytes): (&String, &Cow<'_, [u8]>)| MeshFile {
            address: address.clone(),
            id: proact_description::mesh_id(bytes),
            bytes: Arc::from(bytes.as_ref()),
        };
        self.folder.meshes.iter().map(file).collect()
    }

    /// The folder of a lab's own arm, as the files of a trial that [`Arm::recorded`] reads.
    pub fn files(&self) -> BTreeMap<String, Vec<u8>> {
        let ArmFolder { urdf, srdf, settings, meshes, .. } = &*self.folder;
        if self.shipped {
            return BTreeMap::new();
        }
        let texts = [(URDF_FILE, Some(urdf)), (SRDF_FILE, srdf.as_ref()), (SETTINGS_FILE, settings.as_ref())];
        let texts =
            texts.into_iter().filter_map(|(name, text)| Some((name.to_owned(), text?.clone().into_bytes())));
        let number =
            |(number, bytes): (usize, &Cow<'_, [u8]>)| (format!("{MESH_FILE}{number}"), bytes.to_vec());
        texts.chain(meshes.values().enumerate().map(number)).collect()
    }
}
