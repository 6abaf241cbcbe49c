//! Mesh files of a description: where they may lie, and their triangles.

use super::parts::RobotParts;
use mesh_loader::Loader;
use nalgebra::Point3;
use proact_arm::VisualGeometry;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

/// Largest mesh file, bytes.
const MAX_MESH_BYTES: u64 = 64 << 20;
/// How far above the description a ROS package may begin.
const PACKAGE_DEPTH: usize = 4;

/// The triangles of a mesh file, metres, as the file has them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Corners.
    pub points: Vec<Point3<f64>>,
    /// Three corners each.
    pub triangles: Vec<[usize; 3]>,
}

/// Where the mesh files of a description may lie: in its own folders, and in packages.
#[derive(Clone, Debug, Default)]
pub struct MeshFolders {
    /// The description's own folder, then what it is part of: its package, or the folder above.
    own: Vec<PathBuf>,
    /// Folders that contain packages.
    packages: Vec<PathBuf>,
    /// Those of them that were named, and do not merely lie beside the description.
    given: Vec<PathBuf>,
}

/// Why a mesh is not used, one clause.
type Refusal = String;

impl MeshFolders {
    /// For the description in `file`: its own folder, its ROS package or the folder above if that has a folder of meshes, and packages
    /// in the folders of `packages`, such as those of `ROS_PACKAGE_PATH`.
    pub fn of(file: &Path, packages: impl IntoIterator<Item = PathBuf>) -> Self {
        let whole = file.canonicalize().unwrap_or_else(|_| file.to_owned());
        let above: Vec<&Path> = whole.ancestors().skip(1).take(PACKAGE_DEPTH).collect();
        let package = above.iter().position(|folder| folder.join("package.xml").is_file());
        let has_meshes = |folder: &&Path| ["meshes", "mesh"].iter().any(|name| folder.join(name).is_dir());
        let depth = package.unwrap_or_else(|| usize::from(above.get(1).is_some_and(has_meshes)));
        let own: Vec<PathBuf> = above.iter().take(depth + 1).map(|path| (*path).to_owned()).collect();
        // Beside a package lie others, and a package may be given by its own folder.
        let beside = own.last().and_then(|folder| folder.parent()).map(Path::to_owned);
        let given: Vec<PathBuf> =
            packages.into_iter().filter_map(|folder| folder.canonicalize().ok()).collect();
        let beside = beside.filter(|_| package.is_some());
        Self { packages: given.iter().cloned().chain(beside).collect(), own, given }
    }

    /// As [`MeshFolders::of`], with the folders of `packages` and those of `ROS_PACKAGE_PATH`.
    pub fn with_ros_packages(file: &Path, packages: &[PathBuf]) -> Self {
        let ros = std::env::var_os("ROS_PACKAGE_PATH").unwrap_or_default();
        let all = packages.iter().cloned().chain(std::env::split_paths(&ros));
        Self::of(file, all.filter(|path| !path.as_os_str().is_empty()))
    }

    /// The bytes of the mesh at `address`, and its file.
    ///
    /// # Errors
    /// Why it cannot be read, one clause: nothing is read but mesh files within the folders.
    pub fn read(&self, address: &str) -> Result<(Vec<u8>, PathBuf), Refusal> {
        let path = self.find(address)?;
        let failed = |error: std::io::Error| format!("{}: {error}", path.display());
        let length = fs::metadata(&path).map_err(failed)?.len();
        if length > MAX_MESH_BYTES {
            return Err(format!("{} has {length} bytes, expected at most {MAX_MESH_BYTES}", path.display()));
        }
        Ok((fs::read(&path).map_err(failed)?, path))
    }

    fn find(&self, address: &str) -> Result<PathBuf, Refusal> {
        let named = address.strip_prefix("package://").or_else(|| address.strip_prefix("model://"));
        // Files, each with the folder that it must be in.
        let mut candidates: Vec<(PathBuf, PathBuf)> = Vec::new();
        let below = match named {
            Some(rest) => {
                let (package, below) = rest.split_once('/').unwrap_or(("", rest));
                let roots = self.packages.iter().map(|folder| folder.join(package));
                let itself = self.packages.iter().filter(|folder| folder.ends_with(package)).cloned();
                candidates.extend(roots.chain(itself).map(|root| (root.join(below), root)));
                below
            }
            None => address.strip_prefix("file://").unwrap_or(address),
        };
        // Then beside the description, also without the folders that led to it.
        let tails = below.match_indices('/').map(|(at, _)| &below[at + 1..]);
        let tails = std::iter::once(below).chain(tails).filter(|tail| !tail.is_empty());
        let own = self.own.last().cloned().unwrap_or_default();
        let beside = tails.flat_map(|tail| self.own.iter().map(move |folder| folder.join(tail)));
        candidates.extend(beside.map(|path| (path, own.clone())));
        // A path that leads out of the description is read where it ends in a folder that was named.
        if let (None, Some(folder)) = (named, self.own.first()) {
            candidates.extend(self.given.iter().map(|package| (folder.join(below), package.clone())));
        }
        let mut outside = None;
        for (path, root) in candidates {
            let Some(whole) = path.canonicalize().ok().filter(|path| path.is_file()) else { continue };
            if root.canonicalize().is_ok_and(|root| whole.starts_with(root)) {
                return Ok(whole);
            }
            outside = outside.or(Some(whole));
        }
        Err(match (outside, self.own.first()) {
            (Some(path), _) => format!("{} is outside of the folders of the description", path.display()),
            (None, Some(folder)) => format!("no such file in {} or its package", folder.display()),
            (None, None) => "no folder is known in which it could be".to_owned(),
        })
    }
}

/// A COLLADA text in metres: the loader applies the unit to corners and not to the places of nodes. Returns the unit, metres.
fn without_unit(bytes: &[u8]) -> (Vec<u8>, f64) {
    let text = String::from_utf8_lossy(bytes);
    let unit = text.find("<unit").and_then(|at| {
        let element = at..at + text[at..].find('>')?;
        let value = text[element.clone()].find("meter=").map(|own| element.start + own + "meter=".len())?;
        let quote = text[value..].chars().next().filter(|quote| "\"'".contains(*quote))?;
        let end = text[value + 1..element.end].find(quote)? + value + 1;
        Some((value + 1..end, crate::srdf::number(&text[value + 1..end]).filter(|unit| *unit > 0.0)?))
    });
    match unit {
        Some((range, unit)) => {
            (format!("{}1{}", &text[..range.start], &text[range.end..]).into_bytes(), unit)
        }
        None => (bytes.to_vec(), 1.0),
    }
}

impl TriangleMesh {
    /// Reads STL, OBJ or COLLADA, by what the bytes are; `name` is the file's, whose ending decides in doubt.
    ///
    /// # Errors
    /// Why it is no mesh, one clause.
    pub fn parse(bytes: &[u8], name: &Path) -> Result<Self, Refusal> {
        let loader = Loader::default();
        let ending =
            name.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
        // Other files of a material are not read.
        let mut unit = 1.0;
        let scene = match ending.as_str() {
            "dae" => {
                let (bytes, meters) = without_unit(bytes);
                unit = meters;
                loader.load_collada_from_slice(&bytes, name)
            }
            "obj" => loader.load_obj_from_slice_with_reader(bytes, name, |_| Ok(Vec::new())),
            "stl" => loader.load_stl_from_slice(bytes, name),
            _ => {
                return Err(format!(
                    "{:?} is no kind of mesh that can be read, expected .stl, .obj or .dae",
                    name.file_name().unwrap_or_default()
                ));
            }
        };
        let scene = scene.map_err(|error| format!("not a mesh: {error}"))?;
        let mut mesh = Self::default();
        for part in scene.meshes {
            let first = mesh.points.len();
            mesh.points.extend(part.vertices.iter().map(|v| Point3::from(v.map(|v| unit * f64::from(v)))));
            mesh.triangles.extend(part.faces.iter().map(|face| face.map(|corner| first + corner as usize)));
        }
        let valid = |triangle: &[usize; 3]| triangle.iter().all(|&corner| corner < mesh.points.len());
        if mesh.triangles.is_empty() || !mesh.triangles.iter().all(valid) {
            return Err("it has no triangles".to_owned());
        }
        if mesh.points.iter().any(|point| point.iter().any(|v| !v.is_finite())) {
            return Err("a corner is not finite".to_owned());
        }
        Ok(mesh)
    }

    /// The volume inside, m^3, where the surface is closed: the sum of the signed volumes towards the origin.
    pub fn volume(&self) -> f64 {
        let corners = |t: &[usize; 3]| t.map(|corner| self.points[corner].coords);
        self.triangles.iter().map(corners).map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0).sum::<f64>().abs()
    }
}

/// The meshes that the collision shapes of `parts` name, by address; those that cannot be used, with the reason.
pub(crate) fn load_collision_meshes(
    parts: &RobotParts,
    folders: &MeshFolders,
) -> BTreeMap<String, Result<TriangleMesh, Refusal>> {
    let geometries = parts.links.iter().flat_map(|link| {
        let visuals = link.visuals.iter().map(|visual| &visual.geometry);
        link.collisions.iter().map(|collision| &collision.geometry).chain(visuals)
    });
    let mut meshes = BTreeMap::new();
    for geometry in geometries {
        if let VisualGeometry::Mesh { file, .. } = geometry
            && !meshes.contains_key(file)
        {
            let mesh = folders.read(file).and_then(|(bytes, path)| TriangleMesh::parse(&bytes, &path));
            meshes.insert(file.clone(), mesh);
        }
    }
    meshes
}
