//! `/joint_states` of an MCAP file, such as a ROS 2 bag.

use std::collections::{BTreeMap, BTreeSet};

use super::super::cdr;
use super::super::error::{Damage, Error};
use super::super::records::{Channel, MAGIC, Message, Record, Records, op, unpack};
use super::samples::{Samples, foreign};
use robert_base::limits;

/// Messages that are read: a quarter of an hour at 1,000 a second.
const MESSAGES: usize = 1 << 20;

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

/// What was found so far. Names are kept once: a small file can repeat them millions of times.
#[derive(Default)]
struct Found {
    channels: BTreeSet<u16>,
    /// Each name and its number.
    joints: BTreeMap<String, u16>,
    /// Time in ns, and where its joints and values lie in the lists of all messages.
    messages: Vec<(u64, std::ops::Range<usize>)>,
    numbers: Vec<u16>,
    values: Vec<f64>,
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
                self.channels.insert(channel.id);
            }
        } else if record.op == op::MESSAGE {
            let message = Message::parse(record.body).ok_or_else(|| wrong("a broken message"))?;
            if self.channels.contains(&message.channel) {
                self.message(message.log_time, message.data).map_err(|e| wrong(&e))?;
            }
        }
        Ok(())
    }

    fn message(&mut self, nanos: u64, data: &[u8]) -> Result<(), String> {
        let (names, q) = states(data).ok_or("no sensor_msgs/JointState")?;
        let from = self.values.len();
        if from + q.len() > limits::CLIP_VALUES || q.iter().any(|v| !v.is_finite()) {
            return Err("too many values, or one that is no number".to_owned());
        }
        for name in names {
            let known = self.joints.get(name).copied();
            let number = match known {
                Some(number) => number,
                None if name.len() > limits::NAME_BYTES => {
                    return Err(format!("a name of {} bytes", name.len()));
                }
                None if self.joints.len() >= limits::JOINTS => {
                    return Err(format!("more than {} joints", limits::JOINTS));
                }
                None => {
                    let number = self.joints.len() as u16;
                    self.joints.insert(name.to_owned(), number);
                    number
                }
            };
            self.numbers.push(number);
        }
        self.values.extend(q);
        if self.messages.len() >= MESSAGES {
            return Err(format!("more than {MESSAGES} messages"));
        }
        if from < self.values.len() {
            self.messages.push((nanos, from..self.values.len()));
        }
        Ok(())
    }

    fn samples(mut self) -> Result<Samples, Error> {
        // Recorders write messages as they arrive, which may be out of order.
        self.messages.sort_by_key(|m| m.0);
        let Some(begin) = self.messages.first().map(|m| m.0) else {
            return Err(foreign(format!("there is nothing on {TOPIC}")));
        };
        let (mut last, mut order) = (vec![None; self.joints.len()], Vec::new());
        let mut samples = Samples::default();
        for (nanos, part) in &self.messages {
            let numbers = self.numbers.get(part.clone()).unwrap_or_default();
            let values = self.values.get(part.clone()).unwrap_or_default();
            for (number, value) in numbers.iter().map(|n| usize::from(*n)).zip(values) {
                let Some(place) = last.get_mut(number) else { continue };
                if place.is_none() {
                    order.push(number);
                }
                *place = Some(*value);
            }
            // Columns stand in the order in which the joints are first seen.
            if order.len() < last.len() {
                continue;
            }
            let row = order.iter().filter_map(|j| last.get(*j).copied().flatten()).collect();
            let secs = (nanos - begin) as f64 * 1e-9;
            // Of two messages with one time, the later one is more complete.
            if samples.secs.last() == Some(&secs) {
                samples.secs.pop();
                samples.rows.pop();
            }
            samples.secs.push(secs);
            samples.rows.push(row);
            // Messages that name one joint each make rows of all.
            if samples.rows.len() * order.len() > limits::CLIP_VALUES {
                return Err(foreign(format!("more than {} values", limits::CLIP_VALUES)));
            }
        }
        let mut names: Vec<(u16, String)> = self.joints.into_iter().map(|(j, n)| (n, j)).collect();
        names.sort_unstable();
        let name = |j: &usize| names.get(*j).map(|(_, name)| name.clone());
        samples.joints = order.iter().filter_map(name).collect();
        if let Some(first) = samples.secs.first().copied() {
            samples.secs.iter_mut().for_each(|s| *s -= first);
        }
        Ok(samples)
    }
}

/// Names and positions in a message; none if it has no positions.
fn states(data: &[u8]) -> Option<(Vec<&str>, Vec<f64>)> {
    let mut reader = cdr::Reader::stamped(data)?;
    let count = reader.u32()? as usize;
    if count > limits::JOINTS {
        return None;
    }
    let names = (0..count).map(|_| reader.text()).collect::<Option<Vec<_>>>()?;
    let mut q = Vec::new();
    reader.doubles(&mut q)?;
    // Drivers that publish joints in parts also send messages with names and no position.
    let names = if q.is_empty() { Vec::new() } else { names };
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

    fn say(found: &mut Found, nanos: u64, names: &[&str], q: &[f64]) -> Result<(), String> {
        let message = cdr::joint_state(nanos, names.iter().copied(), q, &[], &[]);
        found.message(nanos, &message)
    }

    /// Messages that name one joint each make rows of all joints: a few megabytes became gigabytes.
    #[test]
    fn rows_have_a_limit_of_values() {
        let names: Vec<String> = (0..limits::JOINTS).map(|j| format!("j{j}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let q = vec![0.0; names.len()];
        let read = |rows: usize| {
            let mut found = Found::default();
            say(&mut found, 0, &names, &q).unwrap();
            for nanos in 1..rows as u64 {
                say(&mut found, nanos, &names[..1], &q[..1]).unwrap();
            }
            found.samples().map(|s| s.rows.len())
        };
        let most = limits::CLIP_VALUES / names.len();
        assert_eq!(read(most).unwrap(), most);
        assert!(read(most + 1).unwrap_err().to_string().contains("more than 4194304 values"));
    }

    #[test]
    fn names_and_messages_have_limits() {
        let mut found = Found::default();
        for j in 0..limits::JOINTS {
            say(&mut found, 0, &[&format!("j{j}")], &[0.0]).unwrap();
        }
        say(&mut found, 1, &["j0"], &[0.0]).unwrap();
        assert!(say(&mut found, 1, &["one more"], &[0.0]).unwrap_err().contains("256 joints"));
        let long = "x".repeat(limits::NAME_BYTES);
        let mut found = Found::default();
        say(&mut found, 0, &[&long], &[0.0]).unwrap();
        assert!(say(&mut found, 0, &[&format!("{long}x")], &[0.0]).unwrap_err().contains("257"));
        found.messages = vec![(0, 0..1); MESSAGES - 1];
        say(&mut found, 0, &[&long], &[0.0]).unwrap();
        assert!(say(&mut found, 0, &[&long], &[0.0]).unwrap_err().contains("1048576 messages"));
    }

    #[test]
    fn parts_of_a_state_are_put_together() {
        let mut found = Found::default();
        for (secs, name, q) in [(3, "b", 7.0), (1, "a", 1.0), (2, "b", 2.0)] {
            say(&mut found, secs * 1_000_000_000, &[name], &[q]).unwrap();
        }
        let samples = found.samples().unwrap();
        assert_eq!(samples.joints, ["a", "b"]);
        assert_eq!(
            (samples.secs, samples.rows),
            (vec![0.0, 1.0], vec![vec![1.0, 2.0], vec![1.0, 7.0]])
        );
    }
}
