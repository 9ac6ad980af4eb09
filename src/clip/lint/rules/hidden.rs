//! Rule: masks and other keys hide no key and cut no hold short.

use crate::command::Sight;
use crate::document::Fill;
use crate::lint::finder::{Finder, some_of};
use crate::lint::finding::{Fix, Level, Lint, Rule};
use crate::op::{KeysHold, MaskSet, Op};

impl Finder<'_> {
    pub(in crate::lint) fn hidden(&mut self) {
        let clip = self.clip;
        let mut lints = Vec::new();
        for (i, key) in clip.keys.iter().enumerate() {
            let end = clip.hold_end(i);
            let frames = Some([key.frame, end]);
            if (key.frame..end).all(|t| self.command.sight(t) == Sight::Masked) {
                let set = MaskSet { from: key.frame, to: end, joints: None, masked: false };
                lints.push(Lint {
                    level: Level::Info,
                    rule: Rule::Hidden,
                    message: format!("the key at frame {} is hidden by a mask", key.frame),
                    frames,
                    joints: Vec::new(),
                    pointer: format!("/keys/{i}"),
                    fixes: vec![Fix { title: "Unmask the key".to_owned(), op: Op::MaskSet(set) }],
                    settled: None,
                });
            }
            let held = end - key.frame;
            if held < key.hold {
                let op = Op::KeysHold(KeysHold { frames: vec![key.frame], hold: held });
                lints.push(Lint {
                    level: Level::Info,
                    rule: Rule::Hidden,
                    message: format!(
                        "the hold of {} frames at frame {} ends after {held}, {}",
                        key.hold,
                        key.frame,
                        self.end_of_hold(i)
                    ),
                    frames,
                    joints: Vec::new(),
                    pointer: format!("/keys/{i}/hold"),
                    fixes: vec![Fix { title: format!("Hold {held} frames"), op }],
                    settled: None,
                });
            }
        }
        lints.extend((0..clip.keys.len()).filter_map(|i| self.left_out(i)));
        for lint in lints {
            self.push(lint);
        }
    }

    /// What ends the hold of key `i` early.
    fn end_of_hold(&self, i: usize) -> String {
        let Some(next) = self.clip.keys.get(i + 1) else { return "at the end of the clip".into() };
        let joints = self.only_before(i);
        let rest = if joints.is_empty() {
            String::new()
        } else {
            format!(
                ", although that key has no value for {}: a key ends the hold of all joints",
                some_of(&joints)
            )
        };
        format!("at the key at frame {}{rest}", next.frame)
    }

    /// The finding that the fill after key `i` leaves joints out that have goals before and after.
    fn left_out(&self, i: usize) -> Option<Lint> {
        let clip = self.clip;
        let (key, next) = (clip.keys.get(i)?, clip.keys.get(i + 1)?);
        let joints = match clip.fill_after(key) {
            Fill::Mask | Fill::Hold => return None,
            Fill::Linear | Fill::Cubic => self.only_before(i),
        };
        let (from, to) = (clip.hold_end(i), next.frame);
        (from < to && !joints.is_empty()).then(|| Lint {
            level: Level::Info,
            rule: Rule::Hidden,
            message: format!(
                "the fill after frame {} leaves out {}: a line or curve needs values in both keys, and the one at frame {to} has none",
                from - 1,
                some_of(&joints)
            ),
            frames: Some([from, to]),
            joints,
            pointer: format!("/keys/{i}"),
            fixes: Vec::new(),
            settled: None,
        })
    }

    /// The joints with a value in key `i` and in a later one, but not in the next.
    fn only_before(&self, i: usize) -> Vec<String> {
        let clip = self.clip;
        let (Some(end), Some(next)) = (clip.hold_end(i).checked_sub(1), clip.keys.get(i + 1))
        else {
            return Vec::new();
        };
        let lacks = |j: &usize| {
            self.command.sees(end, *j)
                && !self.command.sees(next.frame, *j)
                && self.command.next_goal(next.frame, *j).is_some()
        };
        (0..clip.dim()).filter(lacks).filter_map(|j| clip.robot.joints.get(j).cloned()).collect()
    }
}
