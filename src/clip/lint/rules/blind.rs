//! Rule: the policy always has a goal in its window.

use crate::command::{LOOKAHEAD_FRAMES, SpanKind};
use crate::document::{Goal, Key};
use crate::grid::round;
use crate::lint::finder::Finder;
use crate::lint::finding::{Fix, Level, Lint, Rule};
use crate::op::{KeysAdd, KeysHold, MaskSet, Op};
use robert_base::limits;

/// The number of keys before a gap among which the one is looked for whose hold ends there.
const HOLDERS: usize = 100;

impl Finder<'_> {
    pub(in crate::lint) fn blind(&mut self) {
        for blind in self.command.blind_spans() {
            if self.clip.keys.is_empty() {
                return;
            }
            if self.full(Rule::BlindSpan) {
                continue;
            }
            let from = blind.after.map_or(0, |a| a + 1);
            let to = blind.before.unwrap_or(self.command.frames());
            let steps = blind.to - blind.from;
            let plural = if steps == 1 { "step" } else { "steps" };
            let then = match blind.before {
                Some(_) => "the motion to the next goal is left to the program",
                None => "the robot stays where it was",
            };
            let message = format!(
                "no goal from frame {from} to {}: for {steps} {plural} the policy sees none, and {then}",
                to - 1
            );
            let key = blind
                .before
                .map_or(self.clip.keys.len(), |b| self.clip.keys.partition_point(|k| k.frame < b));
            let fixes = self.blind_fixes(blind.after, from, to);
            // The program leads through the gap, so this is no mistake: `--fix` leaves it open.
            self.push(Lint {
                level: Level::Info,
                rule: Rule::BlindSpan,
                message,
                frames: Some([from, to]),
                joints: Vec::new(),
                pointer: format!("/keys/{}", key.min(self.clip.keys.len().saturating_sub(1))),
                fixes,
                settled: None,
                unlisted: 0,
            });
        }
    }

    fn blind_fixes(&self, after: Option<u32>, from: u32, to: u32) -> Vec<Fix> {
        let clip = self.clip;
        let spans = self.command.spans();
        let first = spans.partition_point(|s| s.to <= from);
        let mut inside = spans.iter().skip(first).take_while(|s| s.from < to);
        if inside.any(|s| s.kind == SpanKind::Masked) {
            let set = MaskSet { from, to, joints: None, masked: false };
            return vec![Fix {
                title: format!("Unmask frames {from} to {}", to - 1),
                op: Op::MaskSet(set),
            }];
        }
        let mut fixes = Vec::new();
        // Goals on the line to the next one, as few and as even as the window allows; in an open end
        // every 20 frames.
        let first = after.unwrap_or(0);
        let parts = (to - first).div_ceil(LOOKAHEAD_FRAMES);
        let at = |i: u32| {
            if to < self.command.frames() {
                // Rounded to the nearest frame, which leaves no part longer than the window.
                first + (2 * i * (to - first) + parts) / (2 * parts)
            } else {
                first + i * LOOKAHEAD_FRAMES
            }
        };
        let end = if to < self.command.frames() { to } else { first };
        // A goal that follows from others at the end of the span is not on a line between two of its kind.
        let row = clip.key(end).filter(|key| key.reach.is_empty()).and_then(|key| clip.row(key));
        let follows = |j: usize| row.is_some_and(|row| row[j].is_none());
        let wanted = |j| {
            if self.command.sees(end, j) {
                !follows(j)
            } else {
                self.command.next_goal(end, j).is_some()
            }
        };
        let keys: Vec<Key> = (1..parts)
            .map(at)
            .filter(|f| clip.key(*f).is_none())
            .take(limits::CLIP_KEYS.saturating_sub(clip.keys.len()))
            .map(|f| {
                let q = self.command.interpolated(f).into_iter().enumerate();
                // A joint that has no goal after the span stays free on the way.
                let row = q.map(|(j, v)| wanted(j).then(|| round(f64::from(v)))).collect();
                Key::with(f, Goal::Q(row))
            })
            .collect();
        if !keys.is_empty() {
            let title = match keys.len() {
                1 => "Insert a key on the way".to_owned(),
                n => format!("Insert {n} keys on the way"),
            };
            fixes.push(Fix { title, op: Op::KeysAdd(KeysAdd { keys, replace: false }) });
        }
        // Or the last goal stays until 20 frames before the next one, which makes the way there faster.
        let holder = after.and_then(|a| {
            let before = clip.keys.partition_point(|k| k.frame <= a);
            let near = before.saturating_sub(HOLDERS)..before;
            clip.keys.get(near.rev().find(|i| clip.hold_end(*i) == a + 1)?)
        });
        if let Some(key) = holder {
            let hold = to - LOOKAHEAD_FRAMES - key.frame + 1;
            let op = Op::KeysHold(KeysHold { frames: vec![key.frame], hold });
            fixes.push(Fix { title: format!("Hold the key at {} longer", key.frame), op });
        }
        fixes
    }
}
