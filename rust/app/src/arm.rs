//! The arm of a trial: one that ships with the program, or a lab's own from its folder.

use proact_arm::{ArmModel, VisualGeometry};
use proact_description::{
    DescriptionError, MPL_LEFT_ARM_SRDF, MPL_LEFT_ARM_URDF, MPL_RIGHT_ARM_SRDF, MPL_RIGHT_ARM_URDF, parse,
    parse_urdf, read_text,
};
use proact_testbed::{Pinned, TrialConfig};
use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    sync::Arc,
};

/// The arms that ship with the program: name, URDF, SRDF.
const SHIPPED: [(&str, &str, &str); 2] = [
    ("mpl_right_arm", MPL_RIGHT_ARM_URDF, MPL_RIGHT_ARM_SRDF),
    ("mpl_left_arm", MPL_LEFT_ARM_URDF, MPL_LEFT_ARM_SRDF),
];

/// A lab's own arm in the directory of a trial.
const URDF_FILE: &str = "arm.urdf";
const SRDF_FILE: &str = "arm.srdf";

/// Why there is no arm.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArmError {
    /// Neither an arm that ships with the program nor a folder.
    #[error("arm {got:?} is unknown; expected {}, or a folder with a URDF file", SHIPPED.map(|(name, ..)| name).join(", "))]
    Unknown {
        /// What was asked for.
        got: String,
    },
    /// A record of an arm that did not ship with the program, without its description.
    #[error(
        "the trial was made with arm {name:?}, which does not ship with this program, and its directory has no \
         {URDF_FILE}; expected {}, or that file", SHIPPED.map(|(name, ..)| name).join(", ")
    )]
    NotRecorded {
        /// The arm's name.
        name: String,
    },
    /// A folder with no description, or with several.
    #[error("{} has {count} files *.{ending}, expected {expected}", folder.display())]
    Files {
        /// The folder.
        folder: PathBuf,
        /// `urdf` or `srdf`.
        ending: &'static str,
        /// How many there are.
        count: usize,
        /// How many there may be.
        expected: &'static str,
    },
    /// A mesh that the description names is not there.
    #[error(
        "{}: link {link} has the mesh {file}, which is not there; expected it at {}, where \
         there {}", folder.display(), expected.display(), neighbours(expected)
    )]
    Mesh {
        /// The arm's folder.
        folder: PathBuf,
        /// Which link.
        link: String,
        /// As the description says.
        file: String,
        /// Where it was looked for.
        expected: PathBuf,
    },
    /// A file that cannot be read or written.
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

/// An arm, and the description that it was read from where it is a lab's own.
#[derive(Clone, Debug)]
pub struct Arm {
    model: Arc<ArmModel>,
    own: Option<Description>,
}

/// Texts of URDF and SRDF.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Description {
    urdf: String,
    srdf: Option<String>,
}

impl Arm {
    /// The arm called `name` of those that ship with the program, or else the one in the folder `name`.
    ///
    /// # Errors
    /// [`ArmError`]: no such arm, a folder that does not hold just one, a mesh that is missing.
    pub fn named(name: &str) -> Result<Self, ArmError> {
        match Self::shipped(name) {
            Some(arm) => Ok(arm),
            None if Path::new(name).is_dir() => Self::in_folder(Path::new(name)),
            None => Err(ArmError::Unknown { got: name.to_owned() }),
        }
    }

    /// The arm of a configuration, of those that ship with the program.
    ///
    /// # Errors
    /// [`ArmError::Unknown`].
    pub fn of(config: &TrialConfig) -> Result<Self, ArmError> {
        let name = &config.arm.name;
        Self::shipped(name).ok_or_else(|| ArmError::Unknown { got: name.clone() })
    }

    /// The arm of the trial that is recorded in `dir`. Whether it is the one that the trial was made with is seen when
    /// the testbed is put together.
    ///
    /// # Errors
    /// [`ArmError`].
    pub fn recorded(dir: &Path, config: &TrialConfig) -> Result<Self, ArmError> {
        let (urdf, srdf) = (dir.join(URDF_FILE), dir.join(SRDF_FILE));
        if urdf.is_file() {
            return Self::read(dir, &urdf, srdf.is_file().then_some(&*srdf));
        }
        let name = &config.arm.name;
        Self::shipped(name).ok_or_else(|| ArmError::NotRecorded { name: name.clone() })
    }

    fn shipped(name: &str) -> Option<Self> {
        let (_, urdf, srdf) = SHIPPED.iter().find(|(shipped, ..)| *shipped == name)?;
        let model = parse(urdf, srdf).expect("tests read the embedded descriptions");
        Some(Self { model: Arc::new(model), own: None })
    }

    /// The arm in `folder`.
    ///
    /// # Errors
    /// [`ArmError`]: not one description, one that cannot be used, a mesh that is missing.
    pub fn in_folder(folder: &Path) -> Result<Self, ArmError> {
        let (urdf, srdf) = arm_files(folder)?;
        let arm = Self::read(folder, &urdf, srdf.as_deref())?;
        arm.check_meshes(folder)?;
        Ok(arm)
    }

    fn read(place: &Path, urdf: &Path, srdf: Option<&Path>) -> Result<Self, ArmError> {
        let text = |path: &Path| {
            read_text(path).map_err(|source| ArmError::Description { path: path.to_owned(), source })
        };
        let own = Description { urdf: text(urdf)?, srdf: srdf.map(text).transpose()? };
        let model = match &own.srdf {
            Some(srdf) => parse(&own.urdf, srdf),
            None => parse_urdf(&own.urdf),
        };
        let model = model.map_err(|source| ArmError::Description { path: place.to_owned(), source })?;
        Ok(Self { model: Arc::new(model), own: Some(own) })
    }

    /// Every mesh must be in the folder: `package://NAME/`, `model://NAME/` and `file://` stand for it.
    fn check_meshes(&self, folder: &Path) -> Result<(), ArmError> {
        for link in &self.model.links {
            for visual in &link.visuals {
                let VisualGeometry::Mesh { file, .. } = &visual.geometry else { continue };
                let named = file.strip_prefix("package://").or_else(|| file.strip_prefix("model://"));
                let below = match named {
                    Some(rest) => rest.split_once('/').map_or(rest, |(_, below)| below),
                    None => file.strip_prefix("file://").unwrap_or(file),
                };
                let expected = folder.join(below);
                if !expected.is_file() {
                    let (folder, link, file) = (folder.to_owned(), link.name.clone(), file.clone());
                    return Err(ArmError::Mesh { folder, link, file, expected });
                }
            }
        }
        Ok(())
    }

    /// The arm.
    pub fn model(&self) -> &Arc<ArmModel> {
        &self.model
    }

    /// What a configuration calls it.
    pub fn pinned(&self) -> Pinned {
        Pinned::named(&self.model.name)
    }

    /// The description of a lab's own arm, as the files of a trial that [`Arm::recorded`] reads.
    pub fn files(&self) -> BTreeMap<String, Vec<u8>> {
        let Some(own) = &self.own else { return BTreeMap::new() };
        let srdf = own.srdf.iter().map(|srdf| (SRDF_FILE, srdf));
        let files = [(URDF_FILE, &own.urdf)].into_iter().chain(srdf);
        files.map(|(name, text)| (name.to_owned(), text.clone().into_bytes())).collect()
    }
}

/// The URDF file of a lab's own arm in `folder`, and its SRDF file if there is one.
///
/// # Errors
/// [`ArmError::Files`] for none or several, [`ArmError::File`] for a folder that cannot be read.
pub fn arm_files(folder: &Path) -> Result<(PathBuf, Option<PathBuf>), ArmError> {
    let (mut urdf, mut srdf) = (files(folder, "urdf")?, files(folder, "srdf")?);
    let wrong =
        |ending, count, expected| Err(ArmError::Files { folder: folder.to_owned(), ending, count, expected });
    if urdf.len() != 1 {
        return wrong("urdf", urdf.len(), "one");
    }
    if srdf.len() > 1 {
        return wrong("srdf", srdf.len(), "one or none");
    }
    Ok((urdf.remove(0), srdf.pop()))
}

/// Files of `folder` with this ending, by name.
fn files(folder: &Path, ending: &str) -> Result<Vec<PathBuf>, ArmError> {
    let failed = |source| ArmError::File { path: folder.to_owned(), source };
    let entries = fs::read_dir(folder).map_err(failed)?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_some_and(|e| e == ending) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// What there is where a file was expected.
fn neighbours(expected: &Path) -> String {
    let folder = expected.parent().unwrap_or(Path::new("."));
    let Ok(entries) = fs::read_dir(folder) else { return "is no such folder".to_owned() };
    let mut names: Vec<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    let more = if names.len() > 8 { ", ..." } else { "" };
    names.truncate(8);
    if names.is_empty() { "is nothing".to_owned() } else { format!("is {}{more}", names.join(", ")) }
}
