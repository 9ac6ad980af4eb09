//! The window that the policy sees at one frame: 30 past frames, the current one and the next 20
//! commanded or masked frames (51 in total, indices 0..50 of the paper).

use super::goals::Goals;

pub use robert_net::{COMMAND, HISTORY};

/// The policy's view of time at one frame.
#[derive(Clone, Debug)]
pub struct Window {
    dim: usize,
    /// Reached states of t-30 .. t-1; (30, dim).
    pub history: Vec<f64>,
    /// Reached state of frame t; (dim).
    pub current: Vec<f64>,
    /// Goals of t+1 ..= t+20; meaningless where masked; (20, dim).
    pub command: Vec<f64>,
    /// Whether each goal counts, that of the last frame also for a joint that is `passing`; (20, dim).
    pub visible: Vec<bool>,
    /// Goals where visible, planned smooth motion between them, and after its last goal where a joint
    /// stays; (20, dim), or empty if the goals before the window are not known.
    pub way: Vec<f64>,
    /// The value at the end of the window for a joint without a goal of its own inside it: the point on the
    /// line to its next goal, or the last goal if there is no next one; (dim).
    pub end: Vec<f64>,
    /// Joints without a goal in the window or after it; in a filled window also those in the middle of a
    /// gap; (dim).
    pub free: Vec<bool>,
    /// Joints without a goal of their own in the window that have one after it; (dim).
    pub passing: Vec<bool>,
}

impl Window {
    /// An empty window for `dim` state dimensions.
    pub fn new(dim: usize) -> Window {
        Window {
            dim,
            history: vec![0.0; HISTORY * dim],
            current: vec![0.0; dim],
            command: vec![0.0; COMMAND * dim],
            visible: vec![false; COMMAND * dim],
            way: Vec::new(),
            end: vec![0.0; dim],
            free: vec![false; dim],
            passing: vec![false; dim],
        }
    }

    /// State dimensions.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// State of joint `j` one frame ago.
    pub fn before(&self, j: usize) -> f64 {
        self.history[(HISTORY - 1) * self.dim + j]
    }

    /// Fills the window of frame `t` from all `reached` states (pre-roll of 30 first, then frames
    /// 0..=t) and the goals. A hidden goal is finite but arbitrary: no policy may read it, which a
    /// test checks by overwriting.
    pub fn fill(&mut self, t: usize, reached: &[f64], goals: &Goals) {
        let d = self.dim;
        self.history.copy_from_slice(&reached[t * d..(t + HISTORY) * d]);
        self.current.copy_from_slice(&reached[(t + HISTORY) * d..(t + HISTORY + 1) * d]);
        self.show(t, goals);
    }

    /// Writes the goals of t+1 ..= t+20.
    ///
    /// Beyond the end of the clip the last value is held and visible, because a person expects the
    /// robot to stay there. Masking it instead gave the same figures. A joint that was free while others had goals
    /// stays free: it would go back to a goal of long ago, and pull others along where loops are closed.
    fn show(&mut self, t: usize, goals: &Goals) {
        let (d, last) = (self.dim, goals.frames().saturating_sub(1));
        self.way.resize(COMMAND * d, 0.0);
        let (end, past) = match t + COMMAND {
            f if f > last => (&goals.end[..], &goals.end_free[..]),
            f => (goals.row(f), goals.past(f)),
        };
        self.end.copy_from_slice(end);
        self.free.copy_from_slice(past);
        for i in 0..COMMAND {
            let f = t + 1 + i;
            let rows = i * d..(i + 1) * d;
            if f > last {
                self.command[rows.clone()].copy_from_slice(&goals.end);
                self.way[rows.clone()].copy_from_slice(&goals.end);
                let seen = self.visible[rows].iter_mut();
                seen.zip(&goals.end_free).for_each(|(seen, free)| *seen = !free);
            } else {
                self.command[rows.clone()].copy_from_slice(goals.row(f));
                self.way[rows.clone()].copy_from_slice(goals.way(f));
                self.visible[rows].copy_from_slice(goals.seen(f));
            }
        }
        for j in 0..d {
            let hidden = (0..COMMAND).all(|i| !self.visible[i * d + j]);
            (self.free[j], self.passing[j]) = (self.free[j] && hidden, !self.free[j] && hidden);
            // A joint that waits for a goal beyond the window would have to jump to it in the end.
            self.visible[(COMMAND - 1) * d + j] |= self.passing[j];
        }
        if !self.visible.iter().any(|&v| v) {
            self.visible[(COMMAND - 1) * d..].fill(true);
        }
    }

    /// First visible command index for joint `j` (0 is frame t+1), with its goal or, at the far end, the
    /// point on the way to it.
    pub fn next_goal(&self, j: usize) -> Option<(usize, f64)> {
        (0..COMMAND)
            .find(|&i| self.visible[i * self.dim + j])
            .map(|i| (i, self.command[i * self.dim + j]))
    }

    /// Target of joint `j` one frame ahead: its goal, or the straight line from the reached
    /// state to the next goal, or to stay.
    pub fn next_target(&self, j: usize) -> f64 {
        let q = self.current[j];
        self.next_goal(j).map_or(q, |(i, goal)| q + (goal - q) / (i + 1) as f64)
    }

    /// The linear guide: every masked goal becomes the straight line from the *reached*
    /// state to the next visible goal (held after the last), and counts afterwards. It is
    /// recomputed in each frame, so that it never demands motion that was missed.
    pub fn guide_linear(&mut self) {
        let d = self.dim;
        for j in 0..d {
            let (mut from, mut begin) = (self.current[j], 0);
            for i in 0..COMMAND {
                if !self.visible[i * d + j] {
                    continue;
                }
                let to = self.command[i * d + j];
                let span = (i + 1 - begin) as f64;
                for g in begin..i {
                    self.command[g * d + j] = from + (to - from) * ((g + 1 - begin) as f64 / span);
                }
                (from, begin) = (to, i + 1);
            }
            for g in begin..COMMAND {
                self.command[g * d + j] = from;
            }
        }
        self.visible.fill(true);
    }

    /// Partly visible frames become completely visible, with hidden joints filled linearly, for
    /// policies that mask whole states as in the paper.
    pub fn complete_partial_frames(&mut self) {
        let d = self.dim;
        let partial = |v: &[bool]| v.iter().any(|&x| x) && !v.iter().all(|&x| x);
        let frames: Vec<usize> =
            (0..COMMAND).filter(|&i| partial(&self.visible[i * d..(i + 1) * d])).collect();
        if frames.is_empty() {
            return;
        }
        let mut filled = self.clone();
        filled.guide_linear();
        for i in frames {
            let rows = i * d..(i + 1) * d;
            if i == COMMAND - 1 {
                // Beyond the last goal in sight a joint is on the way to its next one.
                for (j, at) in rows.clone().enumerate().filter(|(_, at)| !self.visible[*at]) {
                    self.command[at] = self.end[j];
                }
            } else {
                self.command[rows.clone()].copy_from_slice(&filled.command[rows.clone()]);
            }
            self.visible[rows].fill(true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::goals::tests::goals;
    use super::*;
    use robert_clip::Command;

    fn window(goals: &Goals, t: usize, reached: f64) -> Window {
        let mut w = Window::new(1);
        w.fill(t, &vec![reached; HISTORY + t + 1], goals);
        w
    }

    #[test]
    fn a_window_never_is_all_masked() {
        let mut rows = vec![None; 60];
        rows[0] = Some(0.0);
        rows[45] = Some(0.9);
        let g = goals(&rows, 0.0);
        for t in 0..60 {
            assert!(window(&g, t, 0.0).visible.iter().any(|&v| v), "frame {t}");
        }
        // Frame 5 sees 6..=25: nothing; index 50 is the straight line at 25 of 45.
        let w = window(&g, 5, 0.0);
        let (index, value) = w.next_goal(0).unwrap();
        assert_eq!(index, 19);
        assert!((value - 0.5).abs() < 1e-6);
        // Frame 25 sees the key itself at index 19 and no virtual one.
        assert_eq!(window(&g, 25, 0.0).visible.iter().filter(|&&v| v).count(), 1);
        // After the last key its value is held: the masked tail stays put.
        assert!((window(&g, 45, 0.9).command[19] - 0.9).abs() < 1e-6);
    }

    /// The timeline draws the virtual keyframe, and the fix that inserts a key stores the line.
    /// Both must agree with the policy's input, also before the first key.
    #[test]
    fn the_line_through_a_gap_is_the_clips() {
        let mut rng = robert_base::rng::Rng::new(5, robert_base::rng::Stream::Test, 0);
        let mut virtual_keys = 0;
        for _ in 0..60 {
            let frames = 50 + rng.below(60) as usize;
            let mut visible = vec![false; frames * 2];
            let mut q = vec![0.0_f32; frames * 2];
            for _ in 0..rng.below(5) {
                let f = rng.below(frames as u64) as usize;
                for j in 0..2 {
                    visible[f * 2 + j] = rng.below(4) > 0;
                    q[f * 2 + j] = rng.range(-2.0, 2.0) as f32;
                }
            }
            let names = vec!["a".into(), "b".into()];
            let command = Command::from_dense(names, vec![0.3, -0.7], q, visible).unwrap();
            let goals = Goals::new(&command);
            let mut w = Window::new(2);
            for t in 0..frames {
                let line: Vec<f64> =
                    command.interpolated(t as u32).into_iter().map(f64::from).collect();
                assert_eq!(goals.row(t), line, "frame {t}");
                if let Some(key) = command.virtual_key(t as u32) {
                    w.fill(t, &vec![0.0; 2 * (HISTORY + t + 1)], &goals);
                    let shown: Vec<f32> = w.command[38..].iter().map(|v| *v as f32).collect();
                    assert_eq!((key.frame as usize, shown), (t + 20, key.q));
                    virtual_keys += 1;
                }
            }
        }
        assert!(virtual_keys > 500, "{virtual_keys}");
    }

    #[test]
    fn a_joint_whose_goal_is_far_has_one_on_the_way_beside_the_goals_of_others() {
        let (frames, names) = (100, vec!["a".into(), "b".into()]);
        let (mut q, mut visible) = (vec![0.0_f32; frames * 2], vec![false; frames * 2]);
        let mut goal = |f: usize, j: usize, value: f32| {
            (q[f * 2 + j], visible[f * 2 + j]) = (value, true);
        };
        goal(60, 0, 3.0);
        (0..frames).for_each(|f| goal(f, 1, 0.5));
        let command = Command::from_dense(names, vec![0.0; 2], q, visible).unwrap();
        let goals = Goals::new(&command);
        let mut w = Window::new(2);
        let at = |t: usize, w: &mut Window| {
            w.fill(t, &vec![0.0; 2 * (HISTORY + t + 1)], &goals);
            w.next_goal(0)
        };
        assert_eq!(at(0, &mut w), Some((19, 1.0)));
        assert!(w.passing[0] && !w.visible[36]);
        assert_eq!(at(30, &mut w), Some((19, 2.5)));
        assert_eq!(at(45, &mut w), Some((14, 3.0)));
        // After its last goal it is free.
        assert_eq!(at(60, &mut w), None);

        // Whoever masks whole states gets a frame in which every joint is on its own way.
        let rows = [(0, [0.0, 0.0], [true; 2]), (3, [0.0, 1.0], [false, true])];
        let later = [(25, [0.0, 2.0], [false, true]), (100, [5.0, 2.0], [true; 2])];
        let (mut q, mut visible) = (vec![0.0_f32; 202], vec![false; 202]);
        for (f, row, seen) in rows.into_iter().chain(later) {
            q[f * 2..f * 2 + 2].copy_from_slice(&row);
            visible[f * 2..f * 2 + 2].copy_from_slice(&seen);
        }
        let names = vec!["a".into(), "b".into()];
        let command = Command::from_dense(names, vec![0.0; 2], q, visible).unwrap();
        w.fill(0, &vec![0.0; 2 * (HISTORY + 1)], &Goals::new(&command));
        w.complete_partial_frames();
        let last = [1.0, 1.0 + 17.0 / 22.0];
        assert!(w.visible[38] && w.visible[39]);
        assert!(
            w.command[38..].iter().zip(last).all(|(a, b)| (a - b).abs() < 1e-6),
            "{:?}",
            &w.command[38..]
        );
    }

    #[test]
    fn past_the_end_means_stay() {
        let g = goals(&[Some(0.0), Some(0.1), Some(0.2)], 0.0);
        let w = window(&g, 1, 0.1);
        assert!(w.visible.iter().all(|&v| v));
        assert!(w.command.iter().all(|&c| (c - 0.2).abs() < 1e-6));
    }

    #[test]
    fn a_joint_that_was_free_stays_free_past_the_end() {
        // The second one has its last goal at the start, the third one shortly before that of the first.
        let names = ["a", "b", "c"].map(str::to_owned).to_vec();
        let (mut q, mut visible) = (vec![0.0_f32; 90], vec![false; 90]);
        visible[..3].fill(true);
        for (f, j, value) in [(28, 0, 0.4), (29, 0, 0.4), (10, 2, 0.7)] {
            (q[f * 3 + j], visible[f * 3 + j]) = (value, true);
        }
        let command = Command::from_dense(names, vec![0.0; 3], q, visible).unwrap();
        let goals = Goals::new(&command);
        let mut w = Window::new(3);
        for t in 0..30 {
            w.fill(t, &vec![0.0; 3 * (HISTORY + t + 1)], &goals);
            assert!(w.next_goal(1).is_none() && w.free == [false, true, false], "frame {t}");
        }
        assert_eq!((w.next_goal(0).map(|g| g.0), w.next_goal(2).map(|g| g.0)), (Some(0), Some(0)));
        assert!((w.command[2] - 0.7).abs() < 1e-6);
    }

    #[test]
    fn guide_runs_from_the_reached_state() {
        let mut rows = vec![None; 30];
        rows[0] = Some(0.0);
        rows[10] = Some(1.0);
        let g = goals(&rows, 0.0);
        let mut w = window(&g, 5, 0.2);
        assert!((w.next_target(0) - (0.2 + 0.8 / 5.0)).abs() < 1e-6);
        w.guide_linear();
        assert!((w.command[0] - 0.36).abs() < 1e-6);
        assert!((w.command[4] - 1.0).abs() < 1e-6);
        assert!((w.command[19] - 1.0).abs() < 1e-6, "held after the last goal");
        assert!(w.visible.iter().all(|&v| v));
    }

    #[test]
    fn a_smooth_plan_leaves_no_virtual_keyframe() {
        let mut rows = vec![None; 60];
        (rows[0], rows[40]) = (Some(0.0), Some(1.0));
        assert!(window(&goals(&rows, 0.0), 10, 0.0).passing[0]);
        assert!(!window(&goals(&rows, 0.0).smooth(), 10, 0.0).passing[0]);
    }
}
