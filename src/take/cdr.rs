//! CDR, the serialisation of ROS 2 messages, little endian; only what joint states need.
//!
//! Alignment counts from the byte after the four-byte header; a string carries its NUL.

/// The definitions that both schemas end with.
macro_rules! header {
    () => {
        "\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"
    };
}

/// Schema text of `sensor_msgs/msg/JointState`.
pub(super) const JOINT_STATE: &str = concat!(
    "\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
",
    header!()
);

/// Schema text of `trajectory_msgs/msg/JointTrajectory`.
pub(super) const JOINT_TRAJECTORY: &str = concat!(
    "\
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint[] points
================================================================================
MSG: trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
================================================================================
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
",
    header!()
);

const HEADER: [u8; 4] = [0, 1, 0, 0];

/// A message being written.
#[derive(Debug)]
pub(super) struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    /// A message with a `std_msgs/Header`.
    pub(super) fn stamped(stamp_nanos: u64) -> Writer {
        let mut w = Writer { bytes: HEADER.to_vec() };
        w.u32((stamp_nanos / 1_000_000_000) as u32);
        w.u32((stamp_nanos % 1_000_000_000) as u32);
        w.text("");
        w
    }

    fn align(&mut self, to: usize) {
        while !(self.bytes.len() - HEADER.len()).is_multiple_of(to) {
            self.bytes.push(0);
        }
    }

    pub(super) fn u32(&mut self, v: u32) {
        self.align(4);
        self.bytes.extend_from_slice(&v.to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend_from_slice(text.as_bytes());
        self.bytes.push(0);
    }

    pub(super) fn texts<'a>(&mut self, texts: impl ExactSizeIterator<Item = &'a str>) {
        self.u32(texts.len() as u32);
        texts.for_each(|t| self.text(t));
    }

    pub(super) fn doubles(&mut self, values: &[f64]) {
        self.u32(values.len() as u32);
        for v in values {
            self.align(8);
            self.bytes.extend_from_slice(&v.to_le_bytes());
        }
    }

    pub(super) fn finish(self) -> Vec<u8> {
        self.bytes
    }
}

/// `sensor_msgs/msg/JointState`; empty slices are empty arrays.
pub(super) fn joint_state<'a>(
    stamp_nanos: u64,
    names: impl ExactSizeIterator<Item = &'a str>,
    position: &[f64],
    velocity: &[f64],
    effort: &[f64],
) -> Vec<u8> {
    let mut w = Writer::stamped(stamp_nanos);
    w.texts(names);
    w.doubles(position);
    w.doubles(velocity);
    w.doubles(effort);
    w.finish()
}

/// A message being read; every step returns `None` if the bytes are too short.
#[derive(Debug)]
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// A message that begins with a `std_msgs/Header`, which is skipped.
    pub(super) fn stamped(bytes: &'a [u8]) -> Option<Reader<'a>> {
        let bytes = bytes.strip_prefix(&HEADER)?;
        let mut r = Reader { bytes, at: 0 };
        r.u32()?;
        r.u32()?;
        r.text()?;
        Some(r)
    }

    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let taken = self.bytes.get(self.at..self.at.checked_add(n)?)?;
        self.at += n;
        Some(taken)
    }

    fn align(&mut self, to: usize) {
        self.at = self.at.next_multiple_of(to);
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.align(4);
        Some(u32::from_le_bytes(self.take(4)?.try_into().ok()?))
    }

    /// A string without its NUL.
    pub(super) fn text(&mut self) -> Option<&'a str> {
        let n = self.u32()? as usize;
        let raw = self.take(n)?;
        std::str::from_utf8(raw.strip_suffix(&[0])?).ok()
    }

    /// Appends doubles to `out` and returns their number.
    pub(super) fn doubles(&mut self, out: &mut Vec<f64>) -> Option<usize> {
        let n = self.u32()? as usize;
        if n == 0 {
            return Some(0);
        }
        self.align(8);
        let raw = self.take(n.checked_mul(8)?)?;
        let values = raw.chunks_exact(8).filter_map(|c| c.try_into().ok().map(f64::from_le_bytes));
        out.extend(values);
        Some(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes worked out by hand from the CDR rules.
    #[test]
    fn layout_is_cdr() {
        let got = joint_state(1_500_000_000, ["ab"].into_iter(), &[1.0], &[], &[]);
        let mut want = vec![0, 1, 0, 0];
        want.extend([1, 0, 0, 0]); // sec
        want.extend(500_000_000_u32.to_le_bytes()); // nanosec
        want.extend([1, 0, 0, 0, 0, 0, 0, 0]); // "" and padding
        want.extend([1, 0, 0, 0]); // one name
        want.extend([3, 0, 0, 0, b'a', b'b', 0, 0]); // "ab" and padding
        want.extend([1, 0, 0, 0]); // one position, at byte 32: already aligned
        want.extend(1.0_f64.to_le_bytes());
        want.extend([0, 0, 0, 0, 0, 0, 0, 0]); // no velocity, no effort
        assert_eq!(got, want);
    }

    #[test]
    fn every_cut_is_refused() {
        let whole = joint_state(7, ["a", "bcd"].into_iter(), &[1.0, 2.0], &[3.0, 4.0], &[]);
        let read = |bytes: &[u8]| -> Option<Vec<f64>> {
            let mut r = Reader::stamped(bytes)?;
            let n = r.u32()?;
            for _ in 0..n {
                r.text()?;
            }
            let mut out = Vec::new();
            for _ in 0..3 {
                r.doubles(&mut out)?;
            }
            Some(out)
        };
        assert_eq!(read(&whole), Some(vec![1.0, 2.0, 3.0, 4.0]));
        for cut in 0..whole.len() {
            assert_eq!(read(&whole[..cut]), None, "{cut}");
        }
        let mut huge = whole.clone();
        huge[16..20].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(read(&huge), None);
    }
}
