//! What is valid but will not do what was meant: each finding with its place and, where
//! there is one, the edit that mends it.
//!
//! One list for everything. What needs the simulator (self-collision, poses out of reach)
//! comes in through [`PoseChecker`], implemented on a higher floor.

use std::collections::BTreeMap;

use serde::Serialize;

use super::command::{Command, LOOKAHEAD_FRAMES, Sight, SpanKind};
use super::document::{Clip, Goal, Key, Row, Start, round};
use super::joints::{Coupling, Granularity, JointTable};
use super::json::{escape_step, show};
use super::op::{
    Batch, ClipLength, KeysAdd, KeysHold, KeysScale, KeysSet, MaskSet, Op, PoseSave, TimeInsert,
};
use crate::limits;
use crate::units::CTRL_DT;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Worth knowing.
    Info,
    /// The motion will differ from what is drawn.
    Warning,
    /// The command cannot be performed by this robot or policy.
    Error,
}

/// Kinds of findings; the words are stable, scripts may filter by them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Rule {
    /// Made for another robot, or another version of its model.
    OtherRobot,
    /// A joint the robot does not have, or one that the clip lacks.
    UnknownJoint,
    /// A unit that differs from the robot's.
    Unit,
    /// A value outside the joint's range.
    JointLimit,
    /// A joint would have to move faster than it can.
    JointSpeed,
    /// The policy sees no goal.
    BlindSpan,
    /// Joints of one actuator that cannot be set apart.
    Coupled,
    /// Single joints left open, for a policy that knows whole frames only.
    PartialMask,
    /// Links that touch.
    SelfCollision,
    /// A pose that the robot does not reach.
    Unreachable,
    /// A key that a mask hides, or a hold that is cut short.
    Hidden,
    /// No key at all.
    Empty,
}

/// An edit that removes a finding.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Mend {
    /// What the button says.
    pub title: String,
    /// What it does.
    pub op: Op,
}

/// A finding.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Lint {
    /// How bad.
    pub level: Level,
    /// Which rule.
    pub rule: Rule,
    /// What is the matter, with figures and units.
    pub message: String,
    /// The frames concerned, `[from, to)`; `None` = the clip as a whole.
    pub frames: Option<[u32; 2]>,
    /// The joints concerned.
    pub joints: Vec<String>,
    /// JSON pointer of the value to look at.
    pub pointer: String,
    /// Ways out, best first.
    pub mends: Vec<Mend>,
}

/// What the simulator says about one pose.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseReport {
    /// Pairs of bodies that touch, by name, with the depth in metres.
    pub contacts: Vec<(String, String, f64)>,
    /// The pose that the robot settles in when it is driven there, in the clip's joint
    /// order; `None` when not simulated.
    pub settled: Option<Vec<f64>>,
}

/// Judges poses by simulation.
pub trait PoseChecker {
    /// Reports on the pose `q` (rad or m) of these joints.
    fn check(&mut self, joints: &[String], q: &[f64]) -> PoseReport;

    /// Largest settle residual that still counts as reached, rad or m.
    fn tolerance(&self) -> f64 {
        0.05
    }
}

/// Finds everything worth saying about a clip, worst first, then by frame.
pub fn lint(
    clip: &Clip,
    command: &Command,
    table: &JointTable,
    checker: Option<&mut dyn PoseChecker>,
) -> Vec<Lint> {
    let mut found = Finder { clip, command, table, lints: Vec::new() };
    found.robot();
    found.limits();
    found.speeds();
    found.blind();
    found.coupled();
    found.partial();
    found.hidden();
    if let Some(checker) = checker {
        found.poses(checker);
    }
    let mut lints = found.lints;
    lints.sort_by_key(|l| {
        (std::cmp::Reverse(l.level), l.frames.map_or(0, |f| f[0]), l.rule, l.pointer.clone())
    });
    lints
}

struct Finder<'a> {
    clip: &'a Clip,
    command: &'a Command,
    table: &'a JointTable,
    lints: Vec<Lint>,
}

/// Where a row of the document stands, and the keys that use it.
struct Place<'a> {
    row: &'a Row,
    pointer: String,
    pose: Option<&'a str>,
    frames: Vec<u32>,
}

impl Place<'_> {
    fn span(&self) -> Option<[u32; 2]> {
        self.frames.first().map(|&f| [f, f + 1])
    }

    fn who(&self) -> String {
        match (self.pose, self.frames.first()) {
            (Some(pose), _) => format!("pose \"{}\"", show(pose)),
            (None, Some(f)) => format!("key at frame {f}"),
            (None, None) => "start".to_owned(),
        }
    }

    /// The edit that gives this row other values.
    fn mend(&self, title: &str, values: &[(&str, usize, f64)]) -> Vec<Mend> {
        let op = match (self.pose, self.frames.first()) {
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
        vec![Mend { title: title.to_owned(), op }]
    }
}

impl<'a> Finder<'a> {
    fn push(&mut self, lint: Lint) {
        self.lints.push(lint);
    }

    /// Every distinct row: own values of keys, and poses with the keys that use them.
    fn places(&self) -> Vec<Place<'a>> {
        let clip = self.clip;
        let mut used: BTreeMap<&str, Vec<u32>> = BTreeMap::new();
        let mut places = Vec::new();
        for (i, key) in clip.keys.iter().enumerate() {
            match &key.goal {
                Goal::Pose(name) => used.entry(name).or_default().push(key.frame),
                Goal::Q(row) => places.push(Place {
                    row,
                    pointer: format!("/keys/{i}/q"),
                    pose: None,
                    frames: vec![key.frame],
                }),
            }
        }
        for (name, row) in &clip.poses {
            places.push(Place {
                row,
                pointer: format!("/poses/{}", escape_step(name)),
                pose: Some(name),
                frames: used.remove(name.as_str()).unwrap_or_default(),
            });
        }
        places
    }

    fn robot(&mut self) {
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
                mends: vec![],
            });
        };
        if clip.robot.id != table.robot {
            let message =
                format!("made for robot {}, not for {}", show(&clip.robot.id), show(&table.robot));
            whole(Level::Error, Rule::OtherRobot, message, "/robot/id", vec![]);
        } else if let (Some(a), Some(b)) = (&clip.robot.model_sha256, &table.model_sha256)
            && !a.eq_ignore_ascii_case(b)
        {
            let message = "made for another version of this robot's model".to_owned();
            whole(Level::Warning, Rule::OtherRobot, message, "/robot/model_sha256", vec![]);
        }
        for (i, name) in clip.robot.joints.iter().enumerate() {
            let pointer = format!("/robot/joints/{i}");
            let Some(joint) = table.joint(name) else {
                let message = format!("{} has no joint {}", show(&table.robot), show(name));
                whole(Level::Error, Rule::UnknownJoint, message, &pointer, vec![name.clone()]);
                continue;
            };
            if clip.robot.units.get(i).is_some_and(|u| *u != joint.unit) {
                let message = format!("{} is measured in {}", show(name), joint.unit.symbol());
                let pointer = format!("/robot/units/{i}");
                whole(Level::Error, Rule::Unit, message, &pointer, vec![name.clone()]);
            }
        }
        let lacking: Vec<String> = table
            .joints
            .iter()
            .filter(|j| clip.joint(&j.name).is_none())
            .map(|j| j.name.clone())
            .collect();
        if !lacking.is_empty() {
            let message =
                format!("joints of the robot are not in the clip: {}", lacking.join(", "));
            whole(Level::Error, Rule::UnknownJoint, message, "/robot/joints", lacking);
        }
        if clip.keys.is_empty() {
            let message = "no keys: nothing is asked of the robot".to_owned();
            whole(Level::Info, Rule::Empty, message, "/keys", vec![]);
        }
    }

    fn limits(&mut self) {
        let start: Option<Row> = match &self.clip.start {
            Some(Start::Q(q)) => Some(q.iter().copied().map(Some).collect()),
            _ => None,
        };
        let start = start.as_ref().map(|row| Place {
            row,
            pointer: "/start/q".to_owned(),
            pose: None,
            frames: vec![],
        });
        let mut lints = Vec::new();
        for place in self.places().iter().chain(&start) {
            let mut out = Vec::new();
            let mut words = Vec::new();
            for (j, (name, value)) in self.clip.robot.joints.iter().zip(place.row).enumerate() {
                let Some(joint) = self.table.joint(name) else { continue };
                let (Some(v), Some([lo, hi])) = (*value, joint.range) else { continue };
                // The grid of the document is 1e-6; a limit of pi/2 must accept 1.570796.
                if v < lo - 1e-6 || v > hi + 1e-6 {
                    out.push((name.as_str(), j, joint.clamp(v)));
                    let unit = joint.unit.symbol();
                    words.push(format!("{name} {v} {unit} outside {lo}..{hi}"));
                }
            }
            if out.is_empty() {
                continue;
            }
            let first = out.first().map_or(0, |o| o.1);
            lints.push(Lint {
                level: Level::Error,
                rule: Rule::JointLimit,
                message: format!("{}: {}", place.who(), some_of(&words)),
                frames: place.span(),
                joints: out.iter().map(|o| o.0.to_owned()).collect(),
                pointer: format!("{}/{first}", place.pointer),
                mends: place.mend("Clamp to the limits", &out),
            });
        }
        self.lints.extend(lints);
    }

    /// Speeds between neighbouring goals of each joint, runs of offenders joined.
    fn speeds(&mut self) {
        let command = self.command;
        let mut runs: Vec<Run> = Vec::new();
        for (j, name) in command.joints().iter().enumerate() {
            let joint = self.table.joint(name);
            let Some(speed_max) = joint.and_then(|f| f.speed_max).filter(|s| *s > 0.0) else {
                continue;
            };
            let mut last: Option<(u32, f32)> = None;
            let mut run: Option<Run> = None;
            for t in 0..command.frames() {
                if !command.sees(t, j) {
                    continue;
                }
                let Some(&v) = command.row(t).get(j) else { continue };
                if let Some((a, from)) = last.replace((t, v)) {
                    let step = (f64::from(v) - f64::from(from)).abs();
                    let ratio = step / (f64::from(t - a) * CTRL_DT) / speed_max;
                    if ratio > 1.0 + 1e-6 {
                        match &mut run {
                            Some(r) if r.to == a => {
                                r.to = t;
                                r.ratio = r.ratio.max(ratio);
                            }
                            _ => runs.extend(run.replace(Run { joint: j, from: a, to: t, ratio })),
                        }
                    }
                }
            }
            runs.extend(run);
        }
        // Joints that are too fast over the same frames are one finding.
        let mut merged: BTreeMap<(u32, u32), Vec<Run>> = BTreeMap::new();
        for run in runs {
            merged.entry((run.from, run.to)).or_default().push(run);
        }
        for ((from, to), runs) in merged {
            let lint = self.speed_lint(from, to, &runs);
            self.push(lint);
        }
    }

    fn speed_lint(&self, from: u32, to: u32, runs: &[Run]) -> Lint {
        let ratio = runs.iter().map(|r| r.ratio).fold(1.0, f64::max);
        let mut joints = Vec::new();
        let mut words = Vec::new();
        for run in runs {
            let Some(name) = self.command.joints().get(run.joint) else { continue };
            let Some(fact) = self.table.joint(name) else { continue };
            let max = fact.speed_max.unwrap_or_default();
            let unit = fact.unit.symbol();
            words.push(format!("{name} {:.2} {unit}/s of {max:.2}", max * run.ratio));
            joints.push(name.clone());
        }
        // The interval between keys around the run: its length scales the speed.
        let keys = &self.clip.keys;
        let next = keys.partition_point(|k| k.frame < to);
        let index = keys.partition_point(|k| k.frame <= from).saturating_sub(1);
        let mut mends = Vec::new();
        if let (Some(key), Some(after)) = (keys.get(index), keys.get(next))
            && next == index + 1
        {
            let begin = self.clip.hold_end(index).saturating_sub(1).max(key.frame);
            let have = after.frame - begin;
            let need = (f64::from(have) * ratio).ceil().min(1e6) as u32;
            let frames = need.saturating_sub(have).max(1);
            if self.clip.length + frames <= limits::CLIP_FRAMES {
                let title = format!("Allow {frames} more frames before frame {}", after.frame);
                mends.push(Mend {
                    title,
                    op: Op::TimeInsert(TimeInsert { at: after.frame, frames }),
                });
            }
        }
        mends.extend(self.slow_down(ratio));
        Lint {
            level: Level::Warning,
            rule: Rule::JointSpeed,
            message: format!("too fast: {}", some_of(&words)),
            frames: Some([from, to + 1]),
            joints,
            pointer: format!("/keys/{}", next.min(keys.len().saturating_sub(1))),
            mends,
        }
    }

    /// Everything slower by one factor.
    fn slow_down(&self, ratio: f64) -> Option<Mend> {
        let factor = (ratio * 100.0).ceil() / 100.0;
        let clip = self.clip;
        let length = (f64::from(clip.length) * factor).ceil();
        if length > f64::from(limits::CLIP_FRAMES) || clip.keys.is_empty() {
            return None;
        }
        let frames = clip.keys.iter().map(|k| k.frame).collect();
        let ops = vec![
            Op::ClipLength(ClipLength { length: length as u32, cut: false }),
            Op::KeysScale(KeysScale { frames, pivot: 0, factor, replace: false }),
        ];
        let title = format!("Slow the whole clip down by {factor}");
        Some(Mend { title: title.clone(), op: Op::Batch(Batch { label: title, ops }) })
    }

    fn blind(&mut self) {
        for blind in self.command.blind_spans() {
            if self.clip.keys.is_empty() {
                return;
            }
            let from = blind.after.map_or(0, |a| a + 1);
            let to = blind.before.unwrap_or(self.command.frames());
            let steps = blind.to - blind.from;
            let gap = to - from;
            let message = format!(
                "{gap} frames without a goal: for {steps} steps the policy sees none and gets a virtual key"
            );
            let key = blind
                .before
                .map_or(self.clip.keys.len(), |b| self.clip.keys.partition_point(|k| k.frame < b));
            let mends = self.blind_mends(blind.after, from, to);
            self.push(Lint {
                level: Level::Warning,
                rule: Rule::BlindSpan,
                message,
                frames: Some([from, to]),
                joints: Vec::new(),
                pointer: format!("/keys/{}", key.min(self.clip.keys.len().saturating_sub(1))),
                mends,
            });
        }
    }

    fn blind_mends(&self, after: Option<u32>, from: u32, to: u32) -> Vec<Mend> {
        let clip = self.clip;
        let hidden = |f: u32| {
            self.command
                .spans()
                .iter()
                .any(|s| s.kind == SpanKind::Masked && (s.from..s.to).contains(&f))
        };
        if (from..to).any(hidden) {
            let set = MaskSet { from, to, joints: None, masked: false };
            return vec![Mend {
                title: format!("Unmask frames {from} to {}", to - 1),
                op: Op::MaskSet(set),
            }];
        }
        let mut mends = Vec::new();
        // Hold: the last goal stays until 20 frames before the next one.
        let holder = after.and_then(|a| {
            let i = clip.keys.partition_point(|k| k.frame <= a).checked_sub(1)?;
            clip.keys.get(i).filter(|k| clip.hold_end(i) == a + 1 && k.frame <= a)
        });
        if let Some(key) = holder {
            let hold = to - LOOKAHEAD_FRAMES - key.frame + 1;
            let op = Op::KeysHold(KeysHold { frames: vec![key.frame], hold });
            mends.push(Mend { title: format!("Hold the key at {} longer", key.frame), op });
        }
        // A goal every 20 frames on the line to the next.
        let first = after.unwrap_or(0);
        let keys: Vec<Key> = (1..)
            .map(|i| first + i * LOOKAHEAD_FRAMES)
            .take_while(|f| *f < to)
            .filter(|f| clip.key(*f).is_none())
            .take(limits::CLIP_KEYS.saturating_sub(clip.keys.len()))
            .map(|f| {
                let q = self.command.interpolated(f);
                Key::new(f, &q.iter().map(|v| round(f64::from(*v))).collect::<Vec<_>>())
            })
            .collect();
        if !keys.is_empty() {
            let title = format!("Insert {} keys on the way", keys.len());
            mends.push(Mend { title, op: Op::KeysAdd(KeysAdd { keys, replace: false }) });
        }
        mends
    }

    fn coupled(&mut self) {
        let mut lints = Vec::new();
        for place in self.places() {
            for coupling in &self.table.couplings {
                lints.extend(self.coupled_in(&place, coupling));
            }
        }
        self.lints.extend(lints);
    }

    fn coupled_in(&self, place: &Place<'_>, coupling: &Coupling) -> Option<Lint> {
        let mut shared = Vec::new();
        for member in &coupling.members {
            let at = self.clip.joint(&member.joint)?;
            let q = place.row.get(at).copied().flatten();
            if member.coef != 0.0
                && let Some(q) = q
            {
                shared.push((member, at, (q - member.offset) / member.coef));
            }
        }
        let values = || shared.iter().map(|s| s.2);
        let (lo, hi) = (values().fold(f64::MAX, f64::min), values().fold(f64::MIN, f64::max));
        if shared.len() < 2 || hi - lo <= coupling.tolerance {
            return None;
        }
        let mean = values().sum::<f64>() / shared.len() as f64;
        let mended: Vec<(&str, usize, f64)> = shared
            .iter()
            .map(|(m, at, _)| {
                let q = m.coef * mean + m.offset;
                let q = self.table.joint(&m.joint).map_or(q, |j| j.clamp(q));
                (m.joint.as_str(), *at, q)
            })
            .collect();
        let joints: Vec<String> = shared.iter().map(|s| s.0.joint.clone()).collect();
        let first = shared.first().map_or(0, |s| s.1);
        Some(Lint {
            level: Level::Warning,
            rule: Rule::Coupled,
            message: format!(
                "{}: {} share {} and cannot be set {:.3} apart",
                place.who(),
                joints.join(" and "),
                coupling.name,
                hi - lo
            ),
            frames: place.span(),
            joints,
            pointer: format!("{}/{first}", place.pointer),
            mends: place.mend("Split evenly", &mended),
        })
    }

    fn partial(&mut self) {
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
                    "frames {from} to {}: goals for some joints only, but this policy knows whole frames only",
                    at - 1
                ),
                frames: Some([from, at]),
                joints,
                pointer: format!("/keys/{key}"),
                mends: vec![Mend { title: "Mask these frames for all joints".to_owned(), op }],
            });
        }
    }

    fn hidden(&mut self) {
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
                    mends: vec![Mend { title: "Unmask the key".to_owned(), op: Op::MaskSet(set) }],
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
                    mends: vec![Mend { title: format!("Hold {held} frames"), op }],
                });
            }
        }
        self.lints.extend(lints);
    }

    fn poses(&mut self, checker: &mut dyn PoseChecker) {
        let joints = &self.clip.robot.joints;
        let mut lints = Vec::new();
        for place in self.places() {
            // Only complete poses can be simulated.
            let Some(q) = place.row.iter().copied().collect::<Option<Vec<f64>>>() else { continue };
            let report = checker.check(joints, &q);
            if !report.contacts.is_empty() {
                let words: Vec<String> = report
                    .contacts
                    .iter()
                    .map(|(a, b, depth)| format!("{a} and {b} by {:.1} mm", depth * 1e3))
                    .collect();
                lints.push(Lint {
                    level: Level::Warning,
                    rule: Rule::SelfCollision,
                    message: format!("{}: {} overlap", place.who(), some_of(&words)),
                    frames: place.span(),
                    joints: Vec::new(),
                    pointer: place.pointer.clone(),
                    mends: settled(&place, joints, report.settled.as_deref()),
                });
            }
            let Some(reached) = &report.settled else { continue };
            let off: Vec<(&String, f64)> = joints
                .iter()
                .zip(q.iter().zip(reached).map(|(a, b)| (a - b).abs()))
                .filter(|(_, residual)| *residual > checker.tolerance())
                .collect();
            if off.is_empty() {
                continue;
            }
            let words: Vec<String> = off.iter().map(|(j, r)| format!("{j} by {r:.3}")).collect();
            lints.push(Lint {
                level: Level::Warning,
                rule: Rule::Unreachable,
                message: format!("{}: the robot misses {}", place.who(), some_of(&words)),
                frames: place.span(),
                joints: off.iter().map(|(j, _)| (*j).clone()).collect(),
                pointer: place.pointer.clone(),
                mends: settled(&place, joints, Some(reached)),
            });
        }
        self.lints.extend(lints);
    }
}

fn settled(place: &Place<'_>, joints: &[String], reached: Option<&[f64]>) -> Vec<Mend> {
    let Some(reached) = reached else { return Vec::new() };
    let values: Vec<(&str, usize, f64)> =
        joints.iter().zip(reached).enumerate().map(|(i, (j, v))| (j.as_str(), i, *v)).collect();
    place.mend("Store the pose that is reached", &values)
}

#[derive(Clone, Copy)]
struct Run {
    joint: usize,
    from: u32,
    to: u32,
    ratio: f64,
}

/// The first three, and how many more.
fn some_of(words: &[String]) -> String {
    let shown = words.iter().take(3).cloned().collect::<Vec<_>>().join(", ");
    match words.len().saturating_sub(3) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}
