//! The folders of the ROS packages that the meshes of a URDF lie in.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use roxmltree::Document;

/// How many folders above its file a package may begin: `NAME/urdf/arms/arm.urdf` is three below.
const LEVELS: usize = 4;
/// How many folders above its file an error message looks for a package.
const HINT_LEVELS: usize = 8;

/// The parts of a mesh reference: its package, and the file in the package. The package has no name
/// in `package:///arm.stl` and `package://arm.stl`, which some tools write for files beside the URDF.
pub(super) fn split(reference: &str) -> Option<(&str, &str)> {
    let rest =
        reference.strip_prefix("package://").or_else(|| reference.strip_prefix("model://"))?;
    Some(rest.split_once('/').unwrap_or(("", rest)))
}

/// Finds the folders of packages that are not in `given`: a folder of the package's name that has a
/// mesh which the URDF at `path` takes from the package, or any folder above that has all of them.
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

/// The folder of a package: one of its name above `path` or beside a folder there that has all files,
/// any folder above that has all, or one of its name that has some.
fn folder(path: &Path, package: &str, files: &[&str]) -> Option<PathBuf> {
    if !is_plain(package) || !files.iter().all(|f| is_plain(f)) {
        return None;
    }
    let count = |dir: &PathBuf| files.iter().filter(|f| dir.join(f).is_file()).count();
    let all = |dir: &PathBuf| count(dir) == files.len();
    called(path, package, LEVELS)
        .find(all)
        .or_else(|| above(path, LEVELS).map(Path::to_owned).find(all))
        .or_else(|| called(path, package, LEVELS).find(|dir| count(dir) > 0))
}

/// The folders above a file, nearest first, without the root of the disk.
fn above(path: &Path, levels: usize) -> impl Iterator<Item = &Path> {
    path.ancestors().skip(1).take(levels).filter(|d| d.parent().is_some())
}

/// The folders of a package's name that contain a file or lie beside a folder that does.
fn called<'a>(
    path: &'a Path,
    package: &'a str,
    levels: usize,
) -> impl Iterator<Item = PathBuf> + 'a {
    above(path, levels).flat_map(move |dir| {
        let own = dir.file_name().is_some_and(|n| n == package).then(|| dir.to_owned());
        own.into_iter().chain(Some(dir.join(package)).filter(|d| d.is_dir()))
    })
}

/// Only plain names, so that a file cannot point at what lies elsewhere.
fn is_plain(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    !name.is_empty() && parts.all(|part| matches!(part, Component::Normal(_)))
}

/// A folder that may be a package, for the error message.
pub(super) struct Guess {
    pub(super) folder: PathBuf,
    /// Whether it has the file that is looked for.
    pub(super) has_file: bool,
}

/// A folder of the package's name beside the URDF or above it, if there is one with the file `below`.
pub(super) fn guess(path: &Path, package: &str, below: &str) -> Option<Guess> {
    if !is_plain(package) || !is_plain(below) {
        return None;
    }
    let full = std::path::absolute(path).ok()?;
    let folders = called(&full, package, HINT_LEVELS);
    let guesses = folders.map(|folder| Guess { has_file: folder.join(below).is_file(), folder });
    let mut first = None;
    for guess in guesses {
        if guess.has_file {
            return Some(guess);
        }
        first = first.or(Some(guess));
    }
    first
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_with_the_file_is_the_better_guess() {
        let dir = tempfile::tempdir().unwrap();
        let near = dir.path().join("arm/urdf/arm");
        std::fs::create_dir_all(&near).unwrap();
        std::fs::write(dir.path().join("arm/a.stl"), "").unwrap();
        std::fs::write(dir.path().join("b.stl"), "").unwrap();
        let path = dir.path().join("arm/urdf/arm.urdf");
        let said = |package, below| guess(&path, package, below).map(|g| (g.folder, g.has_file));
        assert_eq!(said("arm", "a.stl"), Some((dir.path().join("arm"), true)));
        assert_eq!(said("arm", "c.stl"), Some((near, false)));
        assert_eq!(said("leg", "a.stl"), None);
        assert_eq!(said("arm", "../b.stl"), None, "what lies elsewhere is not looked for");
    }
}
