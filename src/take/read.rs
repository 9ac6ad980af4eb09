//! Reads takes, bit for bit; damage is reported with its byte.
//!
//! Files are treated as hostile: sizes are limited, every record is checked, unknown topics and
//! records are skipped. [`Take::read`] requires the whole file; [`Take::recover`] returns the
//! frames before the damage.

use std::collections::BTreeMap;
use std::path::Path;

use prost::Message as _;

use super::cdr;
use super::document::{POSE, Take};
use super::error::{Damage, Error};
use super::header::{CLIP_JSON, Header, MODEL_CARD, TAKE_JSON};
use super::proto::{FrameTransforms, Metrics};
use super::records::{Channel, Fields, MAGIC, Message, Record, Records, attachment, op, unpack};
use super::scene::COMMAND_PREFIX;
use super::write::{frame_at, topic};
use robert_base::fsio;
use robert_base::limits;
use robert_clip::Command;

/// A take from a damaged file.
#[derive(Clone, Debug, PartialEq)]
pub struct Recovered {
    /// The frames before the damage.
    pub take: Take,
    /// The damage; `None` if the file was intact.
    pub damage: Option<Damage>,
}

impl Take {
    /// Reads a whole take.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::Damaged`], [`Error::Foreign`].
    pub fn read(path: &Path) -> Result<Take, Error> {
        let bytes = fsio::read_capped(path, limits::TAKE_BYTES)?;
        Take::from_mcap(&bytes).map_err(|e| e.in_file(path))
    }

    /// Reads the frames before any damage.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::Foreign`]; [`Error::Damaged`] when not even one frame is
    /// left.
    pub fn recover(path: &Path) -> Result<Recovered, Error> {
        let bytes = fsio::read_capped(path, limits::TAKE_BYTES)?;
        Take::recover_mcap(&bytes).map_err(|e| e.in_file(path))
    }

    /// As [`Take::read`], for bytes in memory.
    ///
    /// # Errors
    /// [`Error::Damaged`], [`Error::Foreign`].
    pub fn from_mcap(bytes: &[u8]) -> Result<Take, Error> {
        let (scan, damage) = scan(bytes)?;
        if let Some(damage) = damage {
            let frames = scan.whole_frames();
            return Err(Error::Damaged { damage, frames, path: None });
        }
        scan.take(true)
    }

    /// As [`Take::recover`], for bytes in memory.
    ///
    /// # Errors
    /// [`Error::Damaged`], [`Error::Foreign`].
    pub fn recover_mcap(bytes: &[u8]) -> Result<Recovered, Error> {
        let (scan, damage) = scan(bytes)?;
        let take = match (scan.take(damage.is_none()), &damage) {
            (Ok(take), _) => take,
            (Err(Error::Foreign { .. }), Some(damage)) => {
                return Err(Error::Damaged { damage: damage.clone(), frames: 0, path: None });
            }
            (Err(e), _) => return Err(e),
        };
        Ok(Recovered { take, damage })
    }
}

/// The topic of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Topic {
    JointStates,
    Command,
    Tf,
    CommandTf,
    Metrics,
}

/// The content of a file.
#[derive(Debug, Default)]
struct Scan {
    header: Option<Header>,
    clip_text: Option<String>,
    policy_card: Option<String>,
    channels: BTreeMap<u16, Topic>,
    reached: Vec<f64>,
    velocity: Vec<f64>,
    effort: Vec<f64>,
    poses: Vec<f64>,
    actions: Vec<f64>,
    ctrl: Vec<f64>,
    /// Frames whose last message has been read.
    frames: usize,
    goals: Vec<f32>,
    visible: Vec<bool>,
    ghost: Vec<Option<Vec<f64>>>,
}

/// Reads all records; stops at the first damage.
fn scan(bytes: &[u8]) -> Result<(Scan, Option<Damage>), Error> {
    let mut scan = Scan::default();
    if !bytes.starts_with(MAGIC) {
        let empty = if bytes.is_empty() { "the file is empty" } else { "this is not an MCAP file" };
        // A file truncated within its first bytes is damaged, not foreign.
        if !bytes.is_empty() && MAGIC.starts_with(bytes) {
            return Ok((scan, Some(Damage::at(0, "the file ends inside its first bytes"))));
        }
        return Err(Error::foreign(empty));
    }
    let damage = match walk(bytes, &mut scan) {
        Ok(()) => None,
        Err(Stop::Damage(damage)) => Some(damage),
        Err(Stop::Foreign(e)) => return Err(e),
    };
    Ok((scan, damage))
}

enum Stop {
    Damage(Damage),
    Foreign(Error),
}

impl From<Damage> for Stop {
    fn from(damage: Damage) -> Stop {
        Stop::Damage(damage)
    }
}

fn walk(bytes: &[u8], scan: &mut Scan) -> Result<(), Stop> {
    let mut budget = limits::TAKE_UNPACKED_BYTES;
    // The closing magic is not a record and is left out.
    let end = if bytes.len() >= 2 * MAGIC.len() && bytes.ends_with(MAGIC) {
        bytes.len() - MAGIC.len()
    } else {
        bytes.len()
    };
    let mut records = Records::new(bytes.get(..end).unwrap_or_default(), MAGIC.len());
    let mut data_end = None;
    let mut footer = false;
    while let Some(record) = records.next() {
        let record = record?;
        if footer {
            return Err(Damage::at(record.offset, "a record after the last one").into());
        }
        if data_end.is_some() {
            // The summary repeats the content; only its end matters here.
            footer = record.op == op::FOOTER;
            continue;
        }
        match record.op {
            op::CHUNK => {
                let inner = unpack(record, &mut budget)?;
                let mut inside = Records::new(&inner, 0);
                while let Some(found) = inside.next() {
                    // Inside a chunk, the place in the file is that of the chunk.
                    let at = |d: Damage| Damage { offset: record.offset as u64, ..d };
                    let found = found.map_err(at)?;
                    scan.record(Record { offset: record.offset, ..found })?;
                }
            }
            op::ATTACHMENT => scan.attachment(record)?,
            op::DATA_END => {
                let crc = Fields::new(record.body).u32();
                let hashed = bytes.get(..record.offset).unwrap_or_default();
                match crc {
                    None => return Err(Damage::at(record.offset, "an end record cut short").into()),
                    Some(crc) if crc != 0 && crc32fast::hash(hashed) != crc => {
                        let problem = "the checksum of the data before it is wrong";
                        return Err(Damage::at(record.offset, problem).into());
                    }
                    Some(_) => data_end = Some(record.offset),
                }
            }
            op::HEADER => {}
            _ => scan.record(record)?,
        }
    }
    if !footer || end == bytes.len() {
        return Err(Damage::at(records.at(), "the file ends before its closing records").into());
    }
    Ok(())
}

impl Scan {
    fn attachment(&mut self, record: Record<'_>) -> Result<(), Stop> {
        let (name, data) = attachment(record)?;
        match name {
            TAKE_JSON if self.header.is_none() => {
                let header = Header::parse(data).map_err(Stop::Foreign)?;
                let cells = header.command_frames as usize * header.robot.joints.len();
                self.goals = vec![0.0; cells];
                self.visible = vec![false; cells];
                self.ghost = vec![None; header.command_frames as usize];
                self.header = Some(header);
            }
            CLIP_JSON if self.clip_text.is_none() => {
                let text = std::str::from_utf8(data)
                    .or(Err(Damage::at(record.offset, "clip.json is not UTF-8")))?;
                let sha = fsio::sha256_hex(data);
                if self.header.as_ref().is_some_and(|h| h.clip_sha256.as_ref() != Some(&sha)) {
                    let problem = "clip.json is not the clip that take.json refers to";
                    return Err(Damage::at(record.offset, problem).into());
                }
                self.clip_text = Some(text.to_owned());
            }
            MODEL_CARD if self.policy_card.is_none() => {
                let text = std::str::from_utf8(data)
                    .or(Err(Damage::at(record.offset, "model_card.json is not UTF-8")))?;
                self.policy_card = Some(text.to_owned());
            }
            _ => {}
        }
        Ok(())
    }

    fn record(&mut self, record: Record<'_>) -> Result<(), Stop> {
        let broken = |what: &str| Stop::Damage(Damage::at(record.offset, what.to_owned()));
        match record.op {
            op::CHANNEL => {
                let channel = Channel::parse(record.body)
                    .ok_or_else(|| broken("a channel record whose lengths disagree"))?;
                let topic = match (channel.topic, channel.encoding) {
                    (topic::JOINT_STATES, "cdr") => Topic::JointStates,
                    (topic::COMMAND_JOINT_STATES, "cdr") => Topic::Command,
                    (topic::TF, "protobuf") => Topic::Tf,
                    (topic::COMMAND_TF, "protobuf") => Topic::CommandTf,
                    (topic::METRICS, "protobuf") => Topic::Metrics,
                    _ => return Ok(()),
                };
                self.channels.insert(channel.id, topic);
            }
            op::MESSAGE => {
                let message =
                    Message::parse(record.body).ok_or_else(|| broken("a message cut short"))?;
                let Some(&topic) = self.channels.get(&message.channel) else { return Ok(()) };
                if self.header.is_none() {
                    let problem =
                        format!("there is no {TAKE_JSON}, so this is not a take of this program");
                    return Err(Stop::Foreign(Error::foreign(problem)));
                }
                if message.data.len() > limits::TAKE_MESSAGE_BYTES {
                    return Err(broken("a message larger than any of a take"));
                }
                self.message(topic, message).ok_or_else(|| {
                    broken(&format!("a {} message that does not fit", name(topic)))
                })?;
            }
            _ => {}
        }
        Ok(())
    }

    /// `None` if the message is not the next one of this take.
    fn message(&mut self, topic: Topic, message: Message<'_>) -> Option<()> {
        let header = self.header.as_ref()?;
        let frame = frame_at(message.log_time)?;
        let (dim, bodies) = (header.robot.joints.len(), header.robot.bodies.len());
        let next = frame == self.frames && frame < header.frames;
        match topic {
            Topic::JointStates => {
                let mut r = cdr::Reader::stamped(message.data)?;
                if !next || r.u32()? as usize != dim || self.reached.len() != frame * dim {
                    return None;
                }
                for joint in &header.robot.joints {
                    if r.text()? != joint {
                        return None;
                    }
                }
                let last = frame + 1 == header.frames;
                let whole = r.doubles(&mut self.reached)? == dim
                    && r.doubles(&mut self.velocity)? == dim
                    && r.doubles(&mut self.effort)? == if last { 0 } else { dim };
                let rows = [&self.reached, &self.velocity, &self.effort];
                let mut fresh = rows.iter().flat_map(|row| row.iter().skip(frame * dim));
                (whole && fresh.all(|v| v.is_finite())).then_some(())
            }
            Topic::Tf => {
                if !next || self.poses.len() != frame * bodies * POSE {
                    return None;
                }
                let poses = poses(message.data, &header.robot.bodies, "")?;
                self.poses.extend(poses);
                Some(())
            }
            Topic::Metrics => {
                let m = Metrics::decode(message.data).ok()?;
                let n = if frame + 1 == header.frames { 0 } else { header.robot.actuators.len() };
                let sizes = m.action.len() == n && m.ctrl.len() == n;
                let whole = self.reached.len() == (frame + 1) * dim
                    && self.poses.len() == (frame + 1) * bodies * POSE;
                let fine = m.action.iter().chain(&m.ctrl).all(|v| v.is_finite());
                if !next || !sizes || !whole || !fine {
                    return None;
                }
                self.actions.extend(m.action);
                self.ctrl.extend(m.ctrl);
                self.frames += 1;
                Some(())
            }
            Topic::Command => {
                let mut r = cdr::Reader::stamped(message.data)?;
                let n = r.u32()? as usize;
                if n > dim || frame >= header.command_frames as usize {
                    return None;
                }
                let mut seen = Vec::with_capacity(n);
                for _ in 0..n {
                    let joint = r.text()?.strip_prefix(COMMAND_PREFIX)?;
                    seen.push(header.robot.joints.iter().position(|j| j == joint)?);
                }
                let mut values = Vec::with_capacity(n);
                if r.doubles(&mut values)? != n {
                    return None;
                }
                for (j, v) in seen.into_iter().zip(values) {
                    let at = frame * dim + j;
                    // Our commands are in single precision.
                    let goal = v as f32;
                    if f64::from(goal) != v || !goal.is_finite() {
                        return None;
                    }
                    *self.goals.get_mut(at)? = goal;
                    *self.visible.get_mut(at)? = true;
                }
                Some(())
            }
            Topic::CommandTf => {
                let poses = poses(message.data, &header.robot.bodies, COMMAND_PREFIX)?;
                *self.ghost.get_mut(frame)? = Some(poses);
                Some(())
            }
        }
    }

    fn whole_frames(&self) -> usize {
        self.frames
    }

    /// The take; with `whole`, every frame of the header must be there.
    fn take(self, whole: bool) -> Result<Take, Error> {
        let Some(header) = self.header else {
            return Err(Error::foreign(format!(
                "there is no {TAKE_JSON}, so this is not a take of this program"
            )));
        };
        let (dim, actuators) = (header.robot.joints.len(), header.robot.actuators.len());
        let n = self.frames;
        if n == 0 || (whole && n < header.frames) {
            return Err(Error::foreign(format!("only {n} of {} frames are there", header.frames)));
        }
        if whole && header.clip_sha256.is_some() != self.clip_text.is_some() {
            return Err(Error::foreign(format!("{CLIP_JSON} is missing")));
        }
        // Beyond the damage the command is unknown too.
        let asked = if whole { header.command_frames as usize } else { n };
        let asked = asked.min(header.command_frames as usize);
        let cut = |mut v: Vec<f64>, len: usize| {
            v.truncate(len);
            v
        };
        let (mut goals, mut visible, mut ghost) = (self.goals, self.visible, self.ghost);
        goals.truncate(asked * dim);
        visible.truncate(asked * dim);
        ghost.truncate(asked);
        let joints = header.robot.joints.clone();
        let command = Command::from_dense(joints, header.start, goals, visible)
            .ok_or_else(|| Error::foreign("the command does not have the size that it states"))?;
        let bodies = header.robot.bodies.len();
        Ok(Take {
            clip_text: self.clip_text,
            command,
            reached: cut(self.reached, n * dim),
            velocity: cut(self.velocity, n * dim),
            effort: cut(self.effort, (n - 1) * dim),
            actions: cut(self.actions, (n - 1) * actuators),
            ctrl: cut(self.ctrl, (n - 1) * actuators),
            poses: cut(self.poses, n * bodies * POSE),
            ghost,
            provenance: header.provenance,
            policy_card: self.policy_card,
            robot: header.robot,
        })
    }
}

fn name(topic: Topic) -> &'static str {
    match topic {
        Topic::JointStates => topic::JOINT_STATES,
        Topic::Command => topic::COMMAND_JOINT_STATES,
        Topic::Tf => topic::TF,
        Topic::CommandTf => topic::COMMAND_TF,
        Topic::Metrics => topic::METRICS,
    }
}

/// Poses of all bodies in their order; (B, 7).
fn poses(data: &[u8], bodies: &[String], prefix: &str) -> Option<Vec<f64>> {
    let message = FrameTransforms::decode(data).ok()?;
    if message.transforms.len() != bodies.len() {
        return None;
    }
    let mut out = Vec::with_capacity(bodies.len() * POSE);
    for (t, body) in message.transforms.iter().zip(bodies) {
        if t.child_frame_id.strip_prefix(prefix)? != body {
            return None;
        }
        let (p, q) = (t.translation?, t.rotation?);
        out.extend([p.x, p.y, p.z, q.w, q.x, q.y, q.z]);
    }
    out.iter().all(|v| v.is_finite()).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;
    use robert_base::rng::{Rng, Stream};
    use robert_rollout::Goals;

    /// Equal except for the spans of a compiled command, which come from its clip.
    fn assert_same(a: &Take, b: &Take) {
        assert_eq!(a.command.first_changed_frame(&b.command), None);
        assert_eq!(Goals::new(&a.command), Goals::new(&b.command));
        let with = Take { command: a.command.clone(), ..b.clone() };
        assert_eq!(a, &with);
        assert_eq!(a.precision(), b.precision());
    }

    #[test]
    fn a_take_comes_back_bit_for_bit() {
        for id in ["pointmass", "ur5e", "shadow_hand"] {
            let (robot, take) = sample::take(id, 40, 40);
            let scene = take.scene(&robot).unwrap();
            let bytes = take.to_mcap(Some(&scene)).unwrap();
            assert_same(&take, &Take::from_mcap(&bytes).unwrap());
            assert_eq!(bytes, take.to_mcap(Some(&scene)).unwrap(), "{id}: not deterministic");
        }
    }

    #[test]
    fn a_partial_rollout_is_a_take() {
        let (_, take) = sample::take("ur5e", 40, 17);
        assert_eq!((take.frames(), take.command.frames()), (17, 40));
        let bytes = take.to_mcap(None).unwrap();
        assert_same(&take, &Take::from_mcap(&bytes).unwrap());
        let (_, start) = sample::take("ur5e", 40, 1);
        let bytes = start.to_mcap(None).unwrap();
        assert_same(&start, &Take::from_mcap(&bytes).unwrap());
    }

    #[test]
    fn clips_that_leave_single_joints_open_come_back() {
        let (robot, mut take) = sample::take("ur5e", 30, 30);
        let mut clip = sample::clip(&robot, 30);
        let joints = Some(vec![robot.joints()[1].name.clone()]);
        clip.masks = vec![robert_clip::Mask { from: 8, to: 13, joints }];
        take.command = robert_clip::compile(&clip).unwrap();
        take.ghost = (0..30).map(|_| None).collect();
        let bytes = take.to_mcap(None).unwrap();
        assert_same(&take, &Take::from_mcap(&bytes).unwrap());
    }

    /// A file that is truncated at any byte gives an error with a place inside the file. The
    /// recovered part is a beginning of the take, and a longer file never gives a shorter part.
    /// Twelve frames in a normal run; `ROBERT_FRAMES=100` gives a file of 200 kB.
    #[test]
    fn every_prefix_is_an_error_or_a_shorter_take() {
        let length = asked("ROBERT_FRAMES").map_or(12, |n| n as u32);
        let (_, take) = sample::take("ur5e", length, length as usize);
        let bytes = take.to_mcap(None).unwrap();
        let (mut longest, mut recovered) = (0, 0);
        for cut in 0..bytes.len() {
            let prefix = &bytes[..cut];
            match Take::from_mcap(prefix) {
                Err(Error::Damaged { damage, frames, .. }) => {
                    assert!(damage.offset <= cut as u64, "{cut}: {damage}");
                    longest = longest.max(frames);
                }
                Err(Error::Foreign { .. }) if cut == 0 => {}
                other => panic!("{cut}: {other:?}"),
            }
            if let Ok(found) = Take::recover_mcap(prefix) {
                assert!(found.damage.is_some());
                let n = found.take.frames();
                assert!(n >= recovered, "{cut}: {n} frames, {recovered} of a shorter file");
                recovered = n;
                assert_eq!(found.take.reached, take.reached[..n * take.state_dim()], "{cut}");
                assert_eq!(found.take.poses[..], take.poses[..found.take.poses.len()], "{cut}");
            }
        }
        let all = take.frames();
        assert_eq!((longest, recovered), (all, all), "no prefix gave all frames");
        println!("{} prefixes", bytes.len());
    }

    fn asked(name: &str) -> Option<u64> {
        std::env::var(name).ok().and_then(|n| n.parse().ok())
    }

    /// The number of files of a fuzz test: `ROBERT_FUZZ`, or a number that suits a normal run.
    fn rounds(usual: u64) -> u64 {
        asked("ROBERT_FUZZ").unwrap_or(usual)
    }

    /// Processor time of this thread, so that a busy machine does not look like a hang.
    fn cpu() -> std::time::Duration {
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
        let nanos = text.split_whitespace().next().and_then(|n| n.parse().ok()).unwrap_or(0);
        std::time::Duration::from_nanos(nanos)
    }

    /// Peak memory of this process, kB. It is meaningful only if one test runs alone.
    fn peak_kb() -> u64 {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap();
        peak.trim().trim_end_matches(" kB").parse().unwrap()
    }

    /// Reads `rounds` files; none may panic, take a second, or 256 MB.
    fn survive(what: &str, rounds: u64, file: impl Fn(u64) -> Vec<u8>) -> u64 {
        let (mut whole, mut some, mut slowest) = (0, 0, std::time::Duration::ZERO);
        let first = asked("ROBERT_FUZZ_FROM").unwrap_or(0);
        let begin = std::time::Instant::now();
        for round in first..first + rounds {
            let bytes = file(round);
            let start = cpu();
            if let Ok(take) = Take::from_mcap(&bytes) {
                whole += 1;
                assert_eq!(take.reached.len() % take.state_dim(), 0);
                assert!(take.reached.iter().all(|v| v.is_finite()));
                take.precision();
            }
            if let Ok(found) = Take::recover_mcap(&bytes) {
                some += 1;
                found.take.precision();
            }
            slowest = slowest.max(cpu().saturating_sub(start));
        }
        assert!(slowest.as_secs_f64() < 1.0, "{slowest:?}");
        if asked("ROBERT_FUZZ").is_some() {
            let (secs, peak) = (begin.elapsed().as_secs_f64(), peak_kb());
            println!(
                "{what}: {rounds} inputs, {whole} taken, {some} recovered, {secs:.0} s, slowest {slowest:?}, peak {peak} kB"
            );
            assert!(peak < 256 << 10, "{peak} kB");
        }
        whole
    }

    /// Random damage gives an error or a take with plausible sizes, without a panic or endless
    /// work.
    #[test]
    fn mutated_files_never_panic() {
        let (_, take) = sample::take("pointmass", 10, 10);
        let bytes = take.to_mcap(None).unwrap();
        let rounds = rounds(4_000);
        let whole =
            survive("files", rounds, |round| mutate(&bytes, Rng::new(11, Stream::Test, round)));
        assert!(whole < rounds, "damage is never noticed");
    }

    fn mutate(bytes: &[u8], mut rng: Rng) -> Vec<u8> {
        let mut out = bytes.to_vec();
        for _ in 0..=rng.below(4) {
            if out.is_empty() {
                break;
            }
            let at = rng.below(out.len() as u64) as usize;
            match rng.below(6) {
                0 => out[at] ^= 1 << rng.below(8),
                1 => out[at] = rng.below(256) as u8,
                2 => out.truncate(at.max(1)),
                3 => {
                    let end = (at + 8).min(out.len());
                    out[at..end].fill([0x00, 0xff, 0x7f][rng.below(3) as usize]);
                }
                4 => {
                    let to = rng.below(out.len() as u64) as usize;
                    let n = (rng.below(64) as usize).min(out.len() - at.max(to));
                    out.copy_within(at..at + n, to);
                }
                _ => {
                    out.remove(at);
                }
            }
        }
        out
    }

    /// The checksums would hide most damage from the code behind them, so they are removed too.
    #[test]
    fn damage_behind_the_checksums_is_refused_or_read() {
        let (front, chunk) = opened();
        let whole = survive("chunks", rounds(3_000), |round| {
            closed(&front, &mutate(&chunk, Rng::new(12, Stream::Test, round)))
        });
        assert_eq!(whole, 0, "without closing records no file is whole");
    }

    #[test]
    fn a_message_may_be_a_mebibyte_and_not_a_byte_more() {
        let (front, chunk) = opened();
        let grown = |to: usize| {
            let mut records = Records::new(&chunk, 0);
            let mut states = None;
            let first = std::iter::from_fn(|| records.next()?.ok()).find(|r| match r.op {
                op::CHANNEL => {
                    let channel = Channel::parse(r.body).unwrap();
                    states =
                        states.or((channel.topic == topic::JOINT_STATES).then_some(channel.id));
                    false
                }
                op::MESSAGE => {
                    states.is_some() && states == Message::parse(r.body).map(|m| m.channel)
                }
                _ => false,
            });
            let (at, own) = first.map(|r| (r.offset, r.body.len())).unwrap();
            let data = Message::parse(&chunk[at + 9..at + 9 + own]).unwrap().data.len();
            let mut inner = chunk[..at + 9 + own].to_vec();
            inner.resize(inner.len() + to - data, 0);
            inner[at + 1..at + 9].copy_from_slice(&((own + to - data) as u64).to_le_bytes());
            inner.extend(&chunk[at + 9 + own..]);
            Take::from_mcap(&closed(&front, &inner)).unwrap_err().to_string()
        };
        let larger = "a message larger than any of a take";
        assert!(!grown(limits::TAKE_MESSAGE_BYTES).contains(larger));
        let refused = grown(limits::TAKE_MESSAGE_BYTES + 1);
        assert!(refused.contains(larger), "{refused}");
    }

    /// What stands before the chunk of a small take, and the chunk's records.
    fn opened() -> (Vec<u8>, Vec<u8>) {
        let (_, take) = sample::take("pointmass", 10, 10);
        let bytes = take.to_mcap(None).unwrap();
        let (scan, _) = scan(&bytes).unwrap();
        assert_eq!(scan.frames, 10);
        let mut records = Records::new(&bytes[..bytes.len() - 8], 8);
        let (mut front, mut chunk) = (Vec::new(), None);
        while let Some(Ok(r)) = records.next() {
            if r.op == op::CHUNK {
                chunk = Some(unpack(r, &mut limits::TAKE_UNPACKED_BYTES.clone()).unwrap().to_vec());
                front = bytes[..r.offset].to_vec();
            }
        }
        (front, chunk.unwrap())
    }

    /// A file with these records in an unpacked chunk without a checksum, and without its closing records.
    fn closed(front: &[u8], inner: &[u8]) -> Vec<u8> {
        let mut file = front.to_vec();
        file.push(op::CHUNK);
        file.extend((40 + inner.len() as u64).to_le_bytes());
        file.extend([0; 16]);
        file.extend((inner.len() as u64).to_le_bytes());
        file.extend([0; 8]); // no checksum, no compression
        file.extend((inner.len() as u64).to_le_bytes());
        file.extend(inner);
        file
    }

    #[test]
    fn foreign_files_say_so() {
        let message = |bytes: &[u8]| Take::from_mcap(bytes).unwrap_err().to_string();
        assert!(message(b"hello, this is a text").contains("not an MCAP"), "{}", message(b"hello"));
        let mut writer =
            mcap::WriteOptions::new().create(std::io::Cursor::new(Vec::new())).unwrap();
        let none = BTreeMap::new();
        let id = writer.add_channel(0, topic::JOINT_STATES, "cdr", &none).unwrap();
        let header = mcap::records::MessageHeader {
            channel_id: id,
            sequence: 0,
            log_time: 0,
            publish_time: 0,
        };
        writer.write_to_known_channel(&header, &[0, 1, 0, 0]).unwrap();
        writer.finish().unwrap();
        let bytes = writer.into_inner().into_inner();
        assert!(message(&bytes).contains("take.json"), "{}", message(&bytes));
    }
}
