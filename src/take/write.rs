//! Writes a take as MCAP.
//!
//! Attachments and metadata come first, then the frames in order of time, so a truncated file can
//! still be identified and its frames recovered. Chunks are small for the same reason; they cost a
//! few per cent of size.

use robert_base::json;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions, Writer};
use prost::Message as _;

use super::cdr;
use super::document::{POSE, Take};
use super::error::Error;
use super::header::{CLIP_JSON, CONFIG_TOML, FORMAT, Header, MODEL_CARD, TAKE_JSON};
use super::proto::{
    self, FrameTransform, FrameTransforms, JointError, Log, Metrics, Quaternion, Vector3,
};
use super::scene::{COMMAND_PREFIX, SCENE_BYTES, Scene, WORLD};
use robert_base::fsio;
use robert_base::units::FPS;
use robert_clip::Sight;

/// Seconds since 1970 at frame 0 of every take: 2026-01-01. A constant, so that equal
/// rollouts are equal files; after 1990, so that viewers show times and not durations.
pub const EPOCH_SECS: u64 = 1_767_225_600;

/// Nanoseconds of a frame.
const FRAME_NANOS: u64 = 1_000_000_000 / FPS as u64;

/// Bytes of a chunk before compression: about two seconds of a hand.
const CHUNK_BYTES: u64 = 256 << 10;

/// Levels of lines in the log.
const INFO: i32 = 2;
const WARNING: i32 = 3;

/// Names of the topics.
pub mod topic {
    /// Achieved joint states.
    pub const JOINT_STATES: &str = "/joint_states";
    /// Commanded joint states, masked joints left out.
    pub const COMMAND_JOINT_STATES: &str = "/command/joint_states";
    /// All commanded frames as one trajectory.
    pub const COMMAND_TRAJECTORY: &str = "/command/trajectory";
    /// Achieved body poses.
    pub const TF: &str = "/tf";
    /// Commanded body poses.
    pub const COMMAND_TF: &str = "/command/tf";
    /// Geometry.
    pub const SCENE: &str = "/scene";
    /// Errors, actions, controls.
    pub const METRICS: &str = "/robert/metrics";
    /// Remarks.
    pub const LOG: &str = "/log";
}

/// Log time of a frame.
pub(super) fn nanos(frame: usize) -> u64 {
    EPOCH_SECS * 1_000_000_000 + frame as u64 * FRAME_NANOS
}

/// The frame of a log time; `None` off the grid.
pub(super) fn frame_at(nanos: u64) -> Option<usize> {
    let since = nanos.checked_sub(EPOCH_SECS * 1_000_000_000)?;
    since.is_multiple_of(FRAME_NANOS).then(|| usize::try_from(since / FRAME_NANOS).ok()).flatten()
}

impl Take {
    /// Writes the take as MCAP, atomically.
    ///
    /// `scene` is the geometry for viewers ([`Take::scene`]); without it they have only frames.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::Encode`].
    pub fn write(&self, path: &Path, scene: Option<&Scene>) -> Result<(), Error> {
        Ok(fsio::write_atomic(path, &self.to_mcap(scene)?)?)
    }

    /// The take as MCAP.
    ///
    /// # Errors
    /// [`Error::Encode`].
    pub fn to_mcap(&self, scene: Option<&Scene>) -> Result<Vec<u8>, Error> {
        self.encode(scene).map_err(|e| Error::Encode { what: "the take", problem: e.to_string() })
    }

    fn encode(&self, scene: Option<&Scene>) -> mcap::McapResult<Vec<u8>> {
        let options = WriteOptions::new()
            .compression(Some(Compression::Zstd))
            // Worker threads would make the bytes depend on the machine.
            .compression_threads(0)
            .compression_level(9)
            .chunk_size(Some(CHUNK_BYTES))
            .library(format!("robert {}", env!("CARGO_PKG_VERSION")));
        let mut out = Out { writer: options.create(Cursor::new(Vec::new()))?, sequence: 0 };
        self.front(&mut out)?;
        let channels = Channels::new(&mut out)?;
        let names: Vec<String> =
            self.robot.joints.iter().map(|j| format!("{COMMAND_PREFIX}{j}")).collect();
        out.put(channels.command_trajectory, 0, &self.trajectory())?;
        let (shapes, left_out) = scene.map_or((None, None), |s| s.message(nanos(0), SCENE_BYTES));
        if let Some(shapes) = shapes {
            out.put(channels.scene, 0, &shapes.encode_to_vec())?;
        }
        let left_out = left_out.map(|what| (WARNING, what.to_owned()));
        for (level, message) in self.remarks().into_iter().chain(left_out) {
            let name = "robert".to_owned();
            let log = Log { timestamp: proto::timestamp(nanos(0)), level, message, name };
            out.put(channels.log, 0, &log.encode_to_vec())?;
        }
        for f in 0..self.frames().max(self.command.frames() as usize) {
            self.frame(&mut out, &channels, &names, f)?;
        }
        out.writer.finish()?;
        Ok(out.writer.into_inner().into_inner())
    }

    fn front<W: std::io::Write + std::io::Seek>(&self, out: &mut Out<W>) -> mcap::McapResult<()> {
        let header = Header::of(self);
        // Numbers and strings only: serialising cannot fail.
        let text = json::pretty(&header).into_bytes();
        let mut pairs = BTreeMap::new();
        let mut pair = |key: &str, value: String| drop(pairs.insert(key.to_owned(), value));
        pair("format", FORMAT.to_owned());
        pair("robot", self.robot.id.clone());
        pair("robot_model_sha256", self.robot.model_sha256.clone());
        pair("policy", self.provenance.policy.clone());
        if let Some(sha) = &self.provenance.policy_sha256 {
            pair("model_sha256", sha.clone());
        }
        if let Some(sha) = self.clip_sha256() {
            pair("clip_sha256", sha);
        }
        pair("seed", self.provenance.seed.to_string());
        pair("plant", self.provenance.plant.to_string());
        pair("fps", FPS.to_string());
        if let Some(p) = header.figures.precision {
            pair("precision", p.to_string());
        }
        pair("program", self.provenance.program.clone());
        out.writer.write_metadata(&Metadata { name: "robert".to_owned(), metadata: pairs })?;
        let json = "application/json";
        out.attach(TAKE_JSON, json, &text)?;
        if let Some(clip) = &self.clip_text {
            out.attach(CLIP_JSON, json, clip.as_bytes())?;
        }
        let config = self.config_toml();
        if !config.is_empty() {
            out.attach(CONFIG_TOML, "application/toml", config.as_bytes())?;
        }
        if let Some(card) = &self.policy_card {
            out.attach(MODEL_CARD, json, card.as_bytes())?;
        }
        Ok(())
    }

    fn frame<W: std::io::Write + std::io::Seek>(
        &self,
        out: &mut Out<W>,
        channels: &Channels,
        names: &[String],
        f: usize,
    ) -> mcap::McapResult<()> {
        let time = nanos(f);
        let dim = self.state_dim();
        if (f as u64) < u64::from(self.command.frames()) {
            let at = f as u32;
            if self.command.sight(at) != Sight::Masked {
                let seen: Vec<usize> = (0..dim).filter(|&j| self.command.sees(at, j)).collect();
                let goals = self.command.row(at);
                let position: Vec<f64> =
                    seen.iter().filter_map(|&j| goals.get(j)).map(|&v| v.into()).collect();
                let names: Vec<&str> =
                    seen.iter().filter_map(|&j| names.get(j)).map(String::as_str).collect();
                let cdr = cdr::joint_state(time, names.into_iter(), &position, &[], &[]);
                out.put(channels.command_joint_states, f, &cdr)?;
            }
            if let Some(Some(ghost)) = self.ghost.get(f) {
                out.put(channels.command_tf, f, &self.transforms(time, ghost, COMMAND_PREFIX))?;
            }
        }
        if f >= self.frames() {
            return Ok(());
        }
        let joints = self.robot.joints.iter().map(String::as_str);
        let row = super::document::row;
        let velocity = row(&self.velocity, f, dim);
        let effort = row(&self.effort, f, dim);
        let cdr = cdr::joint_state(time, joints, self.state(f), velocity, effort);
        out.put(channels.joint_states, f, &cdr)?;
        out.put(channels.tf, f, &self.transforms(time, self.body_poses(f), ""))?;
        // This is the last message of a frame, so a reader that has it has the complete frame.
        out.put(channels.metrics, f, &self.metrics(f).encode_to_vec())
    }

    fn transforms(&self, time: u64, poses: &[f64], prefix: &str) -> Vec<u8> {
        let transforms = self
            .robot
            .bodies
            .iter()
            .zip(poses.chunks_exact(POSE))
            .map(|(name, p)| FrameTransform {
                timestamp: proto::timestamp(time),
                parent_frame_id: WORLD.to_owned(),
                child_frame_id: format!("{prefix}{name}"),
                translation: Some(Vector3 { x: p[0], y: p[1], z: p[2] }),
                rotation: Some(Quaternion { w: p[3], x: p[4], y: p[5], z: p[6] }),
            })
            .collect();
        FrameTransforms { transforms }.encode_to_vec()
    }

    fn metrics(&self, f: usize) -> Metrics {
        let errors: Vec<JointError> = self
            .robot
            .joints
            .iter()
            .enumerate()
            .filter_map(|(j, name)| {
                let error = self.joint_error(f, j)?;
                Some(JointError { joint: name.clone(), error })
            })
            .collect();
        let n = errors.len();
        let mean = errors.iter().map(|e| e.error).sum::<f64>() / n as f64;
        let row = super::document::row;
        Metrics {
            frame: f as u32,
            frame_mae: (n > 0).then_some(mean),
            masked: n == 0,
            joint_error: errors,
            action: row(&self.actions, f, self.action_dim()).to_vec(),
            ctrl: row(&self.ctrl, f, self.action_dim()).to_vec(),
        }
    }

    /// All frames that command every joint.
    fn trajectory(&self) -> Vec<u8> {
        let full: Vec<u32> =
            (0..self.command.frames()).filter(|&f| self.command.sight(f) == Sight::Full).collect();
        let mut w = cdr::Writer::stamped(nanos(0));
        w.texts(self.robot.joints.iter().map(String::as_str));
        w.u32(full.len() as u32);
        for f in full {
            let row: Vec<f64> = self.command.row(f).iter().map(|&v| v.into()).collect();
            w.doubles(&row);
            w.doubles(&[]);
            w.doubles(&[]);
            w.doubles(&[]);
            w.u32(f / FPS);
            w.u32(f % FPS * FRAME_NANOS as u32);
        }
        w.finish()
    }

    /// Lines for the log panel: level and text.
    fn remarks(&self) -> Vec<(i32, String)> {
        let p = self.precision();
        let figure = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.5}"));
        let mut lines = vec![(
            INFO,
            format!(
                "{} on {}, seed {}: Precision {}, p95 {}, {} frames",
                self.provenance.policy,
                self.robot.id,
                self.provenance.seed,
                figure(p.precision),
                figure(p.p95),
                self.frames()
            ),
        )];
        let asked = self.command.frames() as usize;
        if self.frames() < asked {
            let text = format!("the rollout ended at frame {} of {asked}", self.frames() - 1);
            lines.push((WARNING, text));
        }
        for blind in self.command.blind_spans() {
            let (from, to) = (blind.from, blind.to);
            lines.push((WARNING, format!("steps {from}..{to} see no goal within a second")));
        }
        lines
    }
}

#[derive(Debug)]
struct Channels {
    joint_states: u16,
    command_joint_states: u16,
    command_trajectory: u16,
    tf: u16,
    command_tf: u16,
    scene: u16,
    metrics: u16,
    log: u16,
}

impl Channels {
    fn new<W: std::io::Write + std::io::Seek>(out: &mut Out<W>) -> mcap::McapResult<Channels> {
        let fox = proto::foxglove_schema();
        let own = proto::robert_schema();
        let w = &mut out.writer;
        let ros = "ros2msg";
        let state = w.add_schema("sensor_msgs/msg/JointState", ros, cdr::JOINT_STATE.as_bytes())?;
        let path = w.add_schema(
            "trajectory_msgs/msg/JointTrajectory",
            ros,
            cdr::JOINT_TRAJECTORY.as_bytes(),
        )?;
        let transforms = w.add_schema("foxglove.FrameTransforms", "protobuf", &fox)?;
        let scene = w.add_schema("foxglove.SceneUpdate", "protobuf", &fox)?;
        let log = w.add_schema("foxglove.Log", "protobuf", &fox)?;
        let metrics = w.add_schema("robert.Metrics", "protobuf", &own)?;
        let none = BTreeMap::new();
        let mut add = |schema, topic, encoding| w.add_channel(schema, topic, encoding, &none);
        Ok(Channels {
            joint_states: add(state, topic::JOINT_STATES, "cdr")?,
            command_joint_states: add(state, topic::COMMAND_JOINT_STATES, "cdr")?,
            command_trajectory: add(path, topic::COMMAND_TRAJECTORY, "cdr")?,
            tf: add(transforms, topic::TF, "protobuf")?,
            command_tf: add(transforms, topic::COMMAND_TF, "protobuf")?,
            scene: add(scene, topic::SCENE, "protobuf")?,
            metrics: add(metrics, topic::METRICS, "protobuf")?,
            log: add(log, topic::LOG, "protobuf")?,
        })
    }
}

struct Out<W: std::io::Write + std::io::Seek> {
    writer: Writer<W>,
    sequence: u32,
}

impl<W: std::io::Write + std::io::Seek> Out<W> {
    fn put(&mut self, channel_id: u16, frame: usize, data: &[u8]) -> mcap::McapResult<()> {
        let time = nanos(frame);
        let sequence = self.sequence;
        self.sequence += 1;
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        self.writer.write_to_known_channel(&header, data)
    }

    fn attach(&mut self, name: &str, media_type: &str, data: &[u8]) -> mcap::McapResult<()> {
        self.writer.attach(&Attachment {
            log_time: nanos(0),
            create_time: nanos(0),
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: data.into(),
        })
    }
}
