//! The goals of a rollout: a compiled clip with virtual keyframes, the motion planned through its gaps, and the
//! held end.

use std::ops::Range;
use std::sync::Arc;

use super::curve::{self, Knot};
use super::dropout;
use super::lead::Lead;
use super::ties::Ties;
use robert_clip::Command;
use robert_net::COMMAND;
use robert_robot::Robot;

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
    /// The same with smooth motion in every gap ([`Goals::find_way`]), but the likely motion in dropouts
    /// ([`dropout::likely`]); (frames, dim).
    way: Vec<f64>,
    /// (frames, dim).
    visible: Vec<bool>,
    /// Whether this frame is in a gap whose straight line may be used; (frames, dim).
    in_gap: Vec<bool>,
    /// Whether the joint has no goal after this frame; (frames, dim).
    last: Vec<bool>,
    /// The command beyond the end; (dim).
    pub(super) end: Vec<f64>,
    /// Joints that are free beyond the end, because they were free before; (dim).
    pub(super) end_free: Vec<bool>,
    /// These goals, with the likely motion in dropouts as goals, if there are any.
    restored: Option<Arc<Goals>>,
    /// The joints that one actuator moves together; none before [`Goals::tied`].
    ties: Ties,
}

impl Goals {
    /// From a compiled clip.
    pub fn new(command: &Command) -> Goals {
        Goals::after(command, &[])
    }

    /// From a compiled clip that goes on after these states of a recording, of which the last one is that of frame 0;
    /// (any, S).
    pub(super) fn after(command: &Command, history: &[f64]) -> Goals {
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
            restored: None,
            ties: Ties::default(),
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
        let dropouts = goals.find_dropouts(history);
        dropouts.iter().for_each(|&(i, q)| goals.way[i] = q);
        for (to, q) in goals.end.iter_mut().zip(command.held_end()) {
            *to = f64::from(q);
        }
        let last = |j: usize| (0..frames).rev().find(|&f| goals.is_visible(f, j)).unwrap_or(0);
        let lasts: Vec<usize> = (0..dim).map(last).collect();
        let end = lasts.iter().copied().max().unwrap_or(0);
        goals.end_free = lasts.into_iter().map(|last| last + COMMAND < end).collect();
        if !dropouts.is_empty() {
            let mut restored = goals.clone();
            for (i, q) in dropouts {
                (restored.q[i], restored.visible[i]) = (q, true);
            }
            restored.find_gaps();
            goals.restored = Some(Arc::new(restored));
        }
        goals
    }

    /// These goals for a robot, with the joints that one actuator moves together.
    #[must_use]
    pub(super) fn tied(mut self, robot: &Robot) -> Goals {
        let ties = Ties::of(robot);
        if self.ties == ties {
            return self;
        }
        self.ties = ties;
        if let Some(restored) = &mut self.restored {
            Arc::make_mut(restored).ties = self.ties.clone();
        }
        self
    }

    /// The joints that one actuator moves together.
    pub(super) fn ties(&self) -> &Ties {
        &self.ties
    }

    /// The number of goals at these frames. Precision is the mean error over those of all frames but the start.
    pub(super) fn commanded(&self, frames: &Range<usize>) -> f64 {
        let seen = |f: usize| (0..self.dim).filter(move |&j| self.is_visible(f, j)).count();
        frames.clone().map(seen).sum::<usize>() as f64
    }

    /// What tied joints are off together at a frame, with its weight ([`Ties::error`]); rad or m. `reached` is
    /// (frames, S).
    pub(super) fn tied_error(&self, reached: &[f64], f: usize) -> f64 {
        let off = |j: usize| reached[f * self.dim + j] - self.row(f)[j];
        self.ties.error(|j| self.is_visible(f, j).then(|| off(j)))
    }

    /// The likely motion in dropouts, place and value; see [`dropout::likely`].
    fn find_dropouts(&self, before: &[f64]) -> Vec<(usize, f64)> {
        // The state of frame 0 is in both.
        let both = before.len().min(self.dim).min(self.q.len());
        let q = [before, &self.q[both..]].concat();
        let visible = [&vec![true; before.len()][..], &self.visible[both..]].concat();
        let by = before.len() - both;
        dropout::likely(&q, &visible, self.dim).into_iter().map(|(i, q)| (i - by, q)).collect()
    }

    /// These goals, with the likely motion in dropouts as goals.
    pub(super) fn restored(&self) -> &Goals {
        self.restored.as_deref().unwrap_or(self)
    }

    /// Whether a recording lacks a few frames somewhere.
    pub(super) fn has_dropouts(&self) -> bool {
        self.restored.is_some()
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

    /// These goals with the planned motion in gaps as goals. Frames after the last goal
    /// stay hidden.
    #[must_use]
    pub(super) fn smooth(&self) -> Goals {
        let mut filled = Goals { restored: None, ..self.clone() };
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
        let (mut moved, d) = (Goals { restored: None, ..self.clone() }, self.dim);
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

    /// The goals, and the planned motion in gaps, of frame `f`; (dim).
    pub(super) fn way(&self, f: usize) -> &[f64] {
        &self.way[f * self.dim..(f + 1) * self.dim]
    }

    /// Which joints have a goal at frame `f`; (dim).
    pub(super) fn seen(&self, f: usize) -> &[bool] {
        &self.visible[f * self.dim..(f + 1) * self.dim]
    }

    /// Which joints have no goal after frame `f`; (dim).
    pub(super) fn past(&self, f: usize) -> &[bool] {
        &self.last[f * self.dim..(f + 1) * self.dim]
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
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::gap::Gap;
    use super::*;

    /// One joint; `None` is masked.
    pub(in super::super) fn goals(rows: &[Option<f32>], start: f32) -> Goals {
        let q: Vec<f32> = rows.iter().map(|v| v.unwrap_or(0.0)).collect();
        let visible: Vec<bool> = rows.iter().map(Option::is_some).collect();
        Goals::new(&Command::from_dense(vec!["a".into()], vec![start], q, visible).unwrap())
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
    fn a_smooth_plan_fills_gaps_and_leaves_the_tail_hidden() {
        let mut rows = vec![None; 60];
        (rows[0], rows[40]) = (Some(0.0), Some(1.0));
        let plan = goals(&rows, 0.0).smooth();
        assert!((0..=40).all(|f| plan.is_visible(f, 0)) && !plan.is_visible(41, 0));
        let q: Vec<f64> = (0..=40).map(|f| plan.row(f)[0]).collect();
        assert!(q.windows(2).all(|w| w[0] < w[1]), "it never goes back");
        assert!((q[20] - 0.5).abs() < 1e-9 && q[1] < 0.01 && q[39] > 0.99, "it rests at both ends");
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

    #[test]
    fn dropouts_are_goals_of_the_restored_ones_and_count_from_the_history() {
        let at = |f: f64| (0.2 * f).sin();
        let mut rows: Vec<_> = (0..40).map(|f| Some(at(f64::from(f)) as f32)).collect();
        (1..4).chain(20..23).for_each(|f| rows[f] = None);
        let alone = goals(&rows, 0.0);
        let hidden = |g: &Goals| (1..40).filter(|&f| !g.is_visible(f, 0)).collect::<Vec<_>>();
        assert_eq!(hidden(&alone), [1, 2, 3, 20, 21, 22]);
        // How fast the joint moves at the start is only known from the history.
        assert_eq!(hidden(alone.restored()), [1, 2, 3]);
        let history: Vec<f64> = (-30..=0).map(|f| at(f64::from(f))).collect();
        let q = rows.iter().map(|v| v.unwrap_or(0.0)).collect();
        let visible = rows.iter().map(Option::is_some).collect();
        let command = Command::from_dense(vec!["a".into()], vec![0.0], q, visible).unwrap();
        let whole = Goals::after(&command, &history);
        assert!(hidden(whole.restored()).is_empty() && hidden(&whole) == hidden(&alone));
        for f in hidden(&whole) {
            let (way, truth) = (whole.way_at(f, 0), at(f as f64));
            assert!((way - truth).abs() < 1e-3, "frame {f}: {way} instead of {truth}");
            assert_eq!(way, whole.smooth().row(f)[0]);
        }
    }

    #[test]
    fn no_task_that_was_typed_is_taken_for_a_recording() {
        let mut clips = 0;
        for robot in crate::tasks::manifest().unwrap().keys() {
            for suite in ["manual", "extra", "validation", "drawn", "fast", "touch", "final"] {
                for (name, clip) in crate::tasks::suite(robot, suite).unwrap() {
                    let goals = Goals::new(&robert_clip::compile(&clip).unwrap());
                    assert!(!goals.has_dropouts(), "{robot} {name}");
                    clips += 1;
                }
            }
        }
        assert!(clips > 150, "{clips}");
    }
}
