//! Imports only go down. The table below is the house plan; a `use crate::x` (or a path
//! `crate::x::`) that climbs, or that crosses a floor without being listed, fails here.

use std::fs;
use std::path::Path;

const FLOORS: &[&[&str]] = &[
    &["clip", "units", "rng", "limits", "exit", "fsio", "progress", "xml", "child"],
    &["mujoco", "robot", "linalg", "plot"],
    &["dataset", "net", "explore"],
    &["train", "rollout", "render"],
    &["take"],
    &["studio", "cli"],
];

/// The few edges inside a floor.
const LEVEL: &[(&str, &str)] = &[
    ("clip", "units"),
    ("clip", "rng"),
    ("clip", "limits"),
    ("clip", "exit"),
    ("clip", "fsio"),
    ("child", "exit"),
    ("clip", "xml"),
    ("fsio", "exit"),
    ("xml", "limits"),
    ("robot", "mujoco"),
    ("explore", "dataset"),
    ("train", "rollout"),
    ("cli", "studio"),
];

fn floor(module: &str) -> Option<usize> {
    FLOORS.iter().position(|f| f.contains(&module))
}

#[test]
fn imports_only_go_down() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut wrong = Vec::new();
    for entry in walk(&src) {
        let inside = entry.strip_prefix(&src).unwrap();
        let first = inside.components().next().unwrap().as_os_str().to_string_lossy();
        let module = first.trim_end_matches(".rs");
        if module == "lib" || module == "main" {
            continue;
        }
        let Some(here) = floor(module) else {
            wrong.push(format!("{}: module {module} has no floor", inside.display()));
            continue;
        };
        let text = fs::read_to_string(&entry).unwrap();
        for (n, line) in text.lines().enumerate() {
            let code = line.split("//").next().unwrap_or_default();
            for target in used(code) {
                let Some(there) = floor(&target) else { continue };
                let listed = LEVEL.contains(&(module, target.as_str()));
                if target != module && there >= here && !listed {
                    wrong.push(format!("{}:{}: {module} uses {target}", inside.display(), n + 1));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "imports that climb:\n{}", wrong.join("\n"));
}

/// Module names after `crate::`, also inside one brace group.
fn used(code: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        let rest = &code[at + "crate::".len()..];
        if let Some(group) = rest.strip_prefix('{') {
            let group = group.split('}').next().unwrap_or_default();
            found.extend(group.split(',').filter_map(|p| ident(p.trim())));
        } else {
            found.extend(ident(rest));
        }
    }
    found
}

fn ident(text: &str) -> Option<String> {
    let name: String = text
        .chars()
        .take_while(|c| c.is_ascii_lowercase() || *c == '_' || c.is_ascii_digit())
        .collect();
    (!name.is_empty()).then_some(name)
}

pub(super) fn walk(dir: &Path) -> Vec<std::path::PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(walk(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

#[test]
fn unsafe_lives_in_two_places() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let allowed = [src.join("mujoco"), src.join("linalg/amx.rs")];
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
