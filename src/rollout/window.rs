//! The window that the policy sees at one frame: 30 past frames, the current one and the next 20
//! commanded or masked frames (51 in total, indices 0..50 of the paper).

use super::curve::{self, Knot};
use super::lead::Lead;
use robert_clip::Command;

pub use robert_net::{COMMAND, HISTORY};

/// Frames in which [`super::infill`] leads a joint back to the planned motion; only where it has no goal
/// in these frames. With 5 the joints of the arm that should stay swing more, with 12 the slow joints of
/// the hand lag more.
pub(super) const BACK: usize = 8;

/// A compiled command with virtual keyframes and the held end.
///
/// Training always leaves one command frame visible, so a completely masked window would be outside
/// the training data. If 20 or more masked frames follow each other, the last window frame gets a
/// *virtual keyframe*: the straight line between the visible frames around the gap, or the last
/// visible value after the final one.
#[derive(Clone, Debug, PartialEq)]
pub struct Goals {
    frames: usize,
    dim: usize,
    /// Command where visible, virtual value elsewhere; (frames, dim).
    q: Vec<f64>,
    /// The same with smooth motion in every gap; see [`Goals::find_way`]. (frames, dim).
    way: Vec<f64>,
    /// (frames, dim).
    visible: Vec<bool>,
    /// Whether this frame is in a gap whose straight line may be used; (frames, dim).
    in_gap: Vec<bool>,
    /// Whether the joint has no goal after this frame; (frames, dim).
    last: Vec<bool>,
    /// The command beyond the end; (dim).
    end: Vec<f64>,
    /// Joints that are free beyond the end, because they were free before; (dim).
    end_free: Vec<bool>,
}

impl Goals {
    /// From a compiled clip.
    pub fn new(command: &Command) -> Goals {
        let (frames, dim) = (command.frames() as usize, command.dim());
        let mut goals = Goals {
            frames,
            dim,
            q: vec![0.0; frames * dim],
            way: Vec::new(),
            visible: vec![false; frames * dim],
            in_gap: vec![false; frames * dim],
            last: vec![true; frames * dim],
            end: vec![0.0; dim],
            end_free: vec![false; dim],
        };
        // The line through the masks is that of the clip, bit for bit, so the timeline draws the
        // same virtual keyframe as the policy gets.
        for (to, q) in goals.q.iter_mut().zip(command.filled()) {
            *to = f64::from(q);
        }
        for (i, visible) in goals.visible.iter_mut().enumerate() {
            *visible = command.sees((i / dim) as u32, i % dim);
        }
        goals.find_gaps();
        goals.find_way();
        for (to, q) in goals.end.iter_mut().zip(command.held_end()) {
            *to = f64::from(q);
        }
        let last = |j: usize| (0..frames).rev().find(|&f| goals.is_visible(f, j)).unwrap_or(0);
        let lasts: Vec<usize> = (0..dim).map(last).collect();
        let end = lasts.iter().copied().max().unwrap_or(0);
        goals.end_free = lasts.into_iter().map(|last| last + COMMAND < end).collect();
        goals
    }

    /// Marks the frames of gaps from what is visible.
    fn find_gaps(&mut self) {
        let dim = self.dim;
        for j in 0..dim {
            let mut run = 0;
            for i in (j..self.visible.len()).step_by(dim) {
                run = if self.visible[i] { 0 } else { run + 1 };
                // This frame is the last of a window without any other goal of the joint.
                self.in_gap[i] = run >= COMMAND;
            }
        }
        for i in (0..self.frames.saturating_sub(1) * dim).rev() {
            self.last[i] = self.last[i + dim] && !self.visible[i + dim];
        }
    }

    /// Plans smooth motion in every gap, from each goal of a joint to its next one; see
    /// [`curve::between`]. After its last goal a joint stays. The plan begins at rest, also where a
    /// recording begins in motion.
    fn find_way(&mut self) {
        let mut way = self.q.clone();
        for j in 0..self.dim {
            for (f, q) in curve::between(&self.knots(j)) {
                way[f * self.dim + j] = q;
            }
        }
        self.way = way;
    }

    /// The goals of joint `j`, the start first: frame, value.
    fn knots(&self, j: usize) -> Vec<Knot> {
        let seen = (1..self.frames).filter(|&f| self.is_visible(f, j));
        std::iter::once(0).chain(seen).map(|f| (f, self.row(f)[j])).collect()
    }

    /// These goals with the smooth motion of [`Goals::find_way`] as goals. Frames after the last goal
    /// stay hidden.
    #[must_use]
    pub(super) fn smooth(&self) -> Goals {
        let mut filled = self.clone();
        for i in self.dim..self.q.len() {
            if !self.last[i] {
                filled.q[i] = self.way[i];
                filled.visible[i] = true;
            }
        }
        filled.find_gaps();
        filled
    }

    /// These goals with the planned motion in the gaps that are shown, moved by the corrections.
    #[must_use]
    pub(super) fn led_by(&self, lead: &Lead) -> Goals {
        if lead.shown.is_empty() {
            return self.shifted(&lead.shift);
        }
        let mut filled = self.clone();
        for gap in &lead.shown {
            for i in (gap.from + 1..gap.to)
                .flat_map(|f| gap.joints.iter().map(move |j| f * self.dim + j))
            {
                if !filled.visible[i] {
                    filled.q[i] = filled.way[i];
                    filled.visible[i] = true;
                }
            }
        }
        filled.find_gaps();
        filled.shifted(&lead.shift)
    }

    /// These goals moved by `shift`, (frames, dim). What is hidden follows the goals around it.
    #[must_use]
    fn shifted(&self, shift: &[f64]) -> Goals {
        let (mut moved, d) = (self.clone(), self.dim);
        for j in 0..d {
            let mut knots = self.knots(j);
            for (f, value) in &mut knots[1..] {
                *value = shift[*f * d + j];
            }
            knots[0].1 = 0.0;
            let rest = knots[knots.len() - 1];
            knots.push((self.frames.max(rest.0 + 1), rest.1));
            for pair in knots.windows(2) {
                let ((from, a), (to, b)) = (pair[0], pair[1]);
                for f in from + 1..=to.min(self.frames - 1) {
                    let share = (f - from) as f64 / (to - from) as f64;
                    let by = a + share * (b - a);
                    moved.q[f * d + j] += by;
                    moved.way[f * d + j] += by;
                }
            }
            moved.end[j] += rest.1;
        }
        moved
    }

    /// The goal of joint `j` at frame `f`, or the planned motion.
    pub(super) fn way_at(&self, f: usize, j: usize) -> f64 {
        self.way[f * self.dim + j]
    }

    /// Frames.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// State dimensions.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// Whether joint `j` has a goal at frame `f`.
    pub fn is_visible(&self, f: usize, j: usize) -> bool {
        self.visible[f * self.dim + j]
    }

    /// Whether a frame after the start lacks a goal.
    pub(super) fn has_gaps(&self) -> bool {
        self.visible.iter().skip(self.dim).any(|v| !v)
    }

    /// Whether any joint has a goal at frame `f`.
    pub fn any_visible(&self, f: usize) -> bool {
        self.visible[f * self.dim..(f + 1) * self.dim].iter().any(|&v| v)
    }

    /// Goal (or virtual value) of frame `f`; (dim).
    pub fn row(&self, f: usize) -> &[f64] {
        &self.q[f * self.dim..(f + 1) * self.dim]
    }

    /// The first frame whose goals differ in a way that changes some window; `None` if rollouts of
    /// both give the same motion, but for policies that see the plan through gaps. Both must be for the same robot.
    pub fn first_difference(&self, other: &Goals) -> Option<usize> {
        let common = self.frames.min(other.frames);
        for f in 0..common {
            let rows = f * self.dim..(f + 1) * self.dim;
            let masks_differ = self.visible[rows.clone()] != other.visible[rows.clone()];
            let gap_differs = self.in_gap[rows.clone()] != other.in_gap[rows.clone()];
            let values_differ = rows.clone().any(|i| {
                let shown = self.in_gap[i] || other.in_gap[i];
                (self.visible[i] || shown) && self.q[i].to_bits() != other.q[i].to_bits()
                    || shown && self.last[i] != other.last[i]
            });
            if masks_differ || gap_differs || values_differ {
                return Some(f);
            }
        }
        // One clip ends here and is held; the other continues.
        (self.frames != other.frames).then_some(common)
    }

    /// As [`Goals::first_difference`], for the planned motion through gaps of policies that see it. A
    /// gap shows it in windows from its start on. A window before shows it as well if a single goal
    /// begins the gap, or if it is inside another gap. Where the goals differ, too, that comes first.
    pub(super) fn first_other_plan(&self, other: &Goals) -> Option<usize> {
        let (frames, d) = (self.frames.min(other.frames), self.dim);
        let mut first = None;
        for j in 0..d {
            // The last frame with a goal, and the last one without a goal before that.
            let (mut start, mut before) = (0, 0);
            for f in 1..frames {
                let i = f * d + j;
                if self.visible[i] {
                    if start + 1 < f {
                        before = f - 1;
                    }
                    start = f;
                } else if self.way[i].to_bits() != other.way[i].to_bits() {
                    let single = before > 0 && before + 1 == start;
                    let inside = before > 0 && f <= before + COMMAND - BACK;
                    let from = if single || inside { f } else { start + COMMAND - 1 };
                    first = Some(first.map_or(from, |first: usize| first.min(from)));
                }
            }
        }
        first
    }

    /// Overwrites a goal that no policy may read; visible and virtual goals are unchanged.
    #[cfg(test)]
    pub(super) fn poison_hidden(&mut self, i: usize, value: f64) {
        if !self.visible[i] && !self.in_gap[i] {
            self.q[i] = value;
        }
    }

    /// Writes the command part of the window at frame `t`: goals of t+1 ..= t+20.
    ///
    /// Beyond the end of the clip the last value is held and visible, because a person expects the
    /// robot to stay there. Masking it instead gave the same figures. A joint that was free while others had goals
    /// stays free: it would go back to a goal of long ago, and pull others along where loops are closed.
    fn show(&self, t: usize, window: &mut Window) {
        let last = self.frames.saturating_sub(1);
        let Window { command: q, visible, way, end, free, passing, .. } = window;
        way.resize(COMMAND * self.dim, 0.0);
        match t + COMMAND {
            f if f > last => {
                end.copy_from_slice(&self.end);
                free.copy_from_slice(&self.end_free);
            }
            f => {
                end.copy_from_slice(self.row(f));
                free.copy_from_slice(&self.last[f * self.dim..(f + 1) * self.dim]);
            }
        }
        for i in 0..COMMAND {
            let f = t + 1 + i;
            let rows = i * self.dim..(i + 1) * self.dim;
            if f > last {
                q[rows.clone()].copy_from_slice(&self.end);
                way[rows.clone()].copy_from_slice(&self.end);
                visible[rows].iter_mut().zip(&self.end_free).for_each(|(seen, free)| *seen = !free);
            } else {
                let of = f * self.dim..(f + 1) * self.dim;
                q[rows.clone()].copy_from_slice(self.row(f));
                way[rows.clone()].copy_from_slice(&self.way[of.clone()]);
                visible[rows].copy_from_slice(&self.visible[of]);
            }
        }
        for (j, (free, passing)) in free.iter_mut().zip(passing).enumerate() {
            let hidden = (0..COMMAND).all(|i| !visible[i * self.dim + j]);
            (*free, *passing) = (*free && hidden, !*free && hidden);
            // A joint that waits for a goal beyond the window would have to jump to it in the end.
            visible[(COMMAND - 1) * self.dim + j] |= *passing;
        }
        if !visible.iter().any(|&v| v) {
            visible[(COMMAND - 1) * self.dim..].fill(true);
        }
    }
}

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
        goals.show(t, self);
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
    use super::super::gap::Gap;
    use super::*;

    /// One joint; `None` is masked.
    fn goals(rows: &[Option<f32>], start: f32) -> Goals {
        let q: Vec<f32> = rows.iter().map(|v| v.unwrap_or(0.0)).collect();
        let visible: Vec<bool> = rows.iter().map(Option::is_some).collect();
        Goals::new(&Command::from_dense(vec!["a".into()], vec![start], q, visible).unwrap())
    }

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
    fn first_difference_sees_what_a_window_can_show() {
        let mut rows = vec![None; 60];
        rows[0] = Some(0.0);
        rows[45] = Some(0.9);
        let a = goals(&rows, 0.0);
        assert_eq!(a.first_difference(&a), None);
        rows[45] = Some(0.8);
        // The line through the blind gap changes from the first frame that a window can contain.
        assert_eq!(a.first_difference(&goals(&rows, 0.0)), Some(20));
        rows[45] = Some(0.9);
        rows[50] = Some(0.9);
        assert_eq!(a.first_difference(&goals(&rows, 0.0)), Some(50));
        rows[50] = None;
        rows.push(None);
        assert_eq!(a.first_difference(&goals(&rows, 0.0)), Some(60));
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
    fn a_smooth_plan_fills_gaps_and_leaves_the_tail_hidden() {
        let mut rows = vec![None; 60];
        (rows[0], rows[40]) = (Some(0.0), Some(1.0));
        let plan = goals(&rows, 0.0).smooth();
        assert!((0..=40).all(|f| plan.is_visible(f, 0)) && !plan.is_visible(41, 0));
        let q: Vec<f64> = (0..=40).map(|f| plan.row(f)[0]).collect();
        assert!(q.windows(2).all(|w| w[0] < w[1]), "it never goes back");
        assert!((q[20] - 0.5).abs() < 1e-9 && q[1] < 0.01 && q[39] > 0.99, "it rests at both ends");
        assert!(!window(&plan, 10, 0.0).passing[0], "no virtual keyframe is left");
    }

    #[test]
    fn a_gap_that_is_shown_has_the_plan_as_goals_and_its_corrections_count() {
        let mut rows = vec![None; 41];
        (rows[0], rows[10], rows[20], rows[40]) = (Some(0.0), Some(1.0), Some(2.0), Some(2.0));
        let before = goals(&rows, 0.0);
        let mut lead = Lead::none(41);
        (lead.shift[15], lead.shift[30]) = (0.25, 9.0);
        lead.shown.push(Gap { from: 10, to: 20, joints: vec![0] });
        let after = before.led_by(&lead);
        assert!((10..=20).all(|f| after.is_visible(f, 0)) && !after.is_visible(9, 0));
        assert!((after.row(15)[0] - before.way_at(15, 0) - 0.25).abs() < 1e-12);
        assert_eq!(after.row(14)[0], before.way_at(14, 0));
        // Corrections of a gap that is not shown do not count.
        assert_eq!((after.row(30)[0], after.row(40)[0]), (2.0, 2.0));
    }

    #[test]
    fn a_shift_moves_goals_and_what_leads_to_them() {
        let mut rows = vec![None; 30];
        (rows[0], rows[10], rows[20]) = (Some(0.0), Some(1.0), Some(2.0));
        let mut shift = vec![0.0; 30];
        (shift[10], shift[20]) = (0.1, 0.3);
        // Only goals count: this frame has none.
        shift[15] = 9.0;
        let before = goals(&rows, 0.0);
        let after = before.shifted(&shift);
        let moved = |f: usize| after.row(f)[0] - before.row(f)[0];
        for (f, want) in [(0, 0.0), (5, 0.05), (10, 0.1), (15, 0.2), (20, 0.3), (29, 0.3)] {
            assert!((moved(f) - want).abs() < 1e-12, "frame {f}: {}", moved(f));
        }
        assert!((after.end[0] - before.end[0] - 0.3).abs() < 1e-12);
        assert_eq!(before.first_difference(&after), Some(10));
    }
}
