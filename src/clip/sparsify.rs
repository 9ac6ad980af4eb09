//! Finds keys that lie on the straight line between their neighbours.
//!
//! The method divides the curve as Ramer, and Douglas and Peucker do. The key of a run that is
//! farthest from the line between the ends stays and divides the run, until no key is farther away
//! than the tolerance. So the extremes of the motion stay. The distance is the largest over the
//! joints, at the key's own time, so that timing counts too.

use std::collections::BTreeSet;

use super::document::{Clip, Fill, Goal, Key};

/// The frames of chosen keys that can be removed. Each is within `tolerance` (rad or m) of the line
/// between its remaining neighbours.
pub(super) fn superfluous(clip: &Clip, chosen: &BTreeSet<u32>, tolerance: f64) -> BTreeSet<u32> {
    let mut stays = BTreeSet::new();
    for run in clip.keys.chunk_by(|a, b| {
        chosen.contains(&a.frame)
            && chosen.contains(&b.frame)
            && alike(a, b)
            && plain(a)
            && plain(b)
    }) {
        divide(run, tolerance, &mut stays);
    }
    clip.keys.iter().map(|k| k.frame).filter(|f| chosen.contains(f) && !stays.contains(f)).collect()
}

/// Thins a dense clip into keys with straight lines between them, within `tolerance` (rad or
/// m) of every row that was there.
pub fn thin(clip: &mut Clip, tolerance: f64) {
    clip.fill = Fill::Linear;
    // A frame without a value for a joint stays without its goal: the key before it does not reach across.
    let ends = |i: usize| {
        let (key, next) = (&clip.keys[i], clip.keys.get(i + 1)?);
        let (row, then) = (clip.row(key)?, clip.row(next)?);
        let gap = next.frame > key.frame + key.hold;
        Some(gap || row.iter().zip(then).any(|(a, b)| a.is_some() && b.is_none()))
    };
    let ends: Vec<Option<bool>> = (0..clip.keys.len()).map(ends).collect();
    for (key, ends) in clip.keys.iter_mut().zip(ends) {
        key.fill = (ends == Some(true)).then_some(Fill::Mask);
    }
    let chosen = clip.keys.iter().map(|k| k.frame).collect();
    let gone = superfluous(clip, &chosen, tolerance);
    clip.keys.retain(|k| !gone.contains(&k.frame));
}

/// A key that contains only values.
fn plain(key: &Key) -> bool {
    key.hold <= 1
        && key.note.is_empty()
        && key.tangents.is_empty()
        && key.reach.is_empty()
        && matches!(key.goal, Goal::Q(_))
}

/// Two keys for the same joints, with the same fill after them.
fn alike(a: &Key, b: &Key) -> bool {
    let open = |k: &Key| match &k.goal {
        Goal::Q(row) => row.iter().map(Option::is_some).collect(),
        Goal::Pose(_) | Goal::Open => Vec::new(),
    };
    a.fill == b.fill && open(a) == open(b)
}

fn divide(run: &[Key], tolerance: f64, stays: &mut BTreeSet<u32>) {
    let (Some(first), Some(last)) = (run.first(), run.last()) else { return };
    stays.extend([first.frame, last.frame]);
    // An explicit stack, because a hostile clip may have thousands of keys that each divide the
    // rest.
    let mut parts = vec![run];
    while let Some(part) = parts.pop() {
        let farthest = part
            .iter()
            .enumerate()
            .map(|(i, key)| (i, distance(part, key)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((at, far)) = farthest else { continue };
        if far <= tolerance {
            continue;
        }
        if let (Some(key), Some(head), Some(tail)) = (part.get(at), part.get(..=at), part.get(at..))
        {
            stays.insert(key.frame);
            parts.extend([head, tail]);
        }
    }
}

/// Distance of a key from the line between the ends of its part, in its worst joint.
fn distance(part: &[Key], key: &Key) -> f64 {
    let (Some(a), Some(b)) = (part.first(), part.last()) else { return 0.0 };
    let (Goal::Q(from), Goal::Q(to), Goal::Q(row)) = (&a.goal, &b.goal, &key.goal) else {
        return 0.0;
    };
    let span = f64::from(b.frame) - f64::from(a.frame);
    if span <= 0.0 {
        return 0.0;
    }
    let share = (f64::from(key.frame) - f64::from(a.frame)) / span;
    let joints = from.iter().zip(to).zip(row);
    joints
        .filter_map(|((a, b), v)| {
            Some((a.as_ref()? + share * (b.as_ref()? - a.as_ref()?) - v.as_ref()?).abs())
        })
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RobotRef, apply, op::Op};

    fn clip(keys: Vec<Key>) -> Clip {
        let robot = RobotRef {
            id: "r".into(),
            joints: vec!["a".into(), "b".into()],
            ..RobotRef::default()
        };
        let mut clip = Clip::new(robot, 200);
        clip.keys = keys;
        clip
    }

    fn all(clip: &Clip) -> BTreeSet<u32> {
        clip.keys.iter().map(|k| k.frame).collect()
    }

    fn left(clip: &Clip, tolerance: f64) -> Vec<u32> {
        let gone = superfluous(clip, &all(clip), tolerance);
        clip.keys.iter().map(|k| k.frame).filter(|f| !gone.contains(f)).collect()
    }

    #[test]
    fn the_corner_of_a_tent_stays() {
        let tent = |f: u32| if f <= 60 { f64::from(f) } else { 120.0 - f64::from(f) };
        let c = clip((0..=120).map(|f| Key::new(f, &[tent(f) * 0.01, 0.2])).collect());
        assert_eq!(left(&c, 1e-9), [0, 60, 120]);
        assert_eq!(left(&c, 10.0), [0, 120]);
    }

    #[test]
    fn what_goes_lies_within_the_tolerance_of_what_stays() {
        let wave = |f: u32| {
            let t = f64::from(f) / 20.0;
            [(1.3 * t).sin(), (0.7 * t).cos() * 0.5]
        };
        let c = clip((0..200).map(|f| Key::new(f, &wave(f))).collect());
        for tolerance in [0.3, 0.1, 0.02] {
            let stays = left(&c, tolerance);
            assert!(stays.len() < 100 && stays.len() > 3, "{} at {tolerance}", stays.len());
            for w in stays.windows(2) {
                for f in w[0]..=w[1] {
                    let s = f64::from(f - w[0]) / f64::from(w[1] - w[0]);
                    let (a, b, v) = (wave(w[0]), wave(w[1]), wave(f));
                    for j in 0..2 {
                        assert!((a[j] + s * (b[j] - a[j]) - v[j]).abs() <= tolerance + 1e-9);
                    }
                }
            }
        }
        assert!(left(&c, 0.02).len() > left(&c, 0.1).len());
    }

    #[test]
    fn a_dense_clip_becomes_few_keys_and_keeps_its_holes() {
        let mut c = clip(Vec::new());
        let wave = |f: u32| (f64::from(f) / 20.0).sin();
        c.keys = (0..60).chain(90..150).map(|f| Key::new(f, &[wave(f), 0.0])).collect();
        let dense = crate::compile(&c).unwrap();
        thin(&mut c, 0.01);
        assert!(c.keys.len() < 40, "{} keys", c.keys.len());
        let thinned = crate::compile(&c).unwrap();
        for f in 0..150 {
            assert_eq!(thinned.sight(f), dense.sight(f), "frame {f}");
            assert!((thinned.row(f)[0] - dense.row(f)[0]).abs() < 0.011, "frame {f}");
        }
    }

    #[test]
    fn a_joint_without_values_for_a_while_keeps_its_hole() {
        let mut c = clip(Vec::new());
        let wave = |f: u32| Some((f64::from(f) / 20.0).sin());
        let b = |f: u32| wave(f + 9).filter(|_| !(50..80).contains(&f) && f < 120);
        let row = |f: u32| Key::with(f, Goal::Q(vec![wave(f), b(f)]));
        c.keys = (0..150).map(row).collect();
        let dense = crate::compile(&c).unwrap();
        thin(&mut c, 0.01);
        assert!(c.keys.len() < 50, "{} keys", c.keys.len());
        let thinned = crate::compile(&c).unwrap();
        for f in 0..150 {
            for j in 0..2 {
                assert_eq!(thinned.sees(f, j), dense.sees(f, j), "frame {f}, joint {j}");
                assert!((thinned.row(f)[j] - dense.row(f)[j]).abs() < 0.011, "frame {f}");
            }
        }
    }

    #[test]
    fn a_key_that_says_more_than_values_stays() {
        let mut keys: Vec<Key> = (0..6).map(|i| Key::new(10 * i, &[0.0, 0.0])).collect();
        keys[2].hold = 5;
        keys[4].note = "here".into();
        let c = clip(keys);
        assert_eq!(left(&c, 1.0), [0, 10, 20, 30, 40, 50], "each is the end of a run");
        let mut keys: Vec<Key> = (0..8).map(|i| Key::new(10 * i, &[0.0, 0.0])).collect();
        keys[4].goal = Goal::Q(vec![Some(0.0), None]);
        assert_eq!(left(&clip(keys), 1.0), [0, 30, 40, 50, 70], "open joints part the runs");
    }

    #[test]
    fn only_chosen_keys_go_and_undo_brings_them_back() {
        let mut c = clip((0..10).map(|i| Key::new(10 * i, &[0.0, 0.0])).collect());
        let before = c.clone();
        let op = |frames: Vec<u32>, tolerance: f64| {
            Op::KeysSparsify(crate::KeysSparsify { frames, tolerance })
        };
        let back = apply(&mut c, &op(vec![20, 30, 40, 50], 0.1), None).unwrap();
        assert_eq!(all(&c).into_iter().collect::<Vec<_>>(), [0, 10, 20, 50, 60, 70, 80, 90]);
        apply(&mut c, &back, None).unwrap();
        assert_eq!(c, before);
        let refused = apply(&mut c, &op(vec![20, 30], 0.1), None).unwrap_err().to_string();
        assert!(refused.contains("none of these 2 keys can be removed"), "{refused}");
        assert!(apply(&mut c, &op(vec![20], f64::NAN), None).is_err());
        assert!(apply(&mut c, &op(vec![25], 0.1), None).is_err(), "no key there");
    }
}
