//! Features: what the network and the linear skip see of a window.
//!
//! A network that sees only the mask vector repeats its last action as soon as the next frame is
//! hidden, and arrives late. The *goal velocity* corrects that: the distance to the next visible
//! frame divided by the remaining frames. Goal velocity, the filled sequence, and features of joint
//! stops and hinge angles are computed here from visible frames only. A test overwrites hidden
//! frames and requires the same bits.

use serde::{Deserialize, Serialize};

use super::Error;
use super::config::{CURRENT, MaskGranularity, TokenKind, WINDOW};

/// The facts about a robot that the features need.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Facts {
    /// State joints in order.
    pub joints: Vec<JointFacts>,
    /// Actuators.
    pub actions: usize,
}

/// One state joint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointFacts {
    /// Whether it turns instead of sliding.
    pub hinge: bool,
    /// Stops in rad or m; `None` for a joint without stops.
    pub range: Option<[f64; 2]>,
}

impl JointFacts {
    /// Whether the joint is a slide without stops. Its position has no effect on the dynamics, and
    /// features of its absolute position would only tie the network to the recorded places.
    fn floats(self) -> bool {
        !self.hinge && self.range.is_none()
    }
}

/// Mean and spread of the training split, per joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Normaliser {
    /// Mean position.
    pub mean: Vec<f64>,
    /// Standard deviation of positions; see also [`Normaliser::centre_floating`].
    pub std: Vec<f64>,
    /// Standard deviation of s(t+1) − s(t).
    pub std_d1: Vec<f64>,
    /// Standard deviation of s(t+1) − 2 s(t) + s(t−1).
    pub std_d2: Vec<f64>,
}

impl Normaliser {
    /// Measures episodes of joint positions, each (frames, S) row-major.
    pub fn measure<'a>(state: usize, episodes: impl Iterator<Item = &'a [f32]>) -> Self {
        let mut moments = vec![[[0.0_f64; 3]; 3]; state]; // [order][n, mean, m2]
        let mut see = |j: usize, order: usize, x: f64| {
            let [n, mean, m2] = &mut moments[j][order];
            *n += 1.0;
            let d = x - *mean;
            *mean += d / *n;
            *m2 += d * (x - *mean);
        };
        for episode in episodes {
            let at = |t: usize, j: usize| f64::from(episode[t * state + j]);
            for t in 0..episode.len() / state.max(1) {
                for j in 0..state {
                    see(j, 0, at(t, j));
                    if t >= 1 {
                        see(j, 1, at(t, j) - at(t - 1, j));
                    }
                    if t >= 2 {
                        see(j, 2, at(t, j) - 2.0 * at(t - 1, j) + at(t - 2, j));
                    }
                }
            }
        }
        // A joint that never moves must not divide by zero.
        let spread = |order: usize, floor: f64| {
            moments.iter().map(|m| (m[order][2] / m[order][0].max(1.0)).sqrt().max(floor)).collect()
        };
        Normaliser {
            mean: moments.iter().map(|m| m[0][1]).collect(),
            std: spread(0, 1e-3),
            std_d1: spread(1, 1e-5),
            std_d2: spread(2, 1e-6),
        }
    }

    /// Replaces the spread of slides without stops by [`TYPICAL_FRAMES`] of typical motion. A `pos`
    /// token contains the distance of such a slide from the current frame. Recorded positions can
    /// spread over many metres; in that unit the motion within a window would be nearly invisible.
    pub fn centre_floating(&mut self, joints: &[JointFacts]) {
        for (j, _) in joints.iter().enumerate().filter(|(_, j)| j.floats()) {
            self.std[j] = TYPICAL_FRAMES * self.std_d1[j];
        }
    }
}

/// The features of a token.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TokenConfig {
    /// Token variant.
    pub kind: TokenKind,
    /// Whether a mask hides whole frames or single joints.
    pub granularity: MaskGranularity,
    /// Whether stop distances and hinge angles are part of a `goal` token.
    pub profile: bool,
    /// Back differences in the features of the linear fit; plants with little damping need
    /// more than 2.
    pub ridge_history: usize,
    /// Whether the linear fit gets the smoothed sign of each goal velocity, which stands for the
    /// torque that overcomes dry friction.
    #[serde(default)]
    pub ridge_friction: bool,
    /// Whether the token of a frame, up to the current one, contains the action history: how far
    /// the last action was from the linear prediction, and the ratio of applied to predicted
    /// actions over the past.
    #[serde(default)]
    pub previous_action: bool,
}

impl TokenConfig {
    /// The defaults for this robot: `goal` tokens with profile features, and sixteen differences if
    /// a joint slides freely, else two.
    pub fn for_robot(facts: &Facts) -> Self {
        let floats = facts.joints.iter().any(|j| j.floats());
        TokenConfig {
            kind: TokenKind::Goal,
            granularity: MaskGranularity::State,
            profile: true,
            ridge_history: if floats { 16 } else { 2 },
            ridge_friction: true,
            previous_action: false,
        }
    }
}

/// The unit of distances from the current frame, in frames of typical motion.
const TYPICAL_FRAMES: f64 = 10.0;
/// Up to this many hinges, sines of all pairwise angle sums are features; they describe the gravity
/// of a chain. 22 hinges would have 231 sums, most of them meaningless.
const SUMMED_HINGES: usize = 8;
/// Distance at which a stop affects a joint, rad or m.
const STOP_ZONE: f32 = 0.1;
/// Goal velocity at which the smoothed sign for friction is one half, rad or m per frame.
const CREEP: f32 = 0.002;
/// Scales the small stop distances to the size of other features.
const STOP_SCALE: f32 = 10.0;

/// Number of linear maps. Map 0 is for visible frames without a later visible frame, maps 1 to 20
/// for that number of frames to the next visible frame. Maps 21 and 22 are for frames that are
/// hidden or follow a hidden frame, with and without a later visible frame.
pub const RIDGE_HEADS: usize = 23;
const HEAD_HIDDEN: usize = 21;
const HEAD_HIDDEN_LAST: usize = 22;

/// Computes features. Immutable; threads share it, each with its own [`Scratch`].
#[derive(Clone, Debug)]
pub struct Tokeniser {
    cfg: TokenConfig,
    facts: Facts,
    mean: Vec<f32>,
    scale: Vec<f32>,
    scale_d1: Vec<f32>,
    scale_d2: Vec<f32>,
    stops: Vec<(usize, f32, f32)>,
    hinges: Vec<usize>,
    sums: Vec<(usize, usize)>,
}

/// Memory for the features of one window.
#[derive(Clone, Debug)]
pub struct Scratch {
    /// Filled sequence, (51, S).
    filled: Vec<f32>,
    /// Goal velocity per frame, (51, S), 0 without a goal.
    goal: Vec<f32>,
    /// Velocity of the segment after the goal, (51, S).
    after: Vec<f32>,
    /// Frames to the next visible one, 0 for none, (51, S).
    left: Vec<u8>,
    /// Whether any joint of a frame is visible, and frames to the next such frame.
    seen: [bool; WINDOW],
    next: [u8; WINDOW],
    /// First frame that was read; what lies before it is of an earlier window.
    first: usize,
}

impl Tokeniser {
    /// The features that `cfg` chooses for this robot.
    ///
    /// # Errors
    /// [`Error::Shape`] when the normaliser has another number of joints,
    /// [`Error::Config`] when it contains values that are not positive and finite.
    pub fn new(cfg: TokenConfig, facts: Facts, norm: &Normaliser) -> Result<Self, Error> {
        let want = facts.joints.len();
        for (what, x) in [
            ("normaliser mean", &norm.mean),
            ("normaliser std", &norm.std),
            ("normaliser std_d1", &norm.std_d1),
            ("normaliser std_d2", &norm.std_d2),
        ] {
            if x.len() != want {
                return Err(Error::Shape { what, want, got: x.len() });
            }
            if x.iter().any(|x| !x.is_finite() || (what != "normaliser mean" && *x <= 0.0)) {
                return Err(Error::Config { field: what, why: "not positive and finite".into() });
            }
        }
        if !(1..=CURRENT).contains(&cfg.ridge_history) {
            let why = format!("{} is not in 1..={CURRENT}", cfg.ridge_history);
            return Err(Error::Config { field: "ridge_history", why });
        }
        let single = |x: &[f64]| x.iter().map(|&x| x as f32).collect::<Vec<_>>();
        let inverse = |x: &[f64]| x.iter().map(|&x| (1.0 / x) as f32).collect::<Vec<_>>();
        let hinges: Vec<usize> =
            facts.joints.iter().enumerate().filter(|(_, j)| j.hinge).map(|(i, _)| i).collect();
        let pairs = if hinges.len() <= SUMMED_HINGES { hinges.len() } else { 0 };
        let sums = (0..pairs).flat_map(|a| (a + 1..pairs).map(move |b| (a, b)));
        let stops = facts.joints.iter().enumerate();
        Ok(Tokeniser {
            mean: single(&norm.mean),
            scale: inverse(&norm.std),
            scale_d1: inverse(&norm.std_d1),
            scale_d2: inverse(&norm.std_d2),
            stops: stops
                .filter_map(|(i, j)| j.range.map(|[lo, hi]| (i, lo as f32, hi as f32)))
                .collect(),
            sums: sums.map(|(a, b)| (hinges[a], hinges[b])).collect(),
            hinges,
            cfg,
            facts,
        })
    }

    /// State joints S.
    pub fn state(&self) -> usize {
        self.facts.joints.len()
    }

    /// The facts about the robot.
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// The choice of features.
    pub fn config(&self) -> &TokenConfig {
        &self.cfg
    }

    /// Whether the features of the linear fit are the same as those of `other`, in every window.
    pub fn same_ridge_features(&self, other: &Tokeniser) -> bool {
        let cfg = |t: &Tokeniser| (t.cfg.ridge_history, t.cfg.ridge_friction);
        cfg(self) == cfg(other) && self.facts == other.facts && self.scale_d1 == other.scale_d1
    }

    fn profile_len(&self) -> usize {
        8 * self.stops.len() + 2 * (self.hinges.len() + self.sums.len())
    }

    /// Features in a token that depend on positions only, without actions and the linear
    /// prediction.
    pub fn inputs(&self) -> usize {
        let s = self.state();
        let joint = self.cfg.granularity == MaskGranularity::Joint;
        match self.cfg.kind {
            TokenKind::Pos => s + if joint { s } else { 0 },
            TokenKind::PosD | TokenKind::Fill => 4 * s + if joint { s } else { 0 },
            TokenKind::Goal => {
                let profile = if self.cfg.profile { self.profile_len() } else { 0 };
                6 * s + if joint { 3 * s } else { 3 } + profile
            }
        }
    }

    /// Features of the linear fit.
    pub fn ridge_inputs(&self) -> usize {
        let friction = usize::from(self.cfg.ridge_friction);
        (3 + self.cfg.ridge_history + friction) * self.state() + 1 + self.profile_len()
    }

    /// Whether the mask vector replaces the embedding of a hidden frame.
    pub fn mask_replaces(&self) -> bool {
        matches!(self.cfg.kind, TokenKind::Pos | TokenKind::PosD)
    }

    /// Memory for one thread.
    pub fn scratch(&self) -> Scratch {
        let n = WINDOW * self.state();
        Scratch {
            filled: vec![0.0; n],
            goal: vec![0.0; n],
            after: vec![0.0; n],
            left: vec![0; n],
            seen: [true; WINDOW],
            next: [0; WINDOW],
            first: 0,
        }
    }

    /// Reads a window: positions `q` (51, S) and which of them are visible (51, S). History and
    /// current frame must be visible. The other methods then refer to this window, as long as they
    /// get the same `scratch`.
    pub fn read(&self, q: &[f32], visible: &[bool], scratch: &mut Scratch) {
        self.read_from(0, q, visible, scratch);
    }

    /// As [`Tokeniser::read`], without the frames before `first`, which must be visible. Then only
    /// features that do not depend on these frames may be asked for.
    pub(crate) fn read_from(
        &self,
        first: usize,
        q: &[f32],
        visible: &[bool],
        scratch: &mut Scratch,
    ) {
        let s = self.state();
        scratch.first = first;
        for j in 0..s {
            self.fill_joint(j, first, q, visible, scratch);
        }
        let mut next = 0_u8;
        for i in (0..WINDOW).rev() {
            scratch.next[i] = next;
            scratch.seen[i] = visible[i * s..(i + 1) * s].iter().any(|&v| v);
            next = match (scratch.seen[i], next) {
                (true, _) => 1,
                (false, 0) => 0,
                (false, n) => n + 1,
            };
        }
    }

    /// One joint's filled sequence, goal velocity and the velocity after it.
    fn fill_joint(
        &self,
        j: usize,
        first: usize,
        q: &[f32],
        visible: &[bool],
        scratch: &mut Scratch,
    ) {
        let s = self.state();
        let Scratch { filled, goal, after, left, .. } = scratch;
        // Backwards: the next visible frame and the one after that.
        let mut near: Option<(usize, f32)> = None;
        let mut far: Option<(usize, f32)> = None;
        for i in (first..WINDOW).rev() {
            let at = i * s + j;
            left[at] = near.map_or(0, |(n, _)| (n - i) as u8);
            after[at] = match (near, far) {
                (Some((n, a)), Some((m, b))) => (b - a) / (m - n) as f32,
                _ => 0.0,
            };
            // Stores the goal for now; the division follows when the frame is filled.
            goal[at] = near.map_or(0.0, |(_, x)| x);
            if visible[at] {
                (far, near) = (near, Some((i, q[at])));
            }
        }
        // Forwards: hidden frames are on the line to the goal, or keep the last value.
        let mut last = near.map_or(0.0, |(_, x)| x);
        for i in first..WINDOW {
            let at = i * s + j;
            let frames = left[at];
            let here = if visible[at] {
                q[at]
            } else if frames > 0 {
                last + (goal[at] - last) / f32::from(frames + 1)
            } else {
                last
            };
            filled[at] = here;
            goal[at] = if frames > 0 { (goal[at] - here) / f32::from(frames) } else { 0.0 };
            last = here;
        }
    }

    /// Features of joint stops and hinge angles for one frame; `to` has [`Self::profile_len`] places.
    fn profile(&self, scratch: &Scratch, frame: usize, to: &mut [f32]) {
        let s = self.state();
        let q = &scratch.filled[frame * s..(frame + 1) * s];
        let v = &scratch.goal[frame * s..(frame + 1) * s];
        let (stops, angles) = to.split_at_mut(8 * self.stops.len());
        for (&(j, lo, hi), to) in self.stops.iter().zip(stops.chunks_exact_mut(8)) {
            for (x, to) in [q[j], q[j] + v[j]].into_iter().zip(to.chunks_exact_mut(4)) {
                to[0] = STOP_SCALE * (x - (hi - STOP_ZONE)).max(0.0);
                to[1] = STOP_SCALE * (x - hi).max(0.0);
                to[2] = STOP_SCALE * (lo + STOP_ZONE - x).max(0.0);
                to[3] = STOP_SCALE * (lo - x).max(0.0);
            }
        }
        let single = self.hinges.iter().map(|&j| q[j]);
        let all = single.chain(self.sums.iter().map(|&(a, b)| q[a] + q[b]));
        for (angle, to) in all.zip(angles.chunks_exact_mut(2)) {
            [to[0], to[1]] = angle.sin_cos().into();
        }
    }

    /// Whether the mask vector marks this frame of the window read.
    pub fn masked(&self, scratch: &Scratch, frame: usize) -> bool {
        !scratch.seen[frame]
    }

    /// Head of the linear fit for this frame.
    pub fn ridge_head(&self, scratch: &Scratch, frame: usize) -> usize {
        let after_hidden = frame > 0 && !scratch.seen[frame - 1];
        let next = usize::from(scratch.next[frame]);
        match (!scratch.seen[frame] || after_hidden, next) {
            (true, 0) => HEAD_HIDDEN_LAST,
            (true, _) => HEAD_HIDDEN,
            (false, k) => k.min(20),
        }
    }

    /// Features of the linear fit for one frame; `to` has [`Tokeniser::ridge_inputs`] places.
    pub fn ridge_features(&self, scratch: &Scratch, frame: usize, to: &mut [f32]) {
        let known = scratch.first == 0 || frame >= scratch.first + self.cfg.ridge_history;
        assert!(known, "frame {frame} was not read");
        let (s, p) = (self.state(), self.profile_len());
        let (base, rest) = to.split_at_mut(3 * s);
        for j in 0..s {
            let at = frame * s + j;
            let floats = self.facts.joints[j].floats();
            base[j] = if floats { 0.0 } else { scratch.filled[at] * (1.0 / 3.0) };
            base[s + j] = scratch.goal[at] * self.scale_d1[j];
            base[2 * s + j] = scratch.after[at] * self.scale_d1[j];
        }
        let (past, rest) = rest.split_at_mut(self.cfg.ridge_history * s);
        for (back, past) in past.chunks_exact_mut(s).enumerate() {
            for (j, x) in past.iter_mut().enumerate() {
                *x = if frame > back {
                    let at = (frame - back) * s + j;
                    (scratch.filled[at] - scratch.filled[at - s]) * self.scale_d1[j]
                } else {
                    0.0
                };
            }
        }
        rest[0] = 1.0;
        self.profile(scratch, frame, &mut rest[1..=p]);
        let goal = &scratch.goal[frame * s..(frame + 1) * s];
        for (x, &v) in rest[1 + p..].iter_mut().zip(goal) {
            *x = v / (v.abs() + CREEP);
        }
    }

    /// Token features of one frame; `to` has [`Tokeniser::inputs`] places. `visible` is that of the
    /// window read.
    pub fn token(&self, scratch: &Scratch, visible: &[bool], frame: usize, to: &mut [f32]) {
        let s = self.state();
        let joint = self.cfg.granularity == MaskGranularity::Joint;
        let seen = |i: usize, j: usize| visible[i * s + j];
        let filled = |i: usize, j: usize| scratch.filled[i * s + j];
        let hide = self.mask_replaces();
        for j in 0..s {
            let here = filled(frame, j);
            let centred = here - filled(CURRENT, j);
            let floats = self.facts.joints[j].floats();
            let absolute = (here - self.mean[j]) * self.scale[j];
            let centred_unit = centred * self.scale_d1[j] * (1.0 / TYPICAL_FRAMES as f32);
            let known = !hide || seen(frame, j);
            let back = if frame > 0 { here - filled(frame - 1, j) } else { 0.0 };
            let bend = if frame > 0 && frame + 1 < WINDOW {
                (filled(frame + 1, j) - here) - back
            } else {
                0.0
            };
            let back_known = known && (!hide || frame > 0 && seen(frame - 1, j));
            let bend_known = back_known && (!hide || frame + 1 < WINDOW && seen(frame + 1, j));
            let only = |keep: bool, x: f32| if keep { x } else { 0.0 };
            if self.cfg.kind == TokenKind::Pos {
                to[j] = only(known, if floats { centred * self.scale[j] } else { absolute });
                continue;
            }
            to[j] = only(known && !floats, absolute);
            to[s + j] = only(known, centred_unit);
            to[2 * s + j] = only(back_known, back * self.scale_d1[j]);
            if self.cfg.kind == TokenKind::Goal {
                let at = frame * s + j;
                to[3 * s + j] = scratch.goal[at] * self.scale_d1[j];
                to[4 * s + j] = only(scratch.left[at] == 1, bend * self.scale_d2[j]);
                to[5 * s + j] = scratch.after[at] * self.scale_d1[j];
            } else {
                to[3 * s + j] = only(bend_known, bend * self.scale_d2[j]);
            }
        }
        let flag = |v: bool| if v { 1.0 } else { 0.0 };
        let soon = |k: u8| if k > 0 { 1.0 / f32::from(k) } else { 0.0 };
        let used = match self.cfg.kind {
            TokenKind::Pos => s,
            TokenKind::PosD | TokenKind::Fill => 4 * s,
            TokenKind::Goal => 6 * s,
        };
        let rest = &mut to[used..];
        match (self.cfg.kind, joint) {
            (TokenKind::Goal, true) => {
                for j in 0..s {
                    let k = scratch.left[frame * s + j];
                    rest[j] = soon(k);
                    rest[s + j] = f32::from(k) * 0.1;
                    rest[2 * s + j] = flag(seen(frame, j));
                }
            }
            (TokenKind::Goal, false) => {
                let k = scratch.next[frame];
                rest[0] = soon(k);
                rest[1] = f32::from(k) * 0.1;
                rest[2] = flag(scratch.seen[frame]);
            }
            (_, true) => (0..s).for_each(|j| rest[j] = flag(seen(frame, j))),
            (_, false) => {}
        }
        if self.cfg.kind == TokenKind::Goal && self.cfg.profile {
            let p = self.profile_len();
            let end = to.len();
            self.profile(scratch, frame, &mut to[end - p..]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mask::MaskKind;
    use robert_base::rng::{Rng, Stream};

    fn facts() -> Facts {
        let hinge = |lo: f64, hi: f64| JointFacts { hinge: true, range: Some([lo, hi]) };
        Facts {
            joints: vec![
                hinge(-1.0, 1.0),
                JointFacts { hinge: false, range: None },
                JointFacts { hinge: true, range: None },
                JointFacts { hinge: false, range: Some([0.0, 0.5]) },
            ],
            actions: 3,
        }
    }

    fn norm() -> Normaliser {
        Normaliser {
            mean: vec![0.1, 0.0, -0.2, 0.2],
            std: vec![0.5, 1.0, 0.7, 0.3],
            std_d1: vec![0.02, 0.05, 0.03, 0.01],
            std_d2: vec![0.01, 0.02, 0.01, 0.005],
        }
    }

    fn all_configs() -> Vec<TokenConfig> {
        let mut all = Vec::new();
        for kind in [TokenKind::Pos, TokenKind::PosD, TokenKind::Fill, TokenKind::Goal] {
            for granularity in [MaskGranularity::State, MaskGranularity::Joint] {
                for profile in [false, true] {
                    let ridge_friction = !profile;
                    all.push(TokenConfig {
                        kind,
                        granularity,
                        profile,
                        ridge_history: 2,
                        ridge_friction,
                        previous_action: false,
                    });
                }
            }
        }
        all
    }

    fn everything(t: &Tokeniser, q: &[f32], visible: &[bool]) -> Vec<u32> {
        let mut scratch = t.scratch();
        t.read(q, visible, &mut scratch);
        let mut bits = Vec::new();
        let (mut token, mut ridge) = (vec![0.0; t.inputs()], vec![0.0; t.ridge_inputs()]);
        for i in 0..WINDOW {
            t.token(&scratch, visible, i, &mut token);
            t.ridge_features(&scratch, i, &mut ridge);
            assert!(token.iter().chain(&ridge).all(|x| x.is_finite()));
            bits.extend(token.iter().chain(&ridge).map(|x| x.to_bits()));
            bits.push(u32::from(t.masked(&scratch, i)));
            bits.push(t.ridge_head(&scratch, i) as u32);
        }
        bits
    }

    #[test]
    fn hidden_states_never_leak() {
        for cfg in all_configs() {
            let t = Tokeniser::new(cfg.clone(), facts(), &norm()).unwrap();
            for index in 0..60 {
                let mut rng = Rng::new(2, Stream::Test, index);
                let mut q: Vec<f32> = (0..WINDOW * 4)
                    .map(|i| 0.3 * (i as f32 * 0.01).sin() + 0.05 * rng.normal() as f32)
                    .collect();
                let mut visible = vec![true; WINDOW * 4];
                let kind = if index % 2 == 0 { MaskKind::ClUniform } else { MaskKind::ClBlock };
                kind.draw(1.0, cfg.granularity, 4, &mut rng, &mut visible);
                if index % 3 == 0 {
                    visible[(WINDOW - 5) * 4..].fill(false);
                }
                let clean = everything(&t, &q, &visible);
                q.iter_mut().zip(&visible).filter(|(_, v)| !**v).for_each(|(q, _)| *q = 99.0);
                assert_eq!(clean, everything(&t, &q, &visible), "{cfg:?}");
                // The test can fail: a visible frame does change the features.
                q[(CURRENT - 1) * 4] += 0.01;
                assert_ne!(clean, everything(&t, &q, &visible));
            }
        }
    }

    #[test]
    fn token_lengths_are_the_formulas() {
        let with = |kind, profile| {
            let cfg = TokenConfig {
                kind,
                granularity: MaskGranularity::State,
                profile,
                ridge_history: 2,
                ridge_friction: true,
                previous_action: false,
            };
            Tokeniser::new(cfg, facts(), &norm()).unwrap().inputs()
        };
        assert_eq!(with(TokenKind::Pos, true), 4);
        assert_eq!(with(TokenKind::PosD, true), 16);
        assert_eq!(with(TokenKind::Fill, false), 16);
        assert_eq!(with(TokenKind::Goal, false), 6 * 4 + 3);
        // Two joints with stops, two hinges and one sum of them.
        assert_eq!(with(TokenKind::Goal, true), 6 * 4 + 3 + 8 * 2 + 2 * 3);
    }

    #[test]
    fn goal_velocity_points_at_the_next_visible_frame() {
        let cfg = TokenConfig { profile: false, ..all_configs().pop().unwrap() };
        let cfg = TokenConfig { granularity: MaskGranularity::State, ..cfg };
        let t = Tokeniser::new(cfg, facts(), &norm()).unwrap();
        let mut q = vec![0.0_f32; WINDOW * 4];
        let mut visible = vec![true; WINDOW * 4];
        q[40 * 4] = 0.5;
        q[44 * 4] = 0.7;
        visible[31 * 4..40 * 4].fill(false);
        visible[41 * 4..44 * 4].fill(false);
        let mut scratch = t.scratch();
        t.read(&q, &visible, &mut scratch);
        let mut token = vec![0.0; t.inputs()];
        t.token(&scratch, &visible, CURRENT, &mut token);
        assert!((token[3 * 4] - 0.05 / 0.02).abs() < 1e-4, "goal velocity {}", token[12]);
        assert!((token[5 * 4] - 0.05 / 0.02).abs() < 1e-4, "velocity after it {}", token[20]);
        assert!((token[24] - 0.1).abs() < 1e-6 && (token[25] - 1.0).abs() < 1e-6);
        t.token(&scratch, &visible, 35, &mut token);
        assert!((scratch.filled[35 * 4] - 0.25).abs() < 1e-6, "on the line");
        assert!((token[3 * 4] - 0.05 / 0.02).abs() < 1e-4);
        assert_eq!(token[26], 0.0, "flagged hidden");
        assert_eq!(t.ridge_head(&scratch, CURRENT), 10);
        assert_eq!(t.ridge_head(&scratch, 10), 1);
        assert_eq!(t.ridge_head(&scratch, 35), HEAD_HIDDEN);
        assert_eq!(t.ridge_head(&scratch, WINDOW - 1), 0);
    }

    #[test]
    fn normaliser_measures_motion() {
        let episode: Vec<f32> = (0..1000).map(|i| (i as f32 * 0.1).sin()).collect();
        let n = Normaliser::measure(1, std::iter::once(&episode[..]));
        assert!((n.std[0] - 0.5_f64.sqrt()).abs() < 0.01);
        assert!((n.std_d1[0] - 0.5_f64.sqrt() * 0.1).abs() < 0.001);
        assert!((n.std_d2[0] - 0.5_f64.sqrt() * 0.01).abs() < 0.0002);
    }
}
