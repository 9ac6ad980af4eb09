//! The list of findings while it grows, and the rows that rules look at.

use std::collections::BTreeMap;

use super::finding::{Fix, Level, Lint, Rule};
use crate::command::Command;
use crate::document::{Clip, Goal, Row};
use crate::grid::round;
use crate::joints::JointTable;
use crate::json::{escape_step, show};
use crate::op::{KeysSet, Op, PoseSave};

/// The most findings of one rule that are listed; a log with 50 000 fast keys is one problem.
const LISTED: usize = 1000;

pub(super) struct Finder<'a> {
    pub(super) clip: &'a Clip,
    pub(super) command: &'a Command,
    pub(super) table: &'a JointTable,
    pub(super) lints: Vec<Lint>,
    counts: BTreeMap<Rule, usize>,
}

/// The place of a row in the document, and the keys that use it.
pub(super) struct Place<'a> {
    pub(super) row: &'a Row,
    pub(super) pointer: String,
    pub(super) pose: Option<&'a str>,
    pub(super) frames: Vec<u32>,
    /// Whether its values come from end-effector goals, and so are not in the document.
    pub(super) is_solved: bool,
}

impl Place<'_> {
    pub(super) fn span(&self) -> Option<[u32; 2]> {
        self.frames.first().map(|&f| [f, f + 1])
    }

    pub(super) fn who(&self) -> String {
        match (self.pose, self.frames.first()) {
            (Some(pose), _) => format!("pose \"{}\"", show(pose)),
            (None, Some(f)) => format!("key at frame {f}"),
            (None, None) => "start".to_owned(),
        }
    }

    /// The edit that gives this row other values; none if they were solved.
    pub(super) fn fix(&self, title: &str, values: &[(&str, usize, f64)]) -> Vec<Fix> {
        let op = match (self.pose, self.frames.first()) {
            _ if self.is_solved => return Vec::new(),
            (Some(pose), _) => {
                let mut q = self.row.clone();
                for (_, at, value) in values {
                    if let Some(slot) = q.get_mut(*at) {
                        *slot = Some(round(*value));
                    }
                }
                Op::PoseSave(PoseSave { name: pose.to_owned(), q, replace: true })
            }
            (None, Some(&frame)) => {
                let values =
                    values.iter().map(|(j, _, v)| ((*j).to_owned(), Some(round(*v)))).collect();
                Op::KeysSet(KeysSet { frame, values, ..KeysSet::default() })
            }
            (None, None) => return Vec::new(),
        };
        vec![Fix { title: title.to_owned(), op }]
    }
}

impl<'a> Finder<'a> {
    pub(super) fn new(clip: &'a Clip, command: &'a Command, table: &'a JointTable) -> Self {
        Finder { clip, command, table, lints: Vec::new(), counts: BTreeMap::new() }
    }

    pub(super) fn push(&mut self, lint: Lint) {
        let count = self.counts.entry(lint.rule).or_default();
        *count += 1;
        if *count <= LISTED {
            self.lints.push(lint);
        }
    }

    /// Whether this rule has as many findings as are listed. If so, counts one more finding.
    pub(super) fn full(&mut self, rule: Rule) -> bool {
        let count = self.counts.entry(rule).or_default();
        let full = *count >= LISTED;
        *count += usize::from(full);
        full
    }

    /// Reports how many findings were left out.
    pub(super) fn rest(&mut self) {
        for (&rule, &count) in &self.counts {
            if count <= LISTED {
                continue;
            }
            let frames = None;
            let message = format!("and {} more of this kind", count - LISTED);
            let pointer = "/keys".to_owned();
            let (joints, fixes, settled) = (Vec::new(), Vec::new(), None);
            let (level, unlisted) = (Level::Info, count - LISTED);
            self.lints.push(Lint {
                level,
                rule,
                message,
                frames,
                joints,
                pointer,
                fixes,
                settled,
                unlisted,
            });
        }
    }

    /// Every distinct row: own values of keys, and poses with the keys that use them.
    pub(super) fn places(&self) -> Vec<Place<'a>> {
        let clip = self.clip;
        let mut used: BTreeMap<&str, Vec<u32>> = BTreeMap::new();
        let mut places = Vec::new();
        for (i, key) in clip.keys.iter().enumerate() {
            if let Some(row) = self.command.key_row(i) {
                let (pointer, frames) = (format!("/keys/{i}/reach"), vec![key.frame]);
                places.push(Place { row, pointer, pose: None, frames, is_solved: true });
                continue;
            }
            match &key.goal {
                Goal::Pose(name) => used.entry(name).or_default().push(key.frame),
                Goal::Open => {}
                Goal::Q(row) => places.push(Place {
                    row,
                    pointer: format!("/keys/{i}/q"),
                    pose: None,
                    frames: vec![key.frame],
                    is_solved: false,
                }),
            }
        }
        for (name, row) in &clip.poses {
            places.push(Place {
                row,
                pointer: format!("/poses/{}", escape_step(name)),
                pose: Some(name),
                frames: used.remove(name.as_str()).unwrap_or_default(),
                is_solved: false,
            });
        }
        places
    }
}

/// The first three, and how many more.
pub(super) fn some_of(words: &[String]) -> String {
    let shown = words.iter().take(3).cloned().collect::<Vec<_>>().join(", ");
    match words.len().saturating_sub(3) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}
