//! An arm as a folder: URDF, SRDF, meshes, and `arm.toml`.

use crate::{DescriptionError, MeshFolders, TriangleMesh, parse, parse_urdf, read_text, settings};
use proact_arm::{ArmModel, VisualGeometry};
use rust_embed::RustEmbed;
use std::{
    borrow::Cow,
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::{Path, PathBuf},
};

/// The folders of the arms that ship with the program.
#[derive(RustEmbed)]
#[folder = "../../ros1_ws/src/proact_description/arms/"]
struct EmbeddedArms;

/// The package that these folders belong to, as mesh addresses have it.
const PACKAGE_URI: &str = "package://proact_description/arms/";
/// What says how the arm is shown and driven.
pub(crate) const SETTINGS_FILE: &str = "arm.toml";
/// Largest mesh file, bytes: far above what a page draws at once.
const MAX_MESH_BYTES: u64 = 64 << 20;
/// How far up a ROS package may begin above an arm's folder.
const PACKAGE_DEPTH: usize = 4;

/// The files of an arm, in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ArmFolder {
    /// By which the arm is found: the folder's name.
    pub name: String,
    /// Text of the URDF file.
    pub urdf: String,
    /// Text of the SRDF file, if there is one.
    pub srdf: Option<String>,
    /// Text of `arm.toml`, if there is one.
    pub settings: Option<String>,
    /// Mesh files by the addresses that the URDF gives.
    pub meshes: BTreeMap<String, Cow<'static, [u8]>>,
}

/// Why a folder is no arm.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FolderError {
    /// No description, or several.
    #[error("{} has {count} files *.{extension}, expected {expected}", folder.display())]
    Files {
        /// The folder.
        folder: PathBuf,
        /// `urdf` or `srdf`.
        extension: &'static str,
        /// How many there are.
        count: usize,
        /// How many there may be.
        expected: &'static str,
    },
    /// A mesh that the description names is not there.
    #[error(
        "{}: link {link} has the mesh {file}, which is not {}", folder.display(), expected_place(folder, expected)
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
    /// A file that cannot be read.
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

impl ArmFolder {
    /// Names of the arms that ship with the program.
    pub fn shipped_names() -> Vec<String> {
        let settings = EmbeddedArms::iter();
        settings
            .filter_map(|file| Some(file.strip_suffix(&format!("/{SETTINGS_FILE}"))?.to_owned()))
            .collect()
    }

    /// The arm of those that ship with the program that is called `name`, now or formerly.
    pub fn shipped(name: &str) -> Option<Self> {
        let mut names = Self::shipped_names().into_iter();
        let name = names.find(|own| own == name || aliases(own).iter().any(|alias| alias == name))?;
        let text = |file: &str| {
            let bytes = EmbeddedArms::get(&format!("{name}/{file}"))?.data.into_owned();
            String::from_utf8(bytes).ok()
        };
        let (urdf, srdf, settings) = (text("arm.urdf")?, text("arm.srdf"), text(SETTINGS_FILE));
        let mut folder = Self { name: name.clone(), urdf, srdf, settings, meshes: BTreeMap::new() };
        let addresses = folder.model().ok().map(|model| mesh_uris(&model)).unwrap_or_default();
        for address in addresses.into_keys() {
            let path = address.strip_prefix(PACKAGE_URI)?;
            folder.meshes.insert(address.clone(), EmbeddedArms::get(path)?.data);
        }
        Some(folder)
    }

    /// The arm in the folder at `path`.
    ///
    /// # Errors
    /// [`FolderError`]: not one description, one that cannot be used, a mesh that is missing.
    pub fn read(path: &Path) -> Result<Self, FolderError> {
        let (urdf, srdf) = arm_files(path)?;
        let settings = path.join(SETTINGS_FILE);
        let text = |path: &Path| {
            read_text(path).map_err(|source| FolderError::Description { path: path.to_owned(), source })
        };
        // A folder may be given as `.`.
        let whole = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let name = whole.file_name().unwrap_or(whole.as_os_str()).to_string_lossy().into_owned();
        let mut folder = Self {
            name,
            urdf: text(&urdf)?,
            srdf: srdf.as_deref().map(text).transpose()?,
            settings: settings.is_file().then(|| text(&settings)).transpose()?,
            meshes: BTreeMap::new(),
        };
        let model = folder.model();
        let model = model.map_err(|source| FolderError::Description { path: path.to_owned(), source })?;
        for (address, link) in mesh_uris(&model) {
            let (bytes, _) = read_mesh(&whole, &address).map_err(|failed| match failed {
                MeshFailure::NotFound(expected) => {
                    FolderError::Mesh { folder: path.to_owned(), link, file: address.clone(), expected }
                }
                MeshFailure::File(path, source) => FolderError::File { path, source },
            })?;
            folder.meshes.insert(address, bytes.into());
        }
        Ok(folder)
    }

    /// The arm as a model.
    ///
    /// # Errors
    /// [`DescriptionError`].
    pub fn model(&self) -> Result<ArmModel, DescriptionError> {
        let mut model = match &self.srdf {
            Some(srdf) => parse(&self.urdf, srdf),
            None => parse_urdf(&self.urdf),
        }?;
        settings::apply(&mut model, self.settings.as_deref().unwrap_or_default())?;
        Ok(model)
    }

    /// Former names of the arm.
    pub fn aliases(&self) -> Vec<String> {
        self.settings.as_deref().map(settings::aliases).unwrap_or_default()
    }

    /// BLAKE3 of the content, 64 hexadecimal digits: descriptions, settings and meshes, whatever the files are called.
    pub fn hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        let mut part = |name: &str, bytes: &[u8]| {
            for bytes in [name.as_bytes(), bytes] {
                hasher.update(&(bytes.len() as u64).to_le_bytes()).update(bytes);
            }
        };
        part("urdf", self.urdf.as_bytes());
        part("srdf", self.srdf.as_deref().unwrap_or_default().as_bytes());
        part(SETTINGS_FILE, self.settings.as_deref().unwrap_or_default().as_bytes());
        self.meshes.iter().for_each(|(address, bytes)| part(address, bytes));
        hasher.finalize().to_hex().to_string()
    }
}

fn aliases(shipped: &str) -> Vec<String> {
    let file = EmbeddedArms::get(&format!("{shipped}/{SETTINGS_FILE}"));
    let text = file.and_then(|file| String::from_utf8(file.data.into_owned()).ok());
    text.as_deref().map(settings::aliases).unwrap_or_default()
}

/// Takes the meshes of `model` along into a folder of its own: finds each in `folders`, gives it the address
/// `package://NAME/meshes/FILE`, and returns the files by their names. A visual whose mesh is nowhere, or is no mesh, is left out,
/// so that its link is drawn by its collision shapes; its address is in the second list.
pub fn collect_meshes(
    model: &mut ArmModel,
    name: &str,
    folders: &MeshFolders,
) -> (BTreeMap<String, Vec<u8>>, Vec<String>) {
    let (mut files, mut missing): (BTreeMap<String, Vec<u8>>, Vec<String>) = Default::default();
    let mut moved: BTreeMap<String, String> = BTreeMap::new();
    for address in mesh_uris(model).into_keys() {
        let found = folders.read(&address).ok();
        let Some((bytes, path)) = found.filter(|(bytes, path)| TriangleMesh::parse(bytes, path).is_ok())
        else {
            missing.push(address);
            continue;
        };
        let file = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        // Of two files of one name the second goes by a number too.
        let taken = |file: &str| files.get(file).is_some_and(|other| *other != bytes);
        let numbered = (2..).map(|number| format!("{number}_{file}"));
        let free = std::iter::once(file.clone()).chain(numbered).find(|file| !taken(file)).unwrap_or(file);
        moved.insert(address, format!("package://{name}/meshes/{free}"));
        files.insert(free, bytes);
    }
    for link in &mut model.links {
        link.visuals.retain(|visual| match &visual.geometry {
            VisualGeometry::Mesh { file, .. } => moved.contains_key(file),
            VisualGeometry::Shape(_) => true,
        });
        for visual in &mut link.visuals {
            if let VisualGeometry::Mesh { file, .. } = &mut visual.geometry
                && let Some(address) = moved.get(file)
            {
                file.clone_from(address);
            }
        }
    }
    (files, missing)
}

/// The file `arm.toml` of an arm of which nothing is known but `model`: to be filled in.
pub fn settings_template(model: &ArmModel) -> String {
    let quoted = |text: &str| toml::Value::from(text).to_string();
    let mut text = format!(
        "# How the arm is shown and driven: docs/arms.md.\ntitle = {}\n# \"right\" or \"left\".\nside = \"right\"\n\
         # Arm joints that method A cycles through; empty: all that are driven, base to tip.\ncycle = []\n\n\
         # Which joints the prosthesis has, by level of limb loss; empty is every arm joint.\n[levels]\nshoulder = []\n",
        quoted(&model.name)
    );
    if let Some(stand) = &model.settings.fixed_base {
        let [x, y, z] = [stand.xyz.x, stand.xyz.y, stand.xyz.z];
        text += &format!(
            "\n# Where the base stands, `world`, metres. x is away from the person, y left, z up.\n\
             [stand]\nxyz = [{x:.3}, {y:.3}, {z:.3}]\n"
        );
    }
    for &joint in &model.arm {
        let name = quoted(&model.joints[joint].name);
        text +=
            &format!("\n[[joints]]\njoint = {name}\nname = {name}\nwe = \"+\"\nwf = \"-\"\nwe_sign = 1\n");
    }
    text
}

/// BLAKE3 of a mesh, 64 hexadecimal digits.
pub fn mesh_id(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// Addresses of the meshes of `model`, each with a link that has it.
pub fn mesh_uris(model: &ArmModel) -> BTreeMap<String, String> {
    let of_link = |link: &proact_arm::Link| {
        let name = link.name.clone();
        let file = move |visual: &proact_arm::Visual| match &visual.geometry {
            VisualGeometry::Mesh { file, .. } => Some((file.clone(), name.clone())),
            VisualGeometry::Shape(_) => None,
        };
        link.visuals.iter().filter_map(file).collect::<Vec<_>>()
    };
    model.links.iter().flat_map(of_link).collect()
}

/// Why a mesh is not read.
pub(crate) enum MeshFailure {
    /// Where it was expected.
    NotFound(PathBuf),
    /// A file that cannot be read.
    File(PathBuf, io::Error),
}

/// The mesh at `address`, for the arm in `folder`, and where it lies. `package://NAME/`, `model://NAME/` and `file://`
/// stand for the folder, or for the ROS package that the folder is in; what leads to the folder from outside may stand
/// before the rest.
pub(crate) fn read_mesh(folder: &Path, address: &str) -> Result<(Vec<u8>, PathBuf), MeshFailure> {
    let named = address.strip_prefix("package://").or_else(|| address.strip_prefix("model://"));
    let below = match named {
        Some(rest) => rest.split_once('/').map_or(rest, |(_, below)| below),
        None => address.strip_prefix("file://").unwrap_or(address),
    };
    let expected = folder.join(below);
    let package = folder.ancestors().take(PACKAGE_DEPTH).find(|above| above.join("package.xml").is_file());
    let tails = below.match_indices('/').map(|(at, _)| folder.join(&below[at + 1..]));
    let mut locations =
        [expected.clone()].into_iter().chain(package.map(|above| above.join(below))).chain(tails);
    // Nothing outside of the folder or its package is read, whatever the description names.
    let root = package.unwrap_or(folder).canonicalize().ok();
    let inside = |path: &PathBuf| {
        let whole = path.canonicalize().ok();
        path.is_file() && whole.zip(root.as_ref()).is_some_and(|(whole, root)| whole.starts_with(root))
    };
    let Some(path) = locations.find(inside) else {
        return Err(MeshFailure::NotFound(expected));
    };
    let failed = |source| MeshFailure::File(path.clone(), source);
    let length = fs::metadata(&path).map_err(failed)?.len();
    if length > MAX_MESH_BYTES {
        let source = io::Error::other(format!("it has {length} bytes, expected at most {MAX_MESH_BYTES}"));
        return Err(MeshFailure::File(path, source));
    }
    let bytes = fs::read(&path).map_err(failed)?;
    Ok((bytes, path))
}

/// The URDF file of the arm in `folder`, and its SRDF file if there is one.
///
/// # Errors
/// [`FolderError::Files`] for none or several, [`FolderError::File`] for a folder that cannot be read.
pub fn arm_files(folder: &Path) -> Result<(PathBuf, Option<PathBuf>), FolderError> {
    let (mut urdf, mut srdf) = (files_with_extension(folder, "urdf")?, files_with_extension(folder, "srdf")?);
    let wrong = |ending, count, expected| {
        Err(FolderError::Files { folder: folder.to_owned(), extension: ending, count, expected })
    };
    if urdf.len() != 1 {
        return wrong("urdf", urdf.len(), "one");
    }
    if srdf.len() > 1 {
        return wrong("srdf", srdf.len(), "one or none");
    }
    Ok((urdf.remove(0), srdf.pop()))
}

/// Files of `folder` with this ending, by name.
fn files_with_extension(folder: &Path, ending: &str) -> Result<Vec<PathBuf>, FolderError> {
    let failed = |source| FolderError::File { path: folder.to_owned(), source };
    let entries = fs::read_dir(folder).map_err(failed)?;
    let mut found = BTreeSet::new();
    for entry in entries {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_some_and(|e| e == ending) {
            found.insert(path);
        }
    }
    Ok(Vec::from_iter(found))
}

/// What there is where a file was expected.
/// Where in an arm's folder a mesh is expected. What is elsewhere is neither read nor listed.
fn expected_place(folder: &Path, expected: &Path) -> String {
    let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let parent = expected.parent().and_then(|parent| parent.canonicalize().ok());
    match parent {
        Some(parent) if !parent.starts_with(&whole) => "in the arm's folder; expected it there".to_owned(),
        _ if expected.is_file() => {
            format!("in the arm's folder: {} leads out of it; expected the file itself", expected.display())
        }
        _ => format!(
            "there; expected it at {}, where there {}",
            expected.display(),
            directory_listing(expected)
        ),
    }
}

fn directory_listing(expected: &Path) -> String {
    let folder = expected.parent().unwrap_or(Path::new("."));
    let Ok(entries) = fs::read_dir(folder) else { return "is no such folder".to_owned() };
    let mut names: Vec<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    let more = if names.len() > 8 { ", ..." } else { "" };
    names.truncate(8);
    if names.is_empty() { "is nothing".to_owned() } else { format!("is {}{more}", names.join(", ")) }
}
