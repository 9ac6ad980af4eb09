//! The figures of the documentation are those of the files in results/.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::run::binary;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

fn results(root: &Path, args: &[&str]) -> Output {
    Command::new("python3")
        .arg(root.join("script/results"))
        .args(args)
        .env("ROBERT_BIN", binary())
        .output()
        .unwrap()
}

fn said(ran: &Output) -> String {
    [&ran.stdout[..], &ran.stderr].map(String::from_utf8_lossy).concat()
}

#[test]
fn pages_hold_what_the_files_say() {
    let ran = results(Path::new(ROOT), &["--check"]);
    assert!(ran.status.success(), "{}", said(&ran));
}

/// A copy of the pages, the files and the script, with the assets of the project.
fn copy(to: &Path) {
    for folder in ["script", "results", "docs"] {
        let copied =
            Command::new("cp").arg("-r").arg(Path::new(ROOT).join(folder)).arg(to).status();
        assert!(copied.unwrap().success());
    }
    fs::copy(Path::new(ROOT).join("README.md"), to.join("README.md")).unwrap();
    std::os::unix::fs::symlink(Path::new(ROOT).join("assets"), to.join("assets")).unwrap();
}

#[test]
fn a_figure_that_was_changed_by_hand_is_found_and_put_right() {
    let dir = tempfile::tempdir().unwrap();
    copy(dir.path());
    let page = dir.path().join("docs/models.md");
    let right = fs::read_to_string(&page).unwrap();
    let table = right.find("<!-- results: models-ur5e -->").unwrap();
    let digit = table + right[table..].find("**.0").unwrap() + 4;
    let mut wrong = right.clone();
    wrong.replace_range(digit..=digit, if &right[digit..=digit] == "9" { "8" } else { "9" });
    fs::write(&page, &wrong).unwrap();
    let ran = results(dir.path(), &["--check"]);
    assert_eq!(ran.status.code(), Some(1), "{}", said(&ran));
    assert!(said(&ran).contains("docs/models.md"), "{}", said(&ran));
    assert!(results(dir.path(), &[]).status.success());
    assert_eq!(fs::read_to_string(&page).unwrap(), right);
    // So is one that another file has, too.
    let file = dir.path().join("results/errors-ur5e.json");
    let text = fs::read_to_string(&file).unwrap();
    let mut changed: serde_json::Value = serde_json::from_str(&text).unwrap();
    changed["suites"]["manual"]["policies"]["pd"]["tasks"][0][0] = 0.7.into();
    fs::write(&file, changed.to_string()).unwrap();
    let ran = results(dir.path(), &["--check"]);
    assert_eq!(ran.status.code(), Some(1), "{}", said(&ran));
    assert!(said(&ran).contains("differ in 1 of the cells that both have"), "{}", said(&ran));
    fs::write(&file, text).unwrap();
    // A figure that was changed in a file differs from its pages too.
    let file = dir.path().join("results/ur5e.json");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text.replacen("\"robot\": \"", "\"robot\": \"0", 1)).unwrap();
    let ran = results(dir.path(), &["--check"]);
    assert_eq!(ran.status.code(), Some(1), "{}", said(&ran));
}

#[test]
fn cells_are_measured_again() {
    let args = ["--verify", "4", "--seed", "5", "--only", "pointmass", "ur5e", "ur5e-plants"];
    let ran = results(Path::new(ROOT), &args);
    assert!(ran.status.success(), "{}", said(&ran));
    assert!(said(&ran).contains("4 of 4 agree"), "{}", said(&ran));
    let ran = results(Path::new(ROOT), &["--verify", "1", "--only", "nothing"]);
    assert_eq!(ran.status.code(), Some(1), "{}", said(&ran));
}

/// Every claim of the paper names the file that its verdict rests on.
#[test]
fn claims_of_the_paper_name_files() {
    let page = fs::read_to_string(Path::new(ROOT).join("docs/paper.md")).unwrap();
    let mut count = 0;
    let mut claims = false;
    for row in page.lines() {
        claims = row.starts_with("| claim") || (claims && row.starts_with('|'));
        if !claims || row.starts_with("| claim") || row.starts_with("|---") {
            continue;
        }
        let files: Vec<&str> = row.split("(../results/").skip(1).collect();
        assert!(!files.is_empty(), "no file: {row}");
        for file in files {
            let name = file.split(')').next().unwrap();
            assert!(Path::new(ROOT).join("results").join(name).is_file(), "results/{name}: {row}");
        }
        count += 1;
    }
    assert!(count >= 16, "{count} claims");
}
