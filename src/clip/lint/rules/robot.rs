//! Rule: the clip was made for this robot and contains something to perform.

use crate::flaw::hint;
use crate::json::show;
use crate::lint::finder::{Finder, some_of};
use crate::lint::finding::{Level, Lint, Rule};

impl Finder<'_> {
    pub(in crate::lint) fn robot(&mut self) {
        let (clip, table) = (self.clip, self.table);
        let mut whole = |level, rule, message: String, pointer: &str, joints| {
            let pointer = pointer.to_owned();
            self.lints.push(Lint {
                level,
                rule,
                message,
                frames: None,
                joints,
                pointer,
                fixes: vec![],
                settled: None,
                unlisted: 0,
            });
        };
        if clip.robot.id != table.robot {
            let message = format!(
                "the clip was made for robot {}, not for {}",
                show(&clip.robot.id),
                show(&table.robot)
            );
            whole(Level::Error, Rule::OtherRobot, message, "/robot/id", vec![]);
        } else if let (Some(a), Some(b)) = (&clip.robot.model_sha256, &table.model_sha256)
            && !a.eq_ignore_ascii_case(b)
        {
            let message = "the clip was made for another version of this robot's model".to_owned();
            whole(Level::Warning, Rule::OtherRobot, message, "/robot/model_sha256", vec![]);
        }
        let mut unknown: Vec<(usize, &String)> = Vec::new();
        for (i, name) in clip.robot.joints.iter().enumerate() {
            let Some(joint) = table.joint(name) else {
                unknown.push((i, name));
                continue;
            };
            if clip.robot.units.get(i).is_some_and(|u| *u != joint.unit) {
                let message = format!("{} is measured in {}", show(name), joint.unit.symbol());
                let pointer = format!("/robot/units/{i}");
                whole(Level::Error, Rule::Unit, message, &pointer, vec![name.clone()]);
            }
        }
        if let Some((first, name)) = unknown.first() {
            let meant = hint(name, table.joints.iter().map(|j| j.name.as_str()));
            let pointer = format!("/robot/joints/{first}");
            let names: Vec<String> = unknown.iter().map(|(_, name)| show(name)).collect();
            let message = format!("{} has no joint {}{meant}", show(&table.robot), some_of(&names));
            let names = unknown.into_iter().map(|(_, name)| name.clone()).collect();
            whole(Level::Error, Rule::UnknownJoint, message, &pointer, names);
        }
        let lacking: Vec<String> = table
            .joints
            .iter()
            .filter(|j| clip.joint(&j.name).is_none())
            .map(|j| j.name.clone())
            .collect();
        if !lacking.is_empty() {
            let message = format!(
                "the clip lacks joints of the robot: {} (to leave a joint free, list it and give it null in every key)",
                lacking.join(", ")
            );
            whole(Level::Error, Rule::UnknownJoint, message, "/robot/joints", lacking);
        }
        if clip.keys.is_empty() {
            let message = "the clip has no keys, so it commands nothing".to_owned();
            whole(Level::Info, Rule::Empty, message, "/keys", vec![]);
        }
        if clip.length < 2 {
            let message = "the clip has one frame; a rollout needs at least 2".to_owned();
            whole(Level::Error, Rule::Empty, message, "/length", vec![]);
        }
    }
}
