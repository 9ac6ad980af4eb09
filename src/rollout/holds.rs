//! The stillness of a robot that holds a pose. Errors hardly change if a finger moves to and fro within
//! a hold, but a person sees it at once.
//!
//! A hold of a joint is a run of frames with the same goal, also of each joint that the same actuator moves: the
//! tip of a finger cannot be still while the tendon bends the joint before it. After the last goal of a clip it lasts
//! to the end. The first [`SETTLES`] frames are for arriving. After them the length of the joint's path counts, less
//! what it has come nearer to its goal by the end: a finger that is free at last may still arrive.

use std::collections::btree_map::Entry;
use std::ops::Range;

use super::goals::Goals;
use super::window::HISTORY;
use super::worst::Worst;

/// Frames in which a joint may still arrive.
const SETTLES: usize = 8;
/// Motion of a joint in a hold that is not counted, rad or m.
const ALLOWANCE: f64 = 0.02;
/// A joint that is asked to move no faster than this hardly moves the others of its actuator, rad or m a frame.
const SLOW: f64 = ALLOWANCE / SETTLES as f64;
/// Goals that differ by less are the same, rad or m.
const SAME: f64 = 1e-6;

/// The frames of a hold in which a joint should be still.
struct Hold {
    joint: usize,
    from: usize,
    to: usize,
    goal: f64,
}

/// The holds within the first `frames` frames.
fn holds(goals: &Goals, frames: usize) -> Vec<Hold> {
    let mut found = Vec::new();
    for joint in 0..goals.dim() {
        let last = (1..goals.frames()).rev().find(|&f| goals.is_visible(f, joint));
        let Some(last) = last else { continue };
        let pulled = pulled(goals, joint);
        let goal = |f: usize| goals.row(f.min(last))[joint];
        let seen = |f: usize| f > last || goals.is_visible(f, joint);
        let mut from = 1;
        for f in 2..=frames {
            let same = || seen(f) && seen(from) && (goal(f) - goal(from)).abs() < SAME;
            let goes_on = f < frames && same() && !pulled.get(f).is_some_and(|p| *p);
            if goes_on {
                continue;
            }
            if seen(from) && f > from + SETTLES {
                let (from, goal) = (from + SETTLES - 1, goal(from));
                found.push(Hold { joint, from, to: f - 1, goal });
            }
            from = f;
        }
    }
    found
}

/// Whether, at each frame, another joint of the same actuator is on its way to a different goal; its gaps count.
/// Empty if no joint is tied to this one.
fn pulled(goals: &Goals, joint: usize) -> Vec<bool> {
    let mut found = Vec::new();
    for partner in goals.ties().partners(joint) {
        found.resize(goals.frames(), false);
        let mut from = 0;
        for f in (1..goals.frames()).filter(|&f| goals.is_visible(f, partner)) {
            let way = (goals.row(f)[partner] - goals.row(from)[partner]).abs();
            if way > SLOW * (f - from) as f64 {
                found[from + 1..=f].fill(true);
            }
            from = f;
        }
    }
    found
}

/// The frames about this one with the same goal of a joint, whatever joints that are tied to it do; `None` if it has
/// no goal there.
pub(super) fn around(goals: &Goals, frame: usize, joint: usize) -> Option<Range<usize>> {
    let goal = |f: usize| goals.is_visible(f, joint).then(|| goals.row(f)[joint]);
    let here = goal(frame)?;
    let same = |f: &usize| goal(*f).is_some_and(|there| (there - here).abs() < SAME);
    let before = (1..frame).rev().take_while(same).count();
    let after = (frame..goals.frames()).take_while(same).count();
    Some(frame - before..frame + after)
}

/// The motion of a joint in each hold that does not bring it nearer, rad or m. `states` is (30 + frames, S),
/// up to any frame.
fn motions<'a>(goals: &'a Goals, states: &'a [f64]) -> impl Iterator<Item = (Hold, f64)> + 'a {
    let dim = goals.dim();
    let reached = &states[(HISTORY * dim).min(states.len())..];
    holds(goals, goals.frames().min(reached.len() / dim)).into_iter().map(move |hold| {
        let at = |f: usize| reached[f * dim + hold.joint];
        let error = |f: usize| (at(f) - hold.goal).abs();
        let path: f64 = (hold.from..hold.to).map(|f| (at(f + 1) - at(f)).abs()).sum();
        let nearer = (error(hold.from) - error(hold.to)).max(0.0);
        (hold, path - nearer)
    })
}

/// The largest motion of a joint in a hold; `None` without holds of more than eight frames.
pub(super) fn longest(goals: &Goals, states: &[f64], joints: &[String]) -> Option<Worst> {
    let (hold, value) = motions(goals, states).max_by(|a, b| a.1.total_cmp(&b.1))?;
    let joint = joints[hold.joint].clone();
    Some(Worst { value, joint, frame: hold.from + 1 - SETTLES })
}

/// The motion of all joints in the most restless hold, beyond what each may move; rad or m.
pub(super) fn restlessness(goals: &Goals, states: &[f64]) -> f64 {
    restless(goals, states).map_or(0.0, |(sum, _, _)| sum)
}

/// That motion, and the frame and the joint where that hold begins to matter: of the joint that moves most in it.
pub(super) fn restless(goals: &Goals, states: &[f64]) -> Option<(f64, usize, usize)> {
    let mut by_end = std::collections::BTreeMap::<usize, (f64, Hold, f64)>::new();
    for (hold, motion) in motions(goals, states) {
        let more = (motion - ALLOWANCE).max(0.0);
        match by_end.entry(hold.to) {
            Entry::Vacant(free) => drop(free.insert((more, hold, motion))),
            Entry::Occupied(mut one) => {
                let (sum, worst, most) = one.get_mut();
                *sum += more;
                if motion > *most {
                    (*worst, *most) = (hold, motion);
                }
            }
        }
    }
    let all = by_end.into_values().map(|(sum, hold, _)| (sum, hold.from, hold.joint));
    all.filter(|a| a.0 > 0.0).max_by(|a, b| a.0.total_cmp(&b.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_clip::Command;

    /// Two joints: a goal of 1 at frames 10 to 29 and at 50, the second one at 10 alone.
    fn goals() -> Goals {
        let visible: Vec<bool> =
            (0..60).flat_map(|f| [(10..30).contains(&f) || f == 50, f == 10]).collect();
        let q = visible.iter().map(|&v| f32::from(u8::from(v))).collect();
        let names = vec!["a".into(), "b".into()];
        Goals::new(&Command::from_dense(names, vec![0.0; 2], q, visible).unwrap())
    }

    /// The first joint moves by `step` between these frames, the second one stays.
    fn states(step: f64, between: [usize; 2], frames: usize) -> Vec<f64> {
        let at = |f: usize| if (between[0]..between[1]).contains(&f) { 1.0 + step } else { 1.0 };
        let reached = (0..frames).flat_map(|f| [at(f), 1.0]);
        vec![1.0; HISTORY * 2].into_iter().chain(reached).collect()
    }

    #[test]
    fn a_hold_is_the_frames_around_with_the_same_goal() {
        let goals = goals();
        assert_eq!(around(&goals, 15, 0), Some(10..30));
        assert_eq!(around(&goals, 10, 1), Some(10..11));
        assert_eq!(around(&goals, 40, 0), None);
    }

    #[test]
    fn motion_within_a_hold_counts_and_arriving_does_not() {
        let goals = goals();
        let names = ["a".to_owned(), "b".to_owned()];
        // To and fro within the hold.
        let all = states(0.3, [22, 25], 60);
        assert!((restlessness(&goals, &all) - (0.6 - ALLOWANCE)).abs() < 1e-9);
        let found = longest(&goals, &all, &names).unwrap();
        assert!((found.value - 0.6).abs() < 1e-9, "{found:?}");
        assert_eq!((found.joint.as_str(), found.frame), ("a", 10));
        // Before it, while arriving, in the gap, and at a key of one frame.
        for free in [[3, 10], [11, 17], [33, 45], [49, 52]] {
            assert!(restlessness(&goals, &states(0.3, free, 60)) < 1e-9, "{free:?}");
        }
        // In the last frame of the hold, and after the last goal.
        for held in [[29, 48], [59, 60]] {
            let moved = restlessness(&goals, &states(0.3, held, 60));
            assert!((moved - (0.3 - ALLOWANCE)).abs() < 1e-9, "{held:?}: {moved}");
        }
        // It arrives late.
        let mut late = states(0.3, [0, 25], 60);
        late.iter_mut().skip(1).step_by(2).for_each(|q| *q = 1.0);
        assert!(restlessness(&goals, &late) < 1e-9);
        assert_eq!(restless(&goals, &late), None);
        let (_, frame, joint) = restless(&goals, &all).unwrap();
        assert_eq!((frame, joint), (10 + SETTLES - 1, 0));
        // So far it has not moved.
        assert!(restlessness(&goals, &states(0.3, [22, 25], 20)) < 1e-9);
    }

    #[test]
    fn a_joint_that_the_tendon_moves_for_another_one_is_not_restless() {
        let hand = robert_robot::Robot::builtin("shadow_hand").unwrap();
        let at = |name: &str| hand.joint_index(name).unwrap();
        let (middle, tip, d) = (at("FFJ2"), at("FFJ1"), hand.state_dim());
        let names = || hand.joints().iter().map(|j| j.name.clone()).collect();
        // The middle joint is bent in the frames 20 to 39 and stretches through a gap up to frame 60.
        let bent = |f: usize| [0.0, 0.8][usize::from((20..40).contains(&f))];
        let seen = |f: usize| !(40..60).contains(&f);
        let keys = |f: usize| (0..d).map(move |j| if j == middle { bent(f) } else { 0.0 });
        let visible = (0..80).flat_map(|f| (0..d).map(move |j| j != middle || seen(f))).collect();
        let q = (0..80).flat_map(keys).collect();
        let goals = Goals::new(&Command::from_dense(names(), vec![0.0; d], q, visible).unwrap());
        let tied = goals.clone().tied(&hand);
        let follows = |between: Range<usize>| {
            let mut all = vec![0.0; (HISTORY + 80) * d];
            between.for_each(|f| all[(HISTORY + f) * d + tip] = 0.3);
            (restlessness(&goals, &all), restlessness(&tied, &all))
        };
        let (alone, along) = follows(22..45);
        assert!(alone > 0.2 && along < 1e-9, "{alone} {along}");
        // A slow drift of the middle joint is no reason to flutter.
        let drift =
            |f: usize| (0..d).map(move |j| if j == middle { 0.002 * f as f32 } else { 0.0 });
        let (q, all) = ((0..80).flat_map(drift).collect(), vec![true; 80 * d]);
        let slow = Goals::new(&Command::from_dense(names(), vec![0.0; d], q, all).unwrap());
        let mut states = vec![0.0; (HISTORY + 80) * d];
        states[(HISTORY + 40) * d + tip] = 0.3;
        assert!(restlessness(&slow.tied(&hand), &states) > 0.5);
        // What it does while the tendon is still is its own.
        for own in [10..15, 30..35, 70..75] {
            let (alone, along) = follows(own);
            assert!(along > 0.2 && (alone - along).abs() < 1e-9, "{alone} {along}");
        }
    }
}
