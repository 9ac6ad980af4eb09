//! `/joint_states` of an MCAP file, such as a ROS 2 bag.

use std::collections::BTreeMap;

use super::super::cdr;
use super::super::error::{Damage, Error};
use super::super::records::{Channel, MAGIC, Message, Record, Records, op, unpack};
use super::samples::{Samples, foreign};
use robert_base::limits;

/// The topic that is read.
const TOPIC: &str = "/joint_states";

/// Reads the joint states, one row per message. Messages may name the joints in any order, and some
/// may name only a part of them. Rows begin once every joint has been seen, and a joint that a
/// message leaves out keeps its last value.
///
/// # Errors
/// [`Error::Foreign`], [`Error::Damaged`].
pub fn from_bag(bytes: &[u8]) -> Result<Samples, Error> {
    if !bytes.starts_with(MAGIC) {
        return Err(foreign("this is no MCAP file"));
    }
    let mut found = Found::default();
    found.walk(bytes).map_err(|damage| Error::Damaged { damage, frames: 0, path: None })?;
    found.samples()
}

#[derive(Default)]
struct Found {
    channels: Vec<u16>,
    /// Time in ns, names and positions of each message.
    messages: Vec<(u64, Vec<String>, Vec<f64>)>,
    values: usize,
}

impl Found {
    fn walk(&mut self, bytes: &[u8]) -> Result<(), Damage> {
        let mut budget = limits::TAKE_UNPACKED_BYTES;
        let mut records = Records::new(bytes, MAGIC.len());
        while let Some(record) = records.next() {
            let record = record?;
            match record.op {
                op::FOOTER | op::DATA_END => break,
                op::CHUNK => {
                    let unpacked = unpack(record, &mut budget)?;
                    let mut inner = Records::new(&unpacked, 0);
                    while let Some(record) = inner.next() {
                        self.record(&record?)?;
                    }
                }
                _ => self.record(&record)?,
            }
        }
        Ok(())
    }

    fn record(&mut self, record: &Record<'_>) -> Result<(), Damage> {
        let wrong = |problem: &str| Damage::at(record.offset, problem);
        if record.op == op::CHANNEL {
            let channel = Channel::parse(record.body).ok_or_else(|| wrong("a broken channel"))?;
            if channel.topic == TOPIC {
                if channel.encoding != "cdr" {
                    return Err(wrong(&format!("{TOPIC} is encoded as {:?}", channel.encoding)));
                }
                self.channels.push(channel.id);
            }
        } else if record.op == op::MESSAGE {
            let message = Message::parse(record.body).ok_or_else(|| wrong("a broken message"))?;
            if self.channels.contains(&message.channel) {
                let (names, q) =
                    states(message.data).ok_or_else(|| wrong("no sensor_msgs/JointState"))?;
                self.values += q.len();
                if self.values > limits::CLIP_VALUES || q.iter().any(|v| !v.is_finite()) {
                    return Err(wrong("too many values, or one that is no number"));
                }
                self.messages.push((message.log_time, names, q));
            }
        }
        Ok(())
    }

    fn samples(mut self) -> Result<Samples, Error> {
        // Recorders write messages as they arrive, which may be out of order.
        self.messages.sort_by_key(|m| m.0);
        let mut last: BTreeMap<String, f64> = BTreeMap::new();
        let mut joints: Vec<String> = Vec::new();
        for name in self.messages.iter().flat_map(|m| &m.1) {
            if !joints.contains(name) {
                joints.push(name.clone());
                if joints.len() > limits::JOINTS {
                    return Err(foreign(format!("more than {} joints", limits::JOINTS)));
                }
            }
        }
        let Some(begin) = self.messages.first().map(|m| m.0) else {
            return Err(foreign(format!("there is nothing on {TOPIC}")));
        };
        let mut samples = Samples { joints, ..Samples::default() };
        for (nanos, names, q) in &self.messages {
            last.extend(names.iter().cloned().zip(q.iter().copied()));
            let row: Option<Vec<f64>> =
                samples.joints.iter().map(|j| last.get(j).copied()).collect();
            let Some(row) = row else { continue };
            let secs = (nanos - begin) as f64 * 1e-9;
            // Of two messages with one time, the later one is more complete.
            if samples.secs.last() == Some(&secs) {
                samples.secs.pop();
                samples.rows.pop();
            }
            samples.secs.push(secs);
            samples.rows.push(row);
        }
        if let Some(first) = samples.secs.first().copied() {
            samples.secs.iter_mut().for_each(|s| *s -= first);
        }
        Ok(samples)
    }
}

/// Names and positions in a message. A message with fewer positions than names has none.
fn states(data: &[u8]) -> Option<(Vec<String>, Vec<f64>)> {
    let mut reader = cdr::Reader::stamped(data)?;
    let count = reader.u32()? as usize;
    if count > limits::JOINTS {
        return None;
    }
    let names = (0..count).map(|_| reader.text().map(str::to_owned)).collect::<Option<Vec<_>>>()?;
    let mut q = Vec::new();
    reader.doubles(&mut q)?;
    (q.len() == names.len()).then_some((names, q))
}

#[cfg(test)]
mod tests {
    use super::super::super::export::{RosOptions, bag};
    use super::super::super::{What, sample};
    use super::*;

    #[test]
    fn bags_and_takes_come_back() {
        let (_, take) = sample::take("ur5e", 30, 30);
        let export = bag(&take, What::Achieved, &RosOptions::default()).unwrap();
        let bag = &export.files[1].bytes;
        for file in [bag.clone(), take.to_mcap(None).unwrap()] {
            let samples = from_bag(&file).unwrap();
            assert_eq!(samples.joints, take.robot.joints);
            assert_eq!(samples.rows.concat(), take.reached);
            assert!((samples.secs[29] - 1.45).abs() < 1e-9);
        }
        for cut in [0, 5, 100, bag.len() / 2] {
            assert!(from_bag(&bag[..cut]).is_err(), "{cut}");
        }
    }

    #[test]
    fn parts_of_a_state_are_put_together() {
        let message = |nanos: u64, names: &[&str], q: &[f64]| {
            (nanos, names.iter().map(|n| (*n).to_owned()).collect(), q.to_vec())
        };
        let found = Found {
            messages: vec![
                message(3_000_000_000, &["b"], &[7.0]),
                message(1_000_000_000, &["a"], &[1.0]),
                message(2_000_000_000, &["b"], &[2.0]),
            ],
            ..Found::default()
        };
        let samples = found.samples().unwrap();
        assert_eq!(samples.joints, ["a", "b"]);
        assert_eq!(
            (samples.secs, samples.rows),
            (vec![0.0, 1.0], vec![vec![1.0, 2.0], vec![1.0, 7.0]])
        );
    }
}
