//! Imports only go down. Each folder of `src` is a crate but `cli`, which belongs to the program, so
//! the compiler knows no crate that its manifest does not name. The table below has the allowed order:
//! a manifest that names a crate of the same floor or of one above fails here.

use std::fs;
use std::path::Path;

const FLOORS: &[&[&str]] = &[
    &["base", "kinematics"],
    &["clip", "mujoco", "linalg", "plot"],
    &["robot", "net"],
    &["dataset", "render", "gpu"],
    &["explore"],
    &["rollout"],
    &["train", "take"],
    &["studio", "shard"],
    &["cli"],
];

fn floor(name: &str) -> usize {
    FLOORS.iter().position(|f| f.contains(&name)).unwrap_or_else(|| panic!("{name} has no floor"))
}

#[test]
fn imports_only_go_down() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut wrong = Vec::new();
    for entry in fs::read_dir(&src).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if !path.is_dir() || name == "cli" {
            continue;
        }
        let manifest = fs::read_to_string(path.join("Cargo.toml")).unwrap();
        let manifest: toml::Table = manifest.parse().unwrap();
        for table in ["dependencies", "dev-dependencies", "build-dependencies"] {
            let named = manifest.get(table).and_then(toml::Value::as_table).into_iter().flatten();
            for (other, _) in named.filter_map(|(k, v)| Some((k.strip_prefix("robert-")?, v))) {
                if floor(other) >= floor(&name) {
                    wrong.push(format!("src/{name}/Cargo.toml: {name} uses {other}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "imports that climb:\n{}", wrong.join("\n"));
}

/// All Rust files under a folder, in order.
pub(super) fn walk(dir: &Path) -> Vec<std::path::PathBuf> {
    let mut found = files(dir);
    found.retain(|p| p.extension().is_some_and(|e| e == "rs"));
    found
}

/// All files of a name under a folder, in order.
pub(super) fn walk_named(dir: &Path, name: &str) -> Vec<std::path::PathBuf> {
    let mut found = files(dir);
    found.retain(|p| p.file_name().is_some_and(|n| n == name));
    found
}

/// All files under a folder, in order; links to folders (embedded assets) are not followed.
pub(super) fn files(dir: &Path) -> Vec<std::path::PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(dir).unwrap() {
        let entry = entry.unwrap();
        if entry.file_type().unwrap().is_dir() {
            found.extend(files(&entry.path()));
        } else {
            found.push(entry.path());
        }
    }
    found.sort();
    found
}

#[test]
fn unsafe_lives_in_three_places() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let allowed = [src.join("mujoco"), src.join("linalg/amx.rs"), src.join("gpu/trusted.rs")];
    for path in walk(&src) {
        if allowed.iter().any(|a| path.starts_with(a)) {
            continue;
        }
        let text = fs::read_to_string(&path).unwrap();
        let found = text.lines().any(|l| {
            let code = l.split("//").next().unwrap_or_default();
            code.contains("unsafe {") || code.contains("unsafe fn") || code.contains("unsafe_code")
        });
        assert!(!found, "unsafe in {}", path.display());
    }
}
