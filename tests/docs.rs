//! The pages name files that exist.

use std::fs;
use std::path::{Path, PathBuf};

use super::floors::walk_named;

/// Folders whose files a page may name in backticks.
const FOLDERS: [&str; 9] =
    ["src/", "tests/", "ui/", "docs/", "script/", "assets/", "examples/", "benches/", "results/"];

#[test]
fn pages_name_files_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut missing = Vec::new();
    for page in pages(root) {
        let text = fs::read_to_string(&page).unwrap();
        let shown = page.strip_prefix(root).unwrap().display();
        for name in quoted(&text) {
            if !root.join(name).exists() {
                missing.push(format!("{shown}: `{name}`"));
            }
        }
        for link in links(&text) {
            if !page.parent().unwrap().join(link).exists() {
                missing.push(format!("{shown}: link to {link}"));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
}

fn pages(root: &Path) -> Vec<PathBuf> {
    let own = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md"];
    let mut pages: Vec<PathBuf> = own.iter().map(|name| root.join(name)).collect();
    for entry in fs::read_dir(root.join("docs")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "md") {
            pages.push(path);
        }
    }
    pages.extend(walk_named(&root.join("results"), "README.md"));
    pages
}

/// Paths of this project in backticks; `NAME` and `ROBOT` in a path stand for any.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2).filter(|word| {
        let plain = |c: char| c.is_ascii_alphanumeric() || "/._-".contains(c);
        FOLDERS.iter().any(|f| word.starts_with(f))
            && word.chars().all(plain)
            && !["NAME", "ROBOT"].iter().any(|any| word.contains(any))
    })
}

/// Targets of links inside the project, without their headings.
fn links(text: &str) -> impl Iterator<Item = &str> {
    text.split("](").skip(1).filter_map(|rest| {
        let target = rest.split(')').next()?.split('#').next()?;
        (!target.is_empty() && !target.contains("://")).then_some(target)
    })
}
