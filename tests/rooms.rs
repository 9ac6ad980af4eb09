//! The modules of the studio: imports go one way, and no module keeps much state.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use super::floors::walk;

/// A module may use those after it in this list.
const ROOMS: &[&str] = &[
    "lib",
    "http",
    "state",
    "session",
    "viewport",
    "workspace",
    "jobs",
    "simulation",
    "document",
    "protocol",
];

/// What goes up, each for one name: the handles that requests share hold the guard.
const UP: &[(&str, &str)] = &[("state", "http")];

/// Fields of a struct of state, and flags among them.
const FIELDS: usize = 10;
const FLAGS: usize = 3;

#[test]
fn rooms_of_the_studio_import_one_way() {
    let mut wrong = BTreeSet::new();
    for (room, file, text) in files() {
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        let paths = code.match_indices("crate::");
        for (at, _) in paths.filter(|(at, _)| !code[..*at].ends_with(['_', ':'])) {
            let rest = &code[at + "crate::".len()..];
            let name: String =
                rest.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
            let place = |n: &str| ROOMS.iter().position(|r| *r == n);
            let (Some(here), Some(there)) = (place(&room), place(&name)) else {
                wrong.insert(format!("{file}: {room} or {name} is in no list of rooms"));
                continue;
            };
            if there < here && !UP.contains(&(room.as_str(), name.as_str())) {
                wrong.insert(format!("{file}: {room} uses {name}"));
            }
        }
    }
    assert!(wrong.is_empty(), "imports between rooms that climb:\n{wrong:#?}");
}

#[test]
fn no_struct_of_state_is_a_heap() {
    let mut wrong = Vec::new();
    for (_, file, text) in files() {
        let mut lines = text.lines().peekable();
        let mut derives = String::new();
        while let Some(line) = lines.next() {
            if line.starts_with("#[derive") {
                line.clone_into(&mut derives);
            }
            let name = line.split("struct ").nth(1).filter(|_| !line.starts_with(' '));
            let Some(name) = name.filter(|_| line.ends_with('{')) else {
                if line.is_empty() {
                    derives.clear();
                }
                continue;
            };
            let fields: Vec<&str> = lines
                .by_ref()
                .take_while(|l| *l != "}")
                .map(str::trim)
                .filter(|l| !l.starts_with("//") && !l.starts_with('#') && l.contains(": "))
                .collect();
            let flags = fields.iter().filter(|f| f.ends_with(": bool,")).count();
            // What is sent or received is as large as what there is to say.
            let sent = derives.contains("Serialize") || derives.contains("Deserialize");
            if !sent && (fields.len() > FIELDS || flags > FLAGS) {
                wrong.push(format!("{file}: {name} {} fields, {flags} flags", fields.len()));
            }
            derives.clear();
        }
    }
    assert!(wrong.is_empty(), "structs of state that are heaps:\n{}", wrong.join("\n"));
}

/// Room, file and text of every file of the studio.
fn files() -> Vec<(String, String, String)> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/studio");
    let mut found = Vec::new();
    for path in walk(&src) {
        let inside = path.strip_prefix(&src).unwrap();
        let first = inside.components().next().unwrap().as_os_str().to_string_lossy();
        let room = first.trim_end_matches(".rs").to_owned();
        if room == "build" {
            continue;
        }
        found.push((room, inside.display().to_string(), fs::read_to_string(&path).unwrap()));
    }
    found
}
