//! The formulas of the task clips `manual`, `extra` and `validation`.
//!
//! `ROBERT_BLESS=clips cargo test --test it formulas` writes the clips and their list to
//! `assets/clips`.

mod hand;
mod pointmass;
mod ur5e;

use std::path::Path;

use robert::clip::{Clip, compile};
use robert::robot::Robot;
use robert::rollout::tasks::author::Authored;
use robert::rollout::tasks::{AUTHORED, MANIFEST, manifest, path_of, suite};

/// Every generated task of a robot, in the order of tables. Hand poses are settled in simulation.
fn authored(robot: &Robot) -> Vec<Authored> {
    match robot.id() {
        "pointmass" => pointmass::tasks(robot),
        "ur5e" => ur5e::tasks(robot),
        "shadow_hand" => hand::tasks(robot).unwrap(),
        other => panic!("no formulas for {other}"),
    }
}

/// Robots with clips of their own.
fn robots() -> impl Iterator<Item = Robot> {
    let own = manifest().unwrap().into_iter().filter(|(_, tasks)| tasks.like.is_none());
    own.map(|(id, _)| Robot::builtin(&id).unwrap())
}

fn write(folder: &Path) {
    let mut manifest = manifest().unwrap();
    for robot in robots() {
        let entry = manifest.get_mut(robot.id()).unwrap();
        (entry.manual, entry.extra, entry.validation) = Default::default();
        for task in authored(&robot) {
            let path = folder.join(path_of(robot.id(), task.name));
            std::fs::write(path, task.clip.to_text()).unwrap();
            let list = match task.suite {
                "manual" => &mut entry.manual,
                "extra" => &mut entry.extra,
                _ => &mut entry.validation,
            };
            list.push(task.name.to_owned());
        }
    }
    let path = folder.join(MANIFEST);
    let old = std::fs::read_to_string(&path).unwrap();
    let head = old.split_inclusive('\n').take_while(|l| l.starts_with('#')).collect::<String>();
    let body = toml::to_string_pretty(&manifest).unwrap();
    std::fs::write(path, format!("{head}\n{body}")).unwrap();
}

/// The files agree with the formulas; hand poses within a milliradian, since they come from a
/// simulation.
#[test]
fn files_and_formulas_agree() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/clips");
    // Not with `=1`: other tests read these files, and floors and results depend on them.
    if std::env::var_os("ROBERT_BLESS").is_some_and(|v| v == "clips") {
        return write(&folder);
    }
    for robot in robots() {
        let id = robot.id();
        let tasks = authored(&robot);
        let names: usize = AUTHORED.iter().map(|s| suite(id, s).unwrap().len()).sum();
        assert_eq!(tasks.len(), names, "{id}: ROBERT_BLESS=clips cargo test --test it formulas");
        for task in tasks {
            let text = std::fs::read_to_string(folder.join(path_of(id, task.name))).unwrap();
            let file = Clip::parse(&text).unwrap();
            assert_eq!(file.keys.len(), task.clip.keys.len(), "{id}/{}", task.name);
            assert_eq!(file.poses.len(), task.clip.poses.len(), "{id}/{}", task.name);
            let (a, b) = (compile(&file).unwrap(), compile(&task.clip).unwrap());
            assert_eq!(a.frames(), b.frames());
            for f in 0..a.frames() {
                assert_eq!(a.sight(f), b.sight(f), "{id}/{} {f}", task.name);
                for (x, y) in a.row(f).iter().zip(b.row(f)) {
                    assert!((x - y).abs() < 1e-3, "{id}/{} {f}: {x} {y}", task.name);
                }
            }
        }
    }
}
