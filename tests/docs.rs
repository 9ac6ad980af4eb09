//! The pages name files and tests that exist.

use std::fs;
use std::path::{Path, PathBuf};

use super::floors::{walk, walk_named};

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

/// `docs/operations.md` says what the types say; `ROBERT_BLESS=1` writes it.
#[test]
fn the_page_of_operations_is_that_of_the_types() {
    let mut group = String::new();
    let page = |one: robert::clip::Operation| {
        let kind = one.name.split('.').next().unwrap_or_default().to_owned();
        let head = if kind == group { String::new() } else { format!("\n## {kind}\n") };
        let title = if one.name == kind { String::new() } else { format!("\n### {}\n", one.name) };
        group = kind;
        let row = |a: robert::clip::Argument| {
            let optional = if a.required { "" } else { " Optional." };
            format!("| `{}` | {} | {}{optional} |\n", a.name, a.kind, a.about)
        };
        let rows: String = one.args.into_iter().map(row).collect();
        let table = "| argument | type | meaning |\n| --- | --- | --- |\n";
        format!("{head}{title}\n{}\n\n{table}{rows}", one.about)
    };
    let pages: String = robert::clip::operations().into_iter().map(page).collect();
    let text = OPERATIONS.to_owned() + &pages;
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/operations.md");
    if std::env::var_os("ROBERT_BLESS").is_some() {
        fs::write(&file, &text).unwrap();
    }
    let there = fs::read_to_string(&file).unwrap_or_default();
    assert!(there == text, "ROBERT_BLESS=1 cargo test --test it the_page_of_operations");
}

const OPERATIONS: &str = "\
# Operations

Every edit of a clip is an operation: in the studio, in its history, and in `robert clip apply CLIP OPS.json`. An operation
is an object with a name and arguments, for instance `{\"op\": \"keys.move\", \"args\": {\"frames\": [20], \"df\": 5}}`. A key is
identified by its frame. The file contains one operation or an array of them. Keys, offsets and end-effector goals have
the form that they have in a clip (`robert clip schema`). `robert clip ops` prints this list; a test compares the page
with the program.
";

/// What the page on failures says is tested is tested, and every limit is in its table.
#[test]
fn the_page_on_failures_names_tests_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |path: &Path| fs::read_to_string(path).unwrap();
    let page = read(&root.join("docs/reliability.md"));
    let part = |from: &str| page.split(from).nth(1).unwrap().split("\n## ").next().unwrap();
    let (findings, limits) =
        (part("## The test of each finding"), part("## The test of each limit"));
    let code: String = [walk(&root.join("src")), walk(&root.join("tests"))]
        .concat()
        .iter()
        .map(|file| read(file))
        .collect();
    let words = |text: &str| -> Vec<String> {
        text.split('`').skip(1).step_by(2).map(str::to_owned).collect()
    };
    let snake = |w: &&String| {
        w.contains('_')
            && w.chars().all(|c| c == '_' || c.is_ascii_lowercase() || c.is_ascii_digit())
    };
    let named = [words(findings), words(limits)].concat();
    let missing: Vec<&String> =
        named.iter().filter(snake).filter(|w| !code.contains(&format!("fn {w}("))).collect();
    assert!(missing.is_empty(), "no such test: {missing:?}");
    let constants = read(&root.join("src/base/limits.rs"));
    let listed = words(limits);
    for line in constants.lines().filter_map(|l| l.strip_prefix("pub const ")) {
        let name = line.split(':').next().unwrap();
        assert_eq!(
            listed.iter().filter(|w| *w == name).count(),
            1,
            "{name} in docs/reliability.md"
        );
    }
    for row in findings.lines().filter(|l| l.starts_with("| ") && !l.contains("---")).skip(1) {
        assert!(words(row).iter().any(|w| snake(&w)), "no test: {row}");
    }
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
