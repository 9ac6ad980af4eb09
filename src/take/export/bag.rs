//! A folder for `ros2 bag`: joint states, and the trajectory once.
//!
//! The take itself is MCAP, too, but mixes two encodings for its viewers. A bag may contain ROS 2
//! messages only, names its profile, and has a `metadata.yaml` beside it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Cursor;

use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, WriteOptions};

use super::super::cdr;
use super::super::document::{Take, What, row};
use super::super::error::Error;
use super::super::write::nanos;
use super::files::{Export, File, Folder};
use super::trajectory::{RosOptions, points};
use robert_clip::formats::Trajectory;

const STATES: &str = "/joint_states";
const PATH: &str = "/joint_trajectory_controller/joint_trajectory";
const STATE_TYPE: &str = "sensor_msgs/msg/JointState";
const PATH_TYPE: &str = "trajectory_msgs/msg/JointTrajectory";

/// The reached motion as a bag; `what` chooses the trajectory.
///
/// # Errors
/// [`Error::Export`] for a command with goals for some joints only, or for none;
/// [`Error::Encode`].
pub fn bag(take: &Take, what: What, options: &RosOptions) -> Result<Export, Error> {
    let (trajectory, _) = points(take, what, options)?;
    let mcap = encode(take, &trajectory)
        .map_err(|e| Error::Encode { what: "the bag", problem: e.to_string() })?;
    let name = "robert_0.mcap";
    let files = vec![
        File { name: "metadata.yaml".to_owned(), bytes: metadata(take, name).into_bytes() },
        File { name: name.to_owned(), bytes: mcap },
    ];
    let export = Export {
        files,
        folder: Some(Folder { path: String::new(), marker: "metadata.yaml" }),
        frames: take.frames(),
        meaning: Vec::new(),
        open: format!("ros2 bag play {}", Export::OUT),
    };
    let export = export
        .says(format!(
            "{STATES}: {STATE_TYPE}, 20 a second; rad, rad/s, N m (m, m/s, N for slides)."
        ))
        .says(format!("{PATH}: {PATH_TYPE}, once, at the start."));
    Ok(match options.left_out(take) {
        Some(names) => export.says(names),
        None => export,
    })
}

fn encode(take: &Take, trajectory: &Trajectory) -> mcap::McapResult<Vec<u8>> {
    let options = WriteOptions::new()
        .profile("ros2")
        .library(format!("robert {}", env!("CARGO_PKG_VERSION")))
        .compression(Some(Compression::Zstd))
        // Worker threads would make the bytes depend on the machine.
        .compression_threads(0);
    let mut out = options.create(Cursor::new(Vec::new()))?;
    let empty = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
    let state = out.add_schema(STATE_TYPE, "ros2msg", cdr::JOINT_STATE.as_bytes())?;
    let path = out.add_schema(PATH_TYPE, "ros2msg", cdr::JOINT_TRAJECTORY.as_bytes())?;
    let state = out.add_channel(state, STATES, "cdr", &empty)?;
    let path = out.add_channel(path, PATH, "cdr", &empty)?;
    out.write_metadata(&Metadata {
        name: "robert".to_owned(),
        metadata: BTreeMap::from([
            ("policy".to_owned(), take.provenance.policy.clone()),
            ("robot".to_owned(), take.robot.id.clone()),
        ]),
    })?;
    let mut sequence = 0;
    let mut put = |channel_id, frame, data: &[u8]| {
        let time = nanos(frame);
        sequence += 1;
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        out.write_to_known_channel(&header, data)
    };
    put(path, 0, &message(trajectory))?;
    let dim = take.state_dim();
    for f in 0..take.frames() {
        let names = take.robot.joints.iter().map(String::as_str);
        let (velocity, effort) = (row(&take.velocity, f, dim), row(&take.effort, f, dim));
        put(state, f, &cdr::joint_state(nanos(f), names, take.state(f), velocity, effort))?;
    }
    out.finish()?;
    Ok(out.into_inner().into_inner())
}

/// `trajectory_msgs/msg/JointTrajectory`; its stamp is 0, which is "now" for a controller.
fn message(trajectory: &Trajectory) -> Vec<u8> {
    let mut w = cdr::Writer::stamped(0);
    w.texts(trajectory.joints.iter().map(String::as_str));
    w.u32(trajectory.points.len() as u32);
    for p in &trajectory.points {
        for values in [&p.positions, &p.velocities, &p.accelerations, &p.effort] {
            w.doubles(values);
        }
        w.u32((p.nanos / 1_000_000_000) as u32);
        w.u32((p.nanos % 1_000_000_000) as u32);
    }
    w.finish()
}

/// `metadata.yaml`, version 5, which Humble and all later releases read.
fn metadata(take: &Take, file: &str) -> String {
    let start = nanos(0);
    let duration = nanos(take.frames() - 1) - start;
    let messages = take.frames() + 1;
    let mut out = format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  duration:\n    nanoseconds: {duration}\n  starting_time:\n    nanoseconds_since_epoch: {start}\n  message_count: {messages}\n  topics_with_message_count:\n"
    );
    for (name, kind, count) in [(PATH, PATH_TYPE, 1), (STATES, STATE_TYPE, take.frames())] {
        write!(
            out,
            "    - topic_metadata:\n        name: {name}\n        type: {kind}\n        serialization_format: cdr\n        offered_qos_profiles: \"\"\n      message_count: {count}\n"
        )
        .ok();
    }
    write!(
        out,
        "  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - {file}\n  files:\n    - path: {file}\n      starting_time:\n        nanoseconds_since_epoch: {start}\n      duration:\n        nanoseconds: {duration}\n      message_count: {messages}\n"
    )
    .ok();
    out
}

#[cfg(test)]
mod tests {
    use super::super::super::sample;
    use super::*;

    /// Uses the reader of the `mcap` crate, which takes no part in writing.
    #[test]
    fn a_bag_has_ros_messages_only() {
        let (_, take) = sample::take("ur5e", 40, 40);
        let export = bag(&take, What::Achieved, &RosOptions::default()).unwrap();
        assert_eq!(bag(&take, What::Achieved, &RosOptions::default()).unwrap(), export);
        let bytes = &export.files[1].bytes;
        let summary = mcap::Summary::read(bytes).unwrap().unwrap();
        assert!(summary.channels.values().all(|c| c.message_encoding == "cdr"));
        let messages: Vec<_> =
            mcap::MessageStream::new(bytes).unwrap().map(Result::unwrap).collect();
        assert_eq!(messages.len(), 41);
        let states = messages.iter().filter(|m| m.channel.topic == STATES);
        for (f, message) in states.enumerate() {
            assert_eq!(message.log_time, nanos(f));
            let mut reader = cdr::Reader::stamped(&message.data).unwrap();
            let names = reader.u32().unwrap();
            for _ in 0..names {
                reader.text().unwrap();
            }
            let mut q = Vec::new();
            reader.doubles(&mut q).unwrap();
            assert_eq!(q, take.state(f));
        }
        let yaml = String::from_utf8(export.files[0].bytes.clone()).unwrap();
        assert!(
            yaml.contains("message_count: 41\n")
                && yaml.contains("duration:\n    nanoseconds: 1950000000\n"),
            "{yaml}"
        );
    }
}
