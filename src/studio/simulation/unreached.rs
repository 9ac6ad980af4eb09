//! Commanded poses that the robot cannot hold.

/// A commanded pose that the robot cannot hold, and the one in which it comes to rest instead.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Unreached {
    /// The frames of its keys, each `[from, to)`.
    pub(crate) held: Vec<[u32; 2]>,
    /// In state order, rad or m.
    pub(crate) asked: Vec<f64>,
    /// In state order, rad or m.
    pub(crate) rests: Vec<f64>,
}

/// Commands hold single precision: goals this far apart are the same, rad or m.
const SAME: f64 = 1e-4;

impl Unreached {
    /// Whether this is what is commanded at a frame, where offsets and previews count.
    pub(crate) fn is_at(&self, frame: u32, commanded: &[f64]) -> bool {
        self.held.iter().any(|[from, to]| (*from..*to).contains(&frame))
            && self.asked.len() == commanded.len()
            && self.asked.iter().zip(commanded).all(|(a, b)| (a - b).abs() < SAME)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_said_of_the_pose_that_was_checked_only() {
        let pose = Unreached { held: vec![[3, 5], [9, 10]], asked: vec![1.2], rests: vec![0.6] };
        assert!(pose.is_at(3, &[1.2]) && pose.is_at(4, &[1.200_01]) && pose.is_at(9, &[1.2]));
        assert!(!pose.is_at(5, &[1.2]), "after its hold");
        assert!(!pose.is_at(3, &[1.1]), "dragged, or changed by an offset");
        assert!(!pose.is_at(3, &[1.2, 0.0]), "of another robot");
    }
}
