//! The folders of the ROS packages that the meshes of a URDF lie in.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use roxmltree::Document;

/// How many folders above its file a package may begin: `NAME/urdf/arms/arm.urdf` is three below.
const LEVELS: usize = 4;

/// The parts of a mesh reference: its package, and the file in the package. The package has no name
/// in `package:///arm.stl`, which some tools write for files beside the URDF.
pub(super) fn split(reference: &str) -> Option<(&str, &str)> {
    let rest =
        reference.strip_prefix("package://").or_else(|| reference.strip_prefix("model://"))?;
    Some(rest.split_once('/').unwrap_or((rest, "")))
}

/// Finds the folders of packages that are not in `given`, by name: the folder must contain every
/// mesh that the URDF at `path` takes from the package.
pub(super) fn find(
    doc: &Document<'_>,
    path: &Path,
    given: &BTreeMap<String, PathBuf>,
) -> BTreeMap<String, PathBuf> {
    let mut wanted: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for mesh in doc.descendants().filter(|n| n.has_tag_name("mesh")) {
        if let Some((package, below)) = mesh.attribute("filename").and_then(split)
            && !given.contains_key(package)
        {
            wanted.entry(package).or_default().push(below);
        }
    }
    let Ok(full) = std::path::absolute(path) else { return BTreeMap::new() };
    wanted
        .into_iter()
        .filter_map(|(package, files)| Some((package.to_owned(), folder(&full, package, &files)?)))
        .collect()
}

/// A folder above `path` that has the package's name or contains a folder of that name. If there is
/// none, a folder that has the files under another name.
fn folder(path: &Path, package: &str, files: &[&str]) -> Option<PathBuf> {
    // Only plain names, so that a file cannot point at what lies elsewhere.
    let plain = |s: &str| {
        !s.is_empty() && Path::new(s).components().all(|c| matches!(c, Component::Normal(_)))
    };
    if !plain(package) || !files.iter().all(|f| plain(f)) {
        return None;
    }
    let above = || path.ancestors().skip(1).take(LEVELS).filter(|d| d.parent().is_some());
    let has = |dir: &PathBuf| files.iter().all(|f| dir.join(f).is_file());
    let called = above()
        .filter(|d| d.file_name().is_some_and(|n| n == package))
        .map(Path::to_owned)
        .chain(above().map(|d| d.join(package)))
        .find(has);
    called.or_else(|| above().map(Path::to_owned).find(has))
}

/// A folder of the package's name beside the URDF or above it, whatever it contains. It is only a
/// hint for the error message.
pub(super) fn guess(path: &Path, package: &str, below: &str) -> Option<(PathBuf, bool)> {
    let full = std::path::absolute(path).ok()?;
    let folders = full.ancestors().skip(1).take(8).flat_map(|dir| {
        let own = dir.file_name().is_some_and(|n| n == package).then(|| dir.to_owned());
        own.into_iter().chain(Some(dir.join(package)).filter(|d| d.is_dir()))
    });
    let all: Vec<PathBuf> = folders.collect();
    let holds = all.iter().find(|dir| dir.join(below).is_file()).cloned();
    holds.map(|dir| (dir, true)).or_else(|| all.first().map(|dir| (dir.clone(), false)))
}
