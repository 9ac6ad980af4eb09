//! Fills a gap with smooth motion from the reached state to the next goals.
//!
//! In the middle of a gap this is the planned motion from goal to goal, [`super::curve`], to which the
//! reached state is led back in the next [`BACK`] frames. If the next goal is nearer than that, curves
//! of the same kind lead from the reached state through the goals of the window. Each curve is a cubic.
//! The first one starts at the joint's current speed, and each ends at the speed of the motion that
//! follows: zero before a hold, not zero if the goals continue in the same direction. It is computed
//! again in every frame, so a robot that is behind is asked to catch up, but softly. A curve that begins
//! at the reached state becomes straighter if the distance is too long for a soft start, up to the line
//! at constant speed.
//!
//! Rejected: the straight line everywhere (its jerk is four times that of minimum-jerk motion, and the
//! hand is late at every hold); a curve that rests at each goal; leaving a plan that is faster than the
//! joint ever was (more error on both robots; a gap at 95 % of the highest speed is missed by .02 after
//! 30 frames); and always a curve from the reached state to the next goal or to the end of the window.
//! In a motion of seconds the first frames of that curve ask for hardly anything, so the slow joints of
//! the hand did a fifth of the way in the first half of the time and most of it in the last second.

use super::curve::{Knot, Piece, mean_speed, passing_speed};
use super::goals::BACK;
use super::window::{COMMAND, Window};

/// Share of a joint's highest speed above which a curve becomes straighter.
const BRISK: f64 = 0.8;

/// Fills every hidden goal of the window and marks it as visible; joints in the middle of a gap count
/// as free. `speed` is the fastest change of each joint in a frame, rad or m; (S).
pub(super) fn infill(window: &mut Window, speed: &[f64]) {
    let d = window.dim();
    let mut goals: Vec<Knot> = Vec::with_capacity(COMMAND + 1);
    for (j, &fastest) in speed.iter().enumerate() {
        let seen = |i: usize| window.visible[i * d + j];
        if (0..COMMAND).all(seen) {
            continue;
        }
        goals.clear();
        goals.push((0, window.current[j]));
        // The point on the line at the far end of a long gap is not a goal of its own.
        let passing = window.passing[j];
        if passing {
            goals.push((COMMAND, window.end[j]));
        } else if !window.free[j] {
            let all = (0..COMMAND).filter(|i| seen(*i));
            goals.extend(all.map(|i| (i + 1, window.command[i * d + j])));
        }
        let (end, rest) = match goals[..] {
            [_, .., last] => last,
            _ => (0, window.end[j]),
        };
        // A joint passes a key as planned; after a hold, or after its last goal, it stays.
        let known = !window.way.is_empty();
        let alone = (1..COMMAND).contains(&end) && (end == 1 || !seen(end - 2));
        let passes = known && alone;
        let planned = known && end > BACK && goals[1].0 > BACK;
        for i in end..COMMAND {
            window.command[i * d + j] = if passes { window.way[i * d + j] } else { rest };
        }
        if planned {
            // Joints that are coupled to one with a goal give way to it.
            window.free[j] = true;
            for i in (0..end).filter(|i| passing || !window.visible[i * d + j]) {
                window.command[i * d + j] = window.way[i * d + j];
            }
            goals.truncate(1);
            goals.push((BACK, window.command[(BACK - 1) * d + j]));
        }
        let mut speed_here = window.current[j] - window.before(j);
        for k in 1..goals.len() {
            let (from, to) = (goals[k - 1], goals[k]);
            let arrival = match goals.get(k + 1) {
                Some(&next) => passing_speed(from, to, next),
                None if planned || passes => {
                    mean_speed(to, (to.0 + 1, window.command[to.0 * d + j]))
                }
                None if passing => mean_speed(from, to),
                None => 0.0,
            };
            let piece = Piece::new(from, to, speed_here, arrival, BRISK * fastest);
            for frame in from.0 + 1..to.0 {
                window.command[(frame - 1) * d + j] = piece.at(frame);
            }
            speed_here = arrival;
        }
    }
    window.visible.fill(true);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::goals::Goals;
    use crate::lead::Lead;
    use crate::window::HISTORY;
    use robert_base::rng::{Rng, Stream};
    use robert_clip::Command;

    /// The window at frame `t` of one joint that was at `reached` all the time.
    fn window(rows: &[Option<f32>], t: usize, reached: f64) -> Window {
        let q = rows.iter().map(|v| v.unwrap_or(0.0)).collect();
        let visible = rows.iter().map(Option::is_some).collect();
        let start = rows[0].unwrap_or(0.0);
        let command = Command::from_dense(vec!["a".into()], vec![start], q, visible).unwrap();
        let mut window = Window::new(1);
        window.fill(t, &vec![reached; HISTORY + t + 1], &Goals::new(&command));
        window
    }

    fn keys(frames: usize, keys: &[(usize, f32)]) -> Vec<Option<f32>> {
        let mut rows = vec![None; frames];
        for &(f, q) in keys {
            rows[f] = Some(q);
        }
        rows
    }

    fn filled(rows: &[Option<f32>], t: usize, reached: f64, speed: f64) -> Vec<f64> {
        let mut window = window(rows, t, reached);
        infill(&mut window, &[speed]);
        assert!(window.visible.iter().all(|&v| v));
        window.command
    }

    #[test]
    fn goals_stay_and_the_way_between_is_soft_and_never_beyond_them() {
        let way = filled(&keys(60, &[(0, 0.0), (10, 1.0), (18, 0.4)]), 0, 0.0, 1.0);
        assert_eq!((way[9], way[17]), (1.0, 0.4_f32.into()));
        assert!(way[0] < 0.05, "it starts softly: {way:?}");
        assert!(way.iter().all(|&q| (0.0..=1.0).contains(&q)), "{way:?}");
        assert!(way[..10].windows(2).all(|w| w[1] >= w[0]), "{way:?}");
        assert_eq!(way[19], way[17], "the last goal is held");
    }

    #[test]
    fn goals_in_one_direction_are_passed_at_speed() {
        let way = filled(&keys(60, &[(0, 0.0), (6, 0.5), (12, 1.0), (18, 1.5)]), 0, 0.0, 1.0);
        let at = way[6] - way[5];
        assert!((at - 0.5 / 6.0).abs() < 0.02, "{at}");
    }

    #[test]
    fn a_way_that_is_too_fast_for_a_soft_start_is_straight() {
        let way = filled(&keys(40, &[(0, 0.0), (5, 1.0)]), 0, 0.0, 0.15);
        for (i, q) in way[..5].iter().enumerate() {
            assert!((q - 0.2 * (i + 1) as f64).abs() < 1e-6, "{way:?}");
        }
    }

    #[test]
    fn a_long_gap_is_crossed_as_planned() {
        let rows = keys(100, &[(0, 0.0), (60, 0.6)]);
        let plan = |f: usize| {
            let u = f as f64 / 60.0;
            0.6 * u * u * (3.0 - 2.0 * u)
        };
        // A joint that is behind is led back to the plan, without a jump.
        let way = filled(&rows, 30, 0.2, 1.0);
        for (i, q) in way.iter().enumerate().skip(BACK - 1) {
            assert!((q - plan(31 + i)).abs() < 1e-6, "{i}: {way:?}");
        }
        let mut before = 0.2;
        for q in &way[..BACK] {
            assert!((0.0..0.05).contains(&(q - before)), "{way:?}");
            before = *q;
        }
    }

    #[test]
    fn the_middle_of_a_gap_does_not_depend_on_whether_its_end_is_in_sight() {
        let rows = keys(100, &[(0, 0.0), (60, 0.6)]);
        let [before, at] = [39, 40].map(|t| filled(&rows, t, 0.4, 1.0));
        for (a, b) in before[BACK..].iter().zip(&at[BACK - 1..]) {
            assert!((a - b).abs() < 1e-6, "{before:?} {at:?}");
        }
    }

    #[test]
    fn a_joint_of_which_nothing_more_is_asked_stays() {
        let way = filled(&keys(100, &[(0, 0.3), (5, 0.5)]), 10, 0.4, 1.0);
        assert!(way.iter().all(|&q| (q - 0.5).abs() < 1e-6), "{way:?}");
    }

    #[test]
    fn keys_in_one_direction_are_passed_at_speed_before_the_next_one_is_in_sight() {
        let rows = keys(130, &[(0, 0.0), (30, 0.5), (60, 1.0), (90, 1.5), (120, 2.0)]);
        for t in 31..90 {
            // The joint is on the way at constant speed.
            let at = |f: usize| f as f64 / 60.0;
            let q = rows.iter().map(|v| v.unwrap_or(0.0)).collect();
            let visible = rows.iter().map(Option::is_some).collect();
            let command = Command::from_dense(vec!["a".into()], vec![0.0], q, visible).unwrap();
            let mut w = Window::new(1);
            let reached: Vec<f64> =
                (0..=HISTORY + t).map(|i| at(i.saturating_sub(HISTORY))).collect();
            w.fill(t, &reached, &Goals::new(&command));
            infill(&mut w, &[1.0]);
            for (i, q) in w.command.iter().enumerate().take(90 - t) {
                assert!((q - at(t + 1 + i)).abs() < 1e-3, "{t}, {i}: {:?}", w.command);
            }
        }
    }

    #[test]
    fn without_a_plan_a_curve_leads_from_the_reached_state() {
        let rows = keys(100, &[(0, 0.0), (14, 0.6)]);
        let mut w = window(&rows, 0, 0.5);
        w.way.clear();
        infill(&mut w, &[1.0]);
        assert!(w.command.iter().all(|q| (0.5..0.61).contains(q)), "{:?}", w.command);
    }

    /// Windows before the frame that a change of the goals goes back to are filled alike.
    #[test]
    fn a_change_of_the_goals_goes_back_far_enough_and_not_to_the_start() {
        const JOINTS: usize = 2;
        let (mut kept, mut first_seen) = (0, 0);
        for case in 0..4_000 {
            let mut rng = Rng::new(11, Stream::Test, case);
            let frames = 30 + rng.below(60) as usize;
            let mut rows = vec![[None; JOINTS]; frames];
            for _ in 0..=rng.below(8) {
                let (j, from) = (rng.below(2) as usize, rng.below(frames as u64) as usize);
                let held = [1, 1, 3, 12][rng.below(4) as usize];
                for row in &mut rows[from..(from + held).min(frames)] {
                    row[j] = Some(rng.range(-1.0, 1.0) as f32);
                }
            }
            let before = goals_of(&rows);
            let (f, j) = (rng.below(frames as u64) as usize, rng.below(2) as usize);
            rows[f][j] = if rng.below(3) == 0 { None } else { Some(rng.range(-1.0, 1.0) as f32) };
            if rng.below(5) == 0 {
                rows.truncate(frames - 5);
            }
            let mut after = goals_of(&rows);
            let mut before = before;
            if rng.below(4) == 0 {
                let shift: Vec<f64> = (0..frames * JOINTS).map(|_| rng.range(-0.1, 0.1)).collect();
                let until = |frames: usize| Lead::of(shift[..frames * JOINTS].to_vec());
                before = before.led_by(&until(frames));
                after = after.led_by(&until(after.frames()));
            }
            let changes = [before.first_difference(&after), before.first_other_plan(&after)];
            let stands = changes.into_iter().flatten().min().unwrap_or(usize::MAX);
            let last = before.frames().min(after.frames()) - 1;
            let reached: Vec<f64> =
                (0..(HISTORY + last + 1) * JOINTS).map(|i| 0.3 * (i as f64 / 17.0).sin()).collect();
            let speed = [1.0, 0.05][rng.below(2) as usize];
            let window = |goals: &Goals, t: usize| {
                let mut w = Window::new(JOINTS);
                w.fill(t, &reached, goals);
                infill(&mut w, &[speed; JOINTS]);
                (w.command.iter().map(|q| q.to_bits()).collect::<Vec<_>>(), w.free)
            };
            let differs = |t: &usize| window(&before, *t) != window(&after, *t);
            let first = (0..last).find(differs).unwrap_or(last);
            let from = stands.saturating_sub(COMMAND).min(last);
            assert!(from <= first, "{case}: from {from}, but window {first} differs");
            kept += from;
            first_seen += first;
        }
        assert!(kept * 10 > first_seen * 8, "{kept} of {first_seen} frames are kept");
    }

    fn goals_of(rows: &[[Option<f32>; 2]]) -> Goals {
        let q = rows.iter().flatten().map(|v| v.unwrap_or(0.0)).collect();
        let visible = rows.iter().flatten().map(Option::is_some).collect();
        let names = vec!["a".into(), "b".into()];
        Goals::new(&Command::from_dense(names, vec![0.0; 2], q, visible).unwrap())
    }
}
