//! Finds content of a clip that is valid but will not do what was meant. Each finding has its place
//! and, if there is one, an edit that fixes it.
//!
//! All findings are in one list. Checks that need the simulator (self-collision, unreachable poses)
//! come from a [`PoseChecker`], which is implemented on a higher floor.

use std::collections::BTreeMap;

use serde::Serialize;

use super::command::{Command, LOOKAHEAD_FRAMES, Sight, SpanKind};
use super::document::{Clip, Fill, Goal, Key, Row, Start, round};
use super::joints::{Coupling, Granularity, JointTable};
use super::json::{escape_step, show};
use super::op::{
    Batch, ClipLength, FillSet, KeysAdd, KeysHold, KeysScale, KeysSet, MaskSet, Op, PoseSave,
    TimeInsert,
};
use robert_base::limits;
use robert_base::units::CTRL_DT;

/// The most findings of one rule that are listed; a log with 50 000 fast keys is one problem.
const MOST: usize = 1000;

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
#[derive(schemars::JsonSchema)]
pub enum Level {
    /// Worth knowing.
    Info,
    /// The motion will differ from the clip.
    Warning,
    /// The command cannot be performed by this robot or policy.
    Error,
}

/// Kinds of findings. The words are stable, so scripts may filter by them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
#[derive(schemars::JsonSchema)]
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
    /// Single joints are masked, but the policy was trained on whole frames.
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
#[derive(Clone, Debug, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Fix {
    /// Its text on a button.
    pub title: String,
    /// The edit.
    pub op: Op,
}

/// A finding.
#[derive(Clone, Debug, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Lint {
    /// Its severity.
    pub level: Level,
    /// Its rule.
    pub rule: Rule,
    /// The message, with figures and units.
    pub message: String,
    /// The frames concerned, `[from, to)`; `None` = the clip as a whole.
    pub frames: Option<[u32; 2]>,
    /// The joints concerned.
    pub joints: Vec<String>,
    /// JSON pointer of the value to look at.
    pub pointer: String,
    /// Fixes, best first; the JSON name is `mends`, which scripts use.
    #[serde(rename = "mends")]
    pub fixes: Vec<Fix>,
}

/// The result of simulating one pose.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseReport {
    /// Pairs of bodies that touch, by name, with the depth in metres.
    pub contacts: Vec<(String, String, f64)>,
    /// The pose that the robot settles in when it is driven there, in the clip's joint
    /// order; `None` when not simulated.
    pub settled: Option<Vec<f64>>,
}

/// Checks poses by simulation.
pub trait PoseChecker {
    /// Reports on the pose `q` (rad or m) of these joints.
    fn check(&mut self, joints: &[String], q: &[f64]) -> PoseReport;

    /// Largest settle residual that still counts as reached, rad or m.
    fn tolerance(&self) -> f64 {
        0.05
    }
}

/// All findings about a clip, worst first, then by frame.
pub fn lint(
    clip: &Clip,
    command: &Command,
    table: &JointTable,
    checker: Option<&mut dyn PoseChecker>,
) -> Vec<Lint> {
    let mut found = Finder { clip, command, table, lints: Vec::new(), counts: BTreeMap::new() };
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
    found.rest();
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
    counts: BTreeMap<Rule, usize>,
}

/// The place of a row in the document, and the keys that use it.
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
    fn fix(&self, title: &str, values: &[(&str, usize, f64)]) -> Vec<Fix> {
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
        vec![Fix { title: title.to_owned(), op }]
    }
}

impl<'a> Finder<'a> {
    fn push(&mut self, lint: Lint) {
        let count = self.counts.entry(lint.rule).or_default();
        *count += 1;
        if *count <= MOST {
            self.lints.push(lint);
        }
    }

    /// Whether another finding of this rule is only counted; if so, counts it.
    fn full(&mut self, rule: Rule) -> bool {
        let count = self.counts.entry(rule).or_default();
        let full = *count >= MOST;
        *count += usize::from(full);
        full
    }

    /// Reports how many findings were left out.
    fn rest(&mut self) {
        for (&rule, &count) in &self.counts {
            if count <= MOST {
                continue;
            }
            let frames = None;
            let message = format!("and {} more of this kind", count - MOST);
            let pointer = "/keys".to_owned();
            let (joints, fixes) = (Vec::new(), Vec::new());
            let level = Level::Info;
            self.lints.push(Lint { level, rule, message, frames, joints, pointer, fixes });
        }
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
                fixes: vec![],
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
            let message = format!("the clip lacks joints of the robot: {}", lacking.join(", "));
            whole(Level::Error, Rule::UnknownJoint, message, "/robot/joints", lacking);
        }
        if clip.keys.is_empty() {
            let message = "the clip has no keys, so it commands nothing".to_owned();
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
        let names = &self.clip.robot.joints;
        let facts: Vec<_> = names.iter().map(|name| (name, self.table.joint(name))).collect();
        for place in self.places().iter().chain(&start) {
            let mut out = Vec::new();
            let mut words = Vec::new();
            for (j, ((name, joint), value)) in facts.iter().zip(place.row).enumerate() {
                let Some(joint) = joint else { continue };
                let (Some(v), Some([lo, hi])) = (*value, joint.range) else { continue };
                // The grid of the document is 1e-6; a limit of pi/2 must accept 1.570796.
                if v < lo - 1e-6 || v > hi + 1e-6 {
                    out.push((name.as_str(), j, joint.clamp(v)));
                    let unit = joint.unit.symbol();
                    words.push(format!("{name} {v} {unit} is outside {lo}..{hi}"));
                }
            }
            if out.is_empty() || self.full(Rule::JointLimit) {
                continue;
            }
            let first = out.first().map_or(0, |o| o.1);
            self.push(Lint {
                level: Level::Error,
                rule: Rule::JointLimit,
                message: format!("{}: {}", place.who(), some_of(&words)),
                frames: place.span(),
                joints: out.iter().map(|o| o.0.to_owned()).collect(),
                pointer: format!("{}/{first}", place.pointer),
                fixes: place.fix("Clamp to the limits", &out),
            });
        }
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
        // Joints that are too fast in the same frames are one finding.
        let mut merged: BTreeMap<(u32, u32), Vec<Run>> = BTreeMap::new();
        for run in runs {
            merged.entry((run.from, run.to)).or_default().push(run);
        }
        // Slowing the whole clip down is offered once, at the place that needs it most.
        let top = |runs: &Vec<Run>| runs.iter().map(|r| r.ratio).fold(0.0, f64::max);
        let worst = merged.values().map(top).fold(0.0, f64::max);
        let mut offered = false;
        for ((from, to), runs) in merged {
            let slowest = !offered && top(&runs) >= worst;
            if !slowest && self.full(Rule::JointSpeed) {
                continue;
            }
            offered |= slowest;
            let lint = self.speed_lint(from, to, &runs, slowest);
            self.push(lint);
        }
    }

    fn speed_lint(&self, from: u32, to: u32, runs: &[Run], slowest: bool) -> Lint {
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
        // The length of the interval between the keys around the run scales the speed.
        let keys = &self.clip.keys;
        let next = keys.partition_point(|k| k.frame < to);
        let index = keys.partition_point(|k| k.frame <= from).saturating_sub(1);
        let ratio = ratio * self.between_samples(from, to);
        let mut fixes = Vec::new();
        if let (Some(key), Some(after)) = (keys.get(index), keys.get(next))
            && next == index + 1
        {
            let begin = self.clip.hold_end(index).saturating_sub(1).max(key.frame);
            let have = after.frame - begin;
            // A held value jumps over one frame; only a line can be slower.
            let jumps = self.clip.fill_after(key) == Fill::Hold;
            let need = if jumps { ratio } else { f64::from(have) * ratio }.ceil().min(1e6) as u32;
            let frames = need.saturating_sub(have).max(u32::from(!jumps));
            let (at, room) = (after.frame, self.clip.length + frames <= limits::CLIP_FRAMES);
            let insert = (frames > 0).then_some(Op::TimeInsert(TimeInsert { at, frames }));
            let line = jumps.then(|| {
                let frames = Some(vec![key.frame]);
                Op::FillSet(FillSet { frames, fill: Some(Fill::Linear) })
            });
            let title = match (&line, &insert) {
                (None, _) => format!("Allow {frames} more frames before frame {at}"),
                (Some(_), None) => format!("Interpolate linearly from frame {begin} to {at}"),
                (Some(_), Some(_)) => {
                    format!("Interpolate linearly and allow {frames} more frames")
                }
            };
            let mut ops: Vec<Op> = line.into_iter().chain(insert).collect();
            let op = match (ops.pop(), ops.is_empty()) {
                (Some(one), true) => one,
                (last, _) => {
                    ops.extend(last);
                    Op::Batch(Batch { label: title.clone(), ops })
                }
            };
            if room {
                fixes.push(Fix { title, op });
            }
        }
        if slowest {
            fixes.extend(self.slow_down(from, to, ratio));
        }
        Lint {
            level: Level::Warning,
            rule: Rule::JointSpeed,
            message: format!("too fast: {}", some_of(&words)),
            frames: Some([from, to + 1]),
            joints,
            pointer: format!("/keys/{}", next.min(keys.len().saturating_sub(1))),
            fixes,
        }
    }

    /// How much faster a cubic may be between its frames than on them: a longer interval
    /// samples its steepest point better. 1 - (4/3)/L^2 of the peak is seen over L frames.
    fn between_samples(&self, from: u32, to: u32) -> f64 {
        let spans = self.command.spans();
        let first = spans.partition_point(|s| s.to <= from);
        let near = spans.iter().skip(first).take_while(|s| s.from <= to);
        let cubic = near.filter(|s| s.kind == SpanKind::Cubic);
        let shortest = cubic.map(|s| s.to - s.from + 1).min();
        shortest.map_or(1.0, |l| 1.0 / (1.0 - 4.0 / 3.0 / f64::from(l * l)).max(2.0 / 3.0))
    }

    /// Slows everything down by the smallest factor that is enough after rounding to frames.
    fn slow_down(&self, from: u32, to: u32, ratio: f64) -> Option<Fix> {
        let clip = self.clip;
        let scaled = |frames: u32, factor: f64| (f64::from(frames) * factor).round();
        let enough = |factor: &f64| {
            clip.keys.windows(2).enumerate().all(|(i, pair)| {
                let [key, next] = pair else { return true };
                let last = clip.hold_end(i).saturating_sub(1).max(key.frame);
                if next.frame <= from || last >= to {
                    return true;
                }
                if clip.fill_after(key) == Fill::Hold {
                    return false; // a jump stays a jump
                }
                let held = scaled(key.frame, *factor) + scaled(last - key.frame, *factor);
                let room = scaled(next.frame, *factor) - held;
                room >= f64::from(next.frame - last) * ratio - 1e-6
            })
        };
        let fine = (ratio * 100.0).ceil() / 100.0;
        let tries = [fine, fine * 1.02, fine * 1.05, fine * 1.1, fine.ceil()];
        let factor = tries.into_iter().map(|f| (f * 100.0).round() / 100.0).find(enough)?;
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
        Some(Fix { title: title.clone(), op: Op::Batch(Batch { label: title, ops }) })
    }

    fn blind(&mut self) {
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
            let message = format!(
                "no goal from frame {from} to {}: for {steps} {plural} the policy sees none, so it follows a straight line",
                to - 1
            );
            let key = blind
                .before
                .map_or(self.clip.keys.len(), |b| self.clip.keys.partition_point(|k| k.frame < b));
            let fixes = self.blind_fixes(blind.after, from, to);
            self.push(Lint {
                level: Level::Warning,
                rule: Rule::BlindSpan,
                message,
                frames: Some([from, to]),
                joints: Vec::new(),
                pointer: format!("/keys/{}", key.min(self.clip.keys.len().saturating_sub(1))),
                fixes,
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
        // Hold: the last goal stays until 20 frames before the next one.
        let holder = after.and_then(|a| {
            let i = clip.keys.partition_point(|k| k.frame <= a).checked_sub(1)?;
            clip.keys.get(i).filter(|k| clip.hold_end(i) == a + 1 && k.frame <= a)
        });
        if let Some(key) = holder {
            let hold = to - LOOKAHEAD_FRAMES - key.frame + 1;
            let op = Op::KeysHold(KeysHold { frames: vec![key.frame], hold });
            fixes.push(Fix { title: format!("Hold the key at {} longer", key.frame), op });
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
            let title = match keys.len() {
                1 => "Insert a key on the way".to_owned(),
                n => format!("Insert {n} keys on the way"),
            };
            fixes.push(Fix { title, op: Op::KeysAdd(KeysAdd { keys, replace: false }) });
        }
        fixes
    }

    fn coupled(&mut self) {
        let mut lints = Vec::new();
        for place in self.places() {
            for coupling in &self.table.couplings {
                lints.extend(self.coupled_in(&place, coupling));
            }
        }
        for lint in lints {
            self.push(lint);
        }
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
        let even: Vec<(&str, usize, f64)> = shared
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
                "{}: {} share {} and cannot be {:.3} apart",
                place.who(),
                joints.join(" and "),
                coupling.name,
                hi - lo
            ),
            frames: place.span(),
            joints,
            pointer: format!("{}/{first}", place.pointer),
            fixes: place.fix("Split evenly", &even),
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
                    "frames {from} to {} have goals for some joints only, but this policy was trained on whole frames",
                    at - 1
                ),
                frames: Some([from, at]),
                joints,
                pointer: format!("/keys/{key}"),
                fixes: vec![Fix { title: "Mask these frames for all joints".to_owned(), op }],
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
                    fixes: vec![Fix { title: "Unmask the key".to_owned(), op: Op::MaskSet(set) }],
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
                });
            }
        }
        for lint in lints {
            self.push(lint);
        }
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
                    fixes: settled(&place, joints, report.settled.as_deref()),
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
                message: format!(
                    "{}: the robot does not reach the pose: {}",
                    place.who(),
                    some_of(&words)
                ),
                frames: place.span(),
                joints: off.iter().map(|(j, _)| (*j).clone()).collect(),
                pointer: place.pointer.clone(),
                fixes: settled(&place, joints, Some(reached)),
            });
        }
        for lint in lints {
            self.push(lint);
        }
    }
}

fn settled(place: &Place<'_>, joints: &[String], reached: Option<&[f64]>) -> Vec<Fix> {
    let Some(reached) = reached else { return Vec::new() };
    let values: Vec<(&str, usize, f64)> =
        joints.iter().zip(reached).enumerate().map(|(i, (j, v))| (j.as_str(), i, *v)).collect();
    place.fix("Store the pose that is reached", &values)
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
