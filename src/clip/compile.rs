//! [`Clip`] to [`Command`].
//!
//! Every joint has a track of its own ([`super::tracks`]): the keys that have a value for it. A key commands this
//! value for `hold` frames. Then its fill applies up to the next key of the track. After the last one
//! `linear`, `cubic` and `hold` keep its value, and `mask` commands nothing. Before the first key of its track
//! a joint is masked. Joints that follow others, or that a closed loop carries, have the values that follow
//! ([`super::follow`]). Offsets are added to what keys and fills command. Mask spans override everything.
//!
//! `cubic` is the monotone cubic of Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5,
//! 1984), slope 0 at a hold, at the end of a cubic run and at an extremum. Rejected: a natural
//! cubic. It overshoots, so the curve between two keys inside the joint limits could leave them.
//!
//! A key may set the slope of a joint instead (`tangents`). The curve then is the cubic Hermite curve
//! with this slope, and it may overshoot.
//!
//! Filled values are rounded to the document's 1e-6 grid before they become `f32`, so a command
//! that is exported and imported again has the same bits, unless a mask hides a joint that follows a visible one.

use std::ops::Range;

use super::command::{Command, SpanKind};
use super::curve::{hermite, smooth_slope};
use super::document::{Clip, Fill, Key, Row, Start};
use super::flaw::Invalid;
use super::follow::Completed;
use super::grid::round;
use super::joints::JointTable;
use super::masks::hide;
use super::offset;
use super::solve::{Solved, solve};
use super::spans::Kinds;
use super::tangent::Tangent;
use super::tracks::Tracks;
use robert_base::units::CTRL_DT;

/// Compiles a clip.
///
/// # Errors
/// [`Invalid`] if the clip breaks a rule, which a clip that was parsed or edited here
/// never does, or if it has end-effector goals, which need [`compile_for`].
pub fn compile(clip: &Clip) -> Result<Command, Invalid> {
    compile_for(clip, None)
}

/// Compiles a clip whose end-effector goals are solved with what the table knows about the robot.
///
/// # Errors
/// [`Invalid`] when the clip breaks a rule, or when an end-effector goal names a point that the robot
/// does not have.
pub fn compile_for(clip: &Clip, table: Option<&JointTable>) -> Result<Command, Invalid> {
    clip.validate()?;
    let mut sorted = None;
    if !clip.keys.is_sorted_by_key(|k| k.frame) {
        sorted.insert(clip.clone()).normalize();
    }
    let clip = sorted.as_ref().unwrap_or(clip);
    let solved = solve(clip, table)?;
    let complete = |table| Completed::of(clip, &solved.rows, table);
    let completed = table.map(complete).unwrap_or_default();
    let given: Vec<Option<&Row>> = clip
        .keys
        .iter()
        .enumerate()
        .map(|(i, key)| solved.rows.get(i).and_then(Option::as_ref).or_else(|| clip.row(key)))
        .collect();
    let own = |i: usize| completed.rows.get(i).and_then(Option::as_ref);
    let rows: Vec<Option<&Row>> =
        given.iter().enumerate().map(|(i, row)| own(i).or(*row)).collect();
    let has = |i: usize, j: usize| {
        rows[i].is_some_and(|row: &Row| row[j].is_some() || completed.opens(row, j))
    };
    let tracks = Tracks::of(clip.keys.len(), clip.dim(), has);
    let command = Plan::new(clip, &given, &rows, tracks, &completed).command(&solved);
    Ok(command.with_solved(solved.rows, solved.reached))
}

struct Plan<'a> {
    clip: &'a Clip,
    dim: usize,
    q: Vec<f64>,        // (frames, dim)
    visible: Vec<bool>, // (frames, dim)
    /// Which values follow from others; (frames, dim), empty if none do.
    derived: Vec<bool>,
    kinds: Kinds,
    /// The values of the keys without those that follow from others.
    given: &'a [Option<&'a Row>],
    /// The values of the keys.
    rows: &'a [Option<&'a Row>],
    tracks: Tracks,
    completed: &'a Completed,
    /// For each joint, the first frame at which the value of the key at hand is no longer kept.
    kept: Vec<u32>,
}

impl<'a> Plan<'a> {
    fn new(
        clip: &'a Clip,
        given: &'a [Option<&'a Row>],
        rows: &'a [Option<&'a Row>],
        tracks: Tracks,
        completed: &'a Completed,
    ) -> Self {
        let cells = clip.length as usize * clip.dim();
        Plan {
            clip,
            dim: clip.dim(),
            q: vec![0.0; cells],
            visible: vec![false; cells],
            derived: vec![false; if completed.rows.is_empty() { 0 } else { cells }],
            kinds: Kinds::new(clip.length),
            given,
            rows,
            tracks,
            completed,
            kept: vec![0; clip.dim()],
        }
    }

    fn set(&mut self, frame: u32, joint: usize, value: f64) {
        let at = frame as usize * self.dim + joint;
        if let (Some(q), Some(v)) = (self.q.get_mut(at), self.visible.get_mut(at)) {
            *q = round(value);
            *v = true;
        }
    }

    /// Notes whether a value between these keys follows from others in one of them.
    fn derive(&mut self, frame: u32, joint: usize, keys: &[usize]) {
        if let Some(cell) = self.derived.get_mut(frame as usize * self.dim + joint) {
            let given = |i: &usize| self.given[*i].is_some_and(|row| row[joint].is_some());
            *cell = !keys.iter().all(given);
        }
    }

    fn command(mut self, solved: &Solved) -> Command {
        let clip = self.clip;
        for (i, key) in clip.keys.iter().enumerate() {
            if let Some(row) = self.rows[i] {
                self.key(i, key, row);
            }
        }
        for (frame, values) in &solved.frames {
            for (joint, value) in values {
                self.set(*frame, *joint, *value);
                self.derive(*frame, *joint, &[]);
            }
        }
        let added = offset::total(&clip.offsets, &clip.robot.joints, clip.length);
        for ((q, visible), add) in self.q.iter_mut().zip(&self.visible).zip(&added) {
            if *visible && *add != 0.0 {
                *q = round(*q + add);
            }
        }
        let follows = !self.derived.is_empty();
        let before = if follows { self.visible.clone() } else { Vec::new() };
        let start = self.start(&added).into_iter().map(|v| v as f32).collect();
        let spans = hide(clip, &mut self.visible, self.kinds.spans());
        if follows {
            self.completed.hide(&self.derived, &before, &added, &mut self.visible);
        }
        let joints = clip.robot.joints.clone();
        let q = self.q.into_iter().map(|v| v as f32).collect();
        let command = Command::assemble(joints, start, q, self.visible);
        command.with_spans(spans).with_tracks(self.tracks)
    }

    /// Puts down what a key commands: its values as long as they are kept, and the curves to the next keys.
    fn key(&mut self, i: usize, key: &Key, row: &Row) {
        let clip = self.clip;
        let (fill, full) = (clip.fill_after(key), clip.full_hold(i));
        let curved = matches!(fill, Fill::Linear | Fill::Cubic);
        let (mut held, mut kept, mut filled) = (key.frame, key.frame, key.frame);
        for (j, value) in row.iter().enumerate() {
            self.kept[j] = key.frame;
            if value.is_none() {
                continue;
            }
            let next = self.tracks.next(i, j);
            let until = next.and_then(|n| clip.keys.get(n)).map_or(clip.length, |n| n.frame);
            let is_kept = fill == Fill::Hold || (curved && next.is_none());
            self.kept[j] = if is_kept { until } else { full.min(until) };
            held = held.max(full.min(until));
            kept = kept.max(self.kept[j]);
            if let (true, Some(next)) = (curved && until > full, next)
                && self.curve(i, next, j, fill)
            {
                filled = filled.max(until);
            }
        }
        for frame in key.frame..kept {
            for (j, value) in row.iter().enumerate() {
                if let Some(value) = value
                    && frame < self.kept[j]
                {
                    self.set(frame, j, *value);
                    self.derive(frame, j, &[i]);
                }
            }
        }
        self.kinds.key(i, key.frame, held);
        self.kinds.fill(full, kept, SpanKind::Hold);
        let kind = if fill == Fill::Cubic { SpanKind::Cubic } else { SpanKind::Linear };
        self.kinds.fill(full, filled, kind);
    }

    /// Fills a joint between the last held frame of key `i` and its key `next`. Returns whether that one has a
    /// value.
    fn curve(&mut self, i: usize, next: usize, j: usize, fill: Fill) -> bool {
        let (Some(a), Some(b)) = (self.value(i, j), self.value(next, j)) else { return false };
        if self.completed.carries(i, j) || self.completed.carries(next, j) {
            return false;
        }
        let (end, until) = (self.clip.full_hold(i), self.clip.keys[next].frame);
        let last = end.saturating_sub(1);
        let width = f64::from(until - last);
        let line = (b - a) / width;
        let at = |frame: u32| f64::from(frame - last) / width;
        let keys = [i, next];
        if fill == Fill::Cubic {
            let da = self.tangent(i, j, Tangent::after, line) * width;
            let db = self.tangent(next, j, Tangent::before, line) * width;
            self.set_all(end..until, j, keys, |frame| hermite(at(frame), a, b, da, db));
        } else {
            self.set_all(end..until, j, keys, |frame| a + at(frame) * (b - a));
        }
        true
    }

    /// Sets the values of a joint between two keys.
    fn set_all(
        &mut self,
        frames: Range<u32>,
        joint: usize,
        keys: [usize; 2],
        value: impl Fn(u32) -> f64,
    ) {
        for frame in frames {
            self.set(frame, joint, value(frame));
            self.derive(frame, joint, &keys);
        }
    }

    fn value(&self, i: usize, joint: usize) -> Option<f64> {
        self.rows[i]?.get(joint).copied().flatten()
    }

    /// The state before frame 0: `start` if there is one. Otherwise each joint has the value of its
    /// first key plus its offsets there, or 0 if it has no key.
    fn start(&self, added: &[f64]) -> Vec<f64> {
        let clip = self.clip;
        match &clip.start {
            Some(Start::Q(q)) => q.clone(),
            Some(Start::Pose(pose)) => {
                let row = clip.poses.get(pose).cloned().unwrap_or_default();
                row.into_iter().map(|v| v.unwrap_or(0.0)).collect()
            }
            None => {
                let mut open = clip.dim();
                let mut start: Row = vec![None; open];
                for (key, row) in clip.keys.iter().zip(self.rows) {
                    let Some(row) = row else { continue };
                    let added = added.get(key.frame as usize * self.dim..);
                    for (j, (slot, v)) in start.iter_mut().zip(row.iter()).enumerate() {
                        if slot.is_none()
                            && let Some(v) = v
                        {
                            let more = added.and_then(|a| a.get(j)).copied().unwrap_or_default();
                            *slot = Some(v + more);
                            open -= 1;
                        }
                    }
                    if open == 0 {
                        break;
                    }
                }
                start.into_iter().map(|v| v.map_or(0.0, round)).collect()
            }
        }
    }

    /// Slope at key `i` per frame, on the side that `side` selects. `line` is the slope of the
    /// straight line across that interval, per frame.
    fn tangent(&self, i: usize, joint: usize, side: fn(Tangent, f64) -> f64, line: f64) -> f64 {
        let clip = self.clip;
        let tangents = clip.keys.get(i).map(|key| &key.tangents).filter(|t| !t.is_empty());
        let set = tangents.zip(clip.robot.joints.get(joint)).and_then(|(t, name)| t.get(name));
        match set {
            Some(tangent) => side(*tangent, line / CTRL_DT) * CTRL_DT,
            None => self.slope(i, joint),
        }
    }

    /// Automatic slope at key `i` per frame. It is zero unless the joint has cubic intervals on both
    /// sides.
    fn slope(&self, i: usize, joint: usize) -> f64 {
        let inner = || {
            let clip = self.clip;
            let (p, n) = (self.tracks.before(i, joint)?, self.tracks.next(i, joint)?);
            let (before, key, after) = (clip.keys.get(p)?, clip.keys.get(i)?, clip.keys.get(n)?);
            let cubic = |k| clip.fill_after(k) == Fill::Cubic;
            if !cubic(before)
                || !cubic(key)
                || self.tracks.hold_end(clip, i, joint) != key.frame + 1
            {
                return None;
            }
            let h0 = f64::from(key.frame - (self.tracks.hold_end(clip, p, joint) - 1));
            let h1 = f64::from(after.frame - key.frame);
            let here = self.value(i, joint)?;
            let d0 = (here - self.value(p, joint)?) / h0;
            let d1 = (self.value(n, joint)? - here) / h1;
            Some(smooth_slope(h0, h1, d0, d1))
        };
        inner().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Key, Mask, RobotRef, Sight};
    use super::*;

    fn clip(length: u32) -> Clip {
        let joints = vec!["a".to_owned(), "b".to_owned()];
        Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, length)
    }

    fn column(c: &Command, j: usize) -> Vec<Option<f32>> {
        (0..c.frames()).map(|t| c.sees(t, j).then(|| c.row(t)[j])).collect()
    }

    #[test]
    fn fills_and_holds() {
        let mut k = clip(12);
        k.keys = vec![
            Key::new(1, &[0.0, 1.0]).held(2).filled(Fill::Linear),
            Key::new(6, &[4.0, 1.0]),
            Key::new(8, &[5.0, 5.0]).filled(Fill::Hold),
            Key::new(10, &[6.0, 6.0]),
        ];
        let c = compile(&k).unwrap();
        let n = None;
        let expect = [
            n,
            Some(0.),
            Some(0.),
            Some(1.),
            Some(2.),
            Some(3.),
            Some(4.),
            n,
            Some(5.),
            Some(5.),
            Some(6.),
            n,
        ];
        assert_eq!(column(&c, 0), expect);
        assert_eq!(c.start(), [0.0, 1.0]);
        assert_eq!(
            (c.next_visible(7), c.prev_visible(7), c.next_visible(11)),
            (Some(8), Some(6), None)
        );
        let tiles: Vec<_> = c.spans().iter().map(|s| (s.from, s.to, s.kind)).collect();
        assert_eq!(
            tiles[..3],
            [(0, 1, SpanKind::Open), (1, 3, SpanKind::Key), (3, 6, SpanKind::Linear)]
        );
        assert_eq!(tiles.last(), Some(&(11, 12, SpanKind::Open)));
        k.fill = Fill::Linear;
        assert_eq!(column(&compile(&k).unwrap(), 0)[11], Some(6.0), "nothing to go to: hold");
    }

    #[test]
    fn cubic_never_overshoots_and_rests_at_ends() {
        let mut k = clip(61);
        k.fill = Fill::Cubic;
        let values = [0.0, 1.0, 1.2, -3.0, -3.0, 5.0];
        k.keys = (0..).zip(values).map(|(i, v)| Key::new(i * 12, &[v, v])).collect();
        let c = compile(&k).unwrap();
        for (i, w) in values.windows(2).enumerate() {
            let (lo, hi) = (w[0].min(w[1]) as f32, w[0].max(w[1]) as f32);
            let mut last = w[0] as f32;
            for t in i * 12..=(i + 1) * 12 {
                let v = c.row(t as u32)[0];
                assert!((lo - 1e-6..=hi + 1e-6).contains(&v), "{t}: {v} outside {lo}..{hi}");
                assert!((v - last) * (w[1] - w[0]).signum() as f32 >= -1e-6, "not monotone at {t}");
                last = v;
            }
        }
        assert!((c.row(1)[0] - c.row(0)[0]).abs() < 0.03, "starts at rest");
        let (before, after) = (c.row(12)[0] - c.row(11)[0], c.row(13)[0] - c.row(12)[0]);
        assert!(before > 0.01 && after > 0.01 && before / after < 3.0, "smooth through a key");
    }

    #[test]
    fn tangents_shape_the_curves_beside_their_key() {
        let mut k = clip(41);
        k.fill = Fill::Cubic;
        k.keys = vec![Key::new(0, &[0.0; 2]), Key::new(20, &[1.0; 2]), Key::new(40, &[2.0; 2])];
        let automatic = compile(&k).unwrap();
        let speed = |c: &Command, t: u32| f64::from(c.row(t + 1)[0] - c.row(t)[0]) / CTRL_DT;
        let with = |frame: u32, tangent: Tangent| {
            let mut k = k.clone();
            let key = k.keys.iter_mut().find(|key| key.frame == frame).unwrap();
            key.tangents.insert("a".into(), tangent);
            let c = compile(&k).unwrap();
            assert_eq!(column(&c, 1), column(&automatic, 1), "the other joint keeps its curve");
            c
        };
        let flat = with(20, Tangent::FLAT);
        assert!(speed(&automatic, 20) > 0.9 && speed(&flat, 20) < 0.2 && speed(&flat, 19) < 0.2);
        let corner = with(20, Tangent::corner(-3.0, 2.0));
        assert!((speed(&corner, 19) + 3.0).abs() < 0.8 && (speed(&corner, 20) - 2.0).abs() < 0.3);
        // The cubic Hermite curve itself, 5 of 20 frames after the key: its slope is 2 rad/s.
        let slope = |s: f64| 2.0 * (s * s * s - 2.0 * s * s + s);
        let s = 0.25_f64;
        let expect = 1.0 + slope(s) + (3.0 * s * s - 2.0 * s * s * s);
        assert!((f64::from(corner.row(25)[0]) - expect).abs() < 1e-6);
        let mut k = k.clone();
        for key in &mut k.keys {
            key.tangents.insert("a".into(), Tangent::LINEAR);
        }
        let mut straight = k.clone();
        straight.fill = Fill::Linear;
        let (line, curve) = (compile(&straight).unwrap(), compile(&k).unwrap());
        for (a, b) in column(&line, 0).iter().zip(column(&curve, 0)) {
            assert!((a.unwrap() - b.unwrap()).abs() < 2e-6, "both ends linear: a straight line");
        }
        assert_eq!(k.to_text(), Clip::parse(&k.to_text()).unwrap().to_text());
    }

    #[test]
    fn nulls_and_masks_hide_joints() {
        let mut k = clip(10);
        k.fill = Fill::Linear;
        k.keys = vec![Key::new(0, &[0.0, 0.0]), Key::new(9, &[9.0, 9.0])];
        k.keys.push(Key::with(4, super::super::Goal::Q(vec![Some(8.0), None])));
        k.masks = vec![
            Mask { from: 7, to: 9, joints: None },
            Mask { from: 1, to: 3, joints: Some(vec!["a".into()]) },
        ];
        let c = compile(&k).unwrap();
        assert_eq!(c.sight(1), Sight::Partial, "a is masked, b goes from 0 to 9 past the key at 4");
        assert_eq!((c.sight(0), c.sight(4), c.sight(8)), (Sight::Full, Sight::Full, Sight::Masked));
        assert!(c.sees(3, 0) && c.sees(3, 1) && !c.sees(2, 0));
        assert_eq!(
            (c.row(2), c.row(4)),
            (&[0.0, 2.0][..], &[8.0, 4.0][..]),
            "no masked value leaks"
        );
        assert_eq!(c.start(), [0.0, 0.0]);
    }

    #[test]
    fn blind_spans_follow_the_rule() {
        let mut k = clip(200);
        k.keys = vec![Key::new(10, &[0.0; 2]), Key::new(30, &[1.0; 2]), Key::new(51, &[2.1; 2])];
        let c = compile(&k).unwrap();
        let blind: Vec<_> = c.blind_spans().iter().map(|b| (b.from, b.to)).collect();
        assert_eq!(blind, [(30, 31), (51, 180)], "distance 20 is fine, 21 is blind once");
        for t in 0..200 {
            let inside = blind.iter().any(|b| (b.0..b.1).contains(&t));
            assert_eq!(c.virtual_key(t).is_some(), inside, "{t}");
        }
        let key = c.virtual_key(30).unwrap();
        assert_eq!(key.frame, 50);
        assert!((key.q[0] - (1.0 + 20.0 / 21.0 * 1.1)).abs() < 1e-6);
        assert_eq!(c.virtual_key(100).unwrap().q, [2.1; 2], "a masked tail is held");
        k.keys.clear();
        let c = compile(&k).unwrap();
        assert_eq!(c.blind_spans().len(), 1);
        assert_eq!(c.virtual_key(0).unwrap().q, [0.0; 2]);
    }
}
