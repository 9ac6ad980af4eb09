//! Rule: frames have goals for all joints or for none, if the policy needs it.

use crate::command::Sight;
use crate::joints::Granularity;
use crate::lint::finder::Finder;
use crate::lint::finding::{Fix, Level, Lint, Rule};
use crate::op::{MaskSet, Op};

impl Finder<'_> {
    pub(in crate::lint) fn partial(&mut self) {
        if self.table.granularity == Granularity::Joint {
            return;
        }
        let command = self.command;
        let mut at = 0;
        while at < command.frames() {
            if command.sight(at) != Sight::Partial {
                at += 1;
                continue;
            }
            let from = at;
            while at < command.frames() && command.sight(at) == Sight::Partial {
                at += 1;
            }
            let hidden = |j: &usize| (from..at).any(|t| !command.sees(t, *j));
            let joints = (0..command.dim()).filter(hidden);
            let joints: Vec<String> =
                joints.filter_map(|j| command.joints().get(j).cloned()).collect();
            let key = self.clip.keys.partition_point(|k| k.frame <= from).saturating_sub(1);
            let op = Op::MaskSet(MaskSet { from, to: at, joints: None, masked: true });
            self.push(Lint {
                level: Level::Error,
                rule: Rule::PartialMask,
                message: format!(
                    "frames {from} to {} have goals for some joints only, but this policy was trained on whole frames",
                    at - 1
                ),
                frames: Some([from, at]),
                joints,
                pointer: format!("/keys/{key}"),
                fixes: vec![Fix { title: "Mask these frames for all joints".to_owned(), op }],
                settled: None,
                unlisted: 0,
            });
        }
    }
}
