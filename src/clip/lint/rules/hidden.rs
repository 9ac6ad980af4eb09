//! Rule: masks and other keys hide no key and cut no hold short.

use crate::command::Sight;
use crate::lint::finder::Finder;
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
                        "the hold of {} frames at frame {} ends after {held}",
                        key.hold, key.frame
                    ),
                    frames,
                    joints: Vec::new(),
                    pointer: format!("/keys/{i}/hold"),
                    fixes: vec![Fix { title: format!("Hold {held} frames"), op }],
                    settled: None,
                });
            }
        }
        for lint in lints {
            self.push(lint);
        }
    }
}
