//! `ridge`: masked action-inverse inference by ridge regression. There is one linear map for each
//! number of frames to the next visible frame.
//!
//! It is the baseline of every network and the first policy of a new robot. Inside a network it is
//! the linear prediction of the skip. It needs no plant model, gains or planner: each map gives the
//! mean action for "here now, there in k frames". Samples are drawn for each k directly, because
//! windows with random masks contain too few long gaps.

use std::sync::Mutex;

use super::Error;
use super::config::{CURRENT, MaskGranularity, WINDOW};
use super::mask::MaskKind;
use super::token::{RIDGE_HEADS, Scratch, Tokeniser};
use robert_base::progress::Cancel;
use robert_base::rng::{Rng, Stream};
use robert_linalg::{Init, Mat, MatMut, Packed, Real, gemm, gemm_packed, next_of, on_threads};

/// Recorded motion, as training reads it. Frames are 1/20 s apart.
pub trait Episodes: Sync {
    /// Number of episodes.
    fn count(&self) -> usize;
    /// Joint positions of one, (frames, S) row-major.
    fn states(&self, episode: usize) -> &[f32];
    /// Actions of one, (frames, A) row-major: action t takes state t to state t + 1.
    fn actions(&self, episode: usize) -> &[f32];
    /// Whether the robot touched itself at this frame. Torque there presses against a link instead
    /// of moving it, and cannot be inferred from positions.
    fn in_contact(&self, _episode: usize, _frame: usize) -> bool {
        false
    }
}

/// Settings of the fit.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RidgeConfig {
    /// Samples for each head.
    pub samples: usize,
    /// Ridge penalty.
    pub lambda: f64,
    /// Additional penalty for each sample, for robots with many features.
    pub lambda_per_sample: f64,
    /// Seed of the samples.
    pub seed: u64,
}

impl Default for RidgeConfig {
    fn default() -> Self {
        RidgeConfig { samples: 20_000, lambda: 0.05, lambda_per_sample: 0.0, seed: 0 }
    }
}

impl RidgeConfig {
    /// More samples and a stronger penalty where there are many features.
    pub fn for_tokens(tokens: &Tokeniser) -> Self {
        let many = tokens.ridge_inputs() > 150;
        RidgeConfig {
            samples: if many { 40_000 } else { 20_000 },
            lambda_per_sample: if many { 1e-4 } else { 0.0 },
            ..Self::default()
        }
    }
}

/// The fitted maps.
#[derive(Clone, Debug)]
pub struct Ridge {
    inputs: usize,
    actions: usize,
    /// (heads, inputs, A).
    weights: Vec<f32>,
    panels: Vec<Packed<f32>>,
}

impl Ridge {
    /// From weights (23, inputs, A), such as those of a checkpoint.
    ///
    /// # Errors
    /// [`Error::Shape`].
    pub fn new(inputs: usize, actions: usize, weights: Vec<f32>) -> Result<Self, Error> {
        let want = RIDGE_HEADS * inputs * actions;
        if weights.len() != want || want == 0 {
            return Err(Error::Shape { what: "ridge weights", want, got: weights.len() });
        }
        let panels = weights
            .chunks_exact(inputs * actions)
            .map(|w| Packed::new(Mat::new(w, inputs, actions)))
            .collect();
        Ok(Ridge { inputs, actions, weights, panels })
    }

    /// All maps, (23, inputs, A).
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Fits all heads.
    ///
    /// # Errors
    /// [`Error::Shape`] when no episode is long enough, [`Error::Singular`], [`Error::Stopped`].
    pub fn fit(
        tokens: &Tokeniser,
        episodes: &impl Episodes,
        cfg: &RidgeConfig,
        threads: usize,
        cancel: &Cancel,
    ) -> Result<Self, Error> {
        let penalties = [cfg.lambda_per_sample];
        let mut all = Self::fit_each(tokens, episodes, cfg, &penalties, threads, cancel)?;
        Ok(all.remove(0))
    }

    /// Fits all heads once for each penalty per sample, to the same samples.
    ///
    /// # Errors
    /// As [`Ridge::fit`].
    pub fn fit_each(
        tokens: &Tokeniser,
        episodes: &impl Episodes,
        cfg: &RidgeConfig,
        penalties: &[f64],
        threads: usize,
        cancel: &Cancel,
    ) -> Result<Vec<Self>, Error> {
        let starts = Starts::new(tokens.state(), episodes);
        if starts.total == 0 {
            return Err(Error::Shape {
                what: "frames of the longest episode",
                want: WINDOW,
                got: 0,
            });
        }
        let (inputs, actions) = (tokens.ridge_inputs(), tokens.facts().actions);
        // By head and penalty.
        let one = inputs * actions;
        let mut weights = vec![0.0_f32; RIDGE_HEADS * penalties.len() * one];
        let failed = Mutex::new(None);
        let queue = Mutex::new(weights.chunks_exact_mut(penalties.len() * one).enumerate());
        on_threads(threads.max(1), |_| {
            while let Some((head, to)) = next_of(&queue) {
                let fitted =
                    fit_head(head, tokens, episodes, &starts, cfg, (penalties, to), cancel);
                if let Err(e) = fitted {
                    failed
                        .lock()
                        .unwrap_or_else(std::sync::PoisonError::into_inner)
                        .get_or_insert(e);
                }
            }
        });
        match failed.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
            Some(e) => Err(e),
            None => (0..penalties.len())
                .map(|p| {
                    let heads = weights.chunks_exact(one).skip(p).step_by(penalties.len());
                    Self::new(inputs, actions, heads.flatten().copied().collect())
                })
                .collect(),
        }
    }

    /// Linear predictions of frames `range` of the window read, row-major (frames, A).
    pub fn answers(
        &self,
        tokens: &Tokeniser,
        scratch: &Scratch,
        range: std::ops::Range<usize>,
        features: &mut Vec<f32>,
        out: &mut [f32],
    ) {
        features.resize(WINDOW * self.inputs, 0.0);
        let mut frame = range.start;
        let a = self.actions;
        while frame < range.end {
            // Neighbours with the same head share a product; the history is one such run.
            let head = tokens.ridge_head(scratch, frame);
            let mut end = frame;
            while end < range.end && tokens.ridge_head(scratch, end) == head {
                let row = (end - frame) * self.inputs;
                tokens.ridge_features(scratch, end, &mut features[row..row + self.inputs]);
                end += 1;
            }
            let rows = end - frame;
            if let Some(panel) = self.panels.get(head) {
                gemm_packed(
                    MatMut::new(&mut out[(frame - range.start) * a..], rows, a),
                    Init::Zero,
                    Mat::new(features, rows, self.inputs),
                    panel,
                );
            }
            frame = end;
        }
    }
}

/// The places of all complete windows.
#[derive(Clone, Debug)]
pub struct Starts {
    /// Episodes with at least one window, and the number of windows in each.
    pub episodes: Vec<(usize, usize)>,
    /// Total number of windows.
    pub total: usize,
}

impl Starts {
    /// Counts the windows of all episodes.
    pub fn new(state: usize, episodes: &impl Episodes) -> Self {
        let counts = (0..episodes.count()).filter_map(|e| {
            let frames = episodes.states(e).len() / state.max(1);
            (frames >= WINDOW).then(|| (e, frames - WINDOW + 1))
        });
        let episodes: Vec<_> = counts.collect();
        Starts { total: episodes.iter().map(|(_, n)| n).sum(), episodes }
    }

    /// Uniform episode, then uniform start in it: the paper's sampling.
    pub fn draw(&self, rng: &mut Rng) -> (usize, usize) {
        let i = rng.below(self.episodes.len() as u64) as usize;
        let (episode, windows) = self.episodes[i];
        (episode, rng.below(windows as u64) as usize)
    }
}

/// Hides frames so that one of them belongs to `head`, and returns that frame. It is not before
/// frame `past`, because earlier frames have no complete history in the window: their missing
/// differences would look like rest, and the fit would give the history too little weight.
fn pose_window(
    head: usize,
    past: usize,
    state: usize,
    rng: &mut Rng,
    visible: &mut [bool],
) -> Option<usize> {
    visible.fill(true);
    let mut hide = |frames: std::ops::Range<usize>| {
        visible[frames.start.min(WINDOW) * state..frames.end.min(WINDOW) * state].fill(false);
    };
    match head {
        0 => {
            // The last visible frame: of the window, or before a hidden tail.
            let last = WINDOW - 1 - rng.below(20) as usize;
            hide(last + 1..WINDOW);
            Some(last)
        }
        1..=20 => {
            // Frame i sees its goal k frames ahead; mostly the frame after that is known
            // too, otherwise a second gap of any length that fits, or nothing at all.
            let last = WINDOW - 1 - head;
            let i = if head == 1 {
                let first = past.min(CURRENT);
                first + rng.below((last - first) as u64 + 1) as usize
            } else {
                CURRENT + rng.below((last - CURRENT) as u64 + 1) as usize
            };
            hide(i + 1..i + head);
            let room = WINDOW - 1 - (i + head);
            if i + head > CURRENT && room > 0 && rng.below(2) == 0 {
                let second = 1 + rng.below(room as u64 + 1) as usize;
                hide(i + head + 1..i + head + second);
            }
            Some(i)
        }
        _ => {
            MaskKind::ClUniform.draw(1.0, MaskGranularity::State, state, rng, visible);
            None
        }
    }
}

/// Draws per wanted sample after which frames in self-contact are accepted too.
const FREE_TRIES: u64 = 10;

fn fit_head(
    head: usize,
    tokens: &Tokeniser,
    episodes: &impl Episodes,
    starts: &Starts,
    cfg: &RidgeConfig,
    (penalties, to): (&[f64], &mut [f32]),
    cancel: &Cancel,
) -> Result<(), Error> {
    const CHUNK: usize = 1024;
    let history = tokens.config().ridge_history;
    let (s, f, a) = (tokens.state(), tokens.ridge_inputs(), tokens.facts().actions);
    let mut scratch = tokens.scratch();
    let mut visible = vec![true; WINDOW * s];
    let mut row = vec![0.0_f32; f];
    let (mut x, mut y) = (vec![0.0_f64; CHUNK * f], vec![0.0_f64; CHUNK * a]);
    let (mut xx, mut xy) = (vec![0.0_f64; f * f], vec![0.0_f64; f * a]);
    let (mut filled, mut drawn, mut index) = (0, 0, 0_u64);
    // Hidden frames have their own heads; a window may contain none of the wanted kind.
    while drawn < cfg.samples && index < 20 * cfg.samples as u64 {
        if cancel.is_cancelled() {
            return Err(Error::Stopped);
        }
        let mut rng = Rng::new(cfg.seed ^ ((head as u64) << 32), Stream::Fit, index);
        index += 1;
        let (episode, start) = starts.draw(&mut rng);
        // Frames in self-contact are left out while there are enough others.
        let picky = index < FREE_TRIES * cfg.samples as u64;
        if picky && (start..start + WINDOW).all(|f| episodes.in_contact(episode, f)) {
            continue;
        }
        let states = &episodes.states(episode)[start * s..(start + WINDOW) * s];
        let actions = &episodes.actions(episode)[start * a..];
        let posed = pose_window(head, history + 1, s, &mut rng, &mut visible);
        if picky && posed.is_some_and(|frame| episodes.in_contact(episode, start + frame)) {
            continue;
        }
        // The features of a frame depend on the differences before it.
        let begin = posed.map_or(0, |frame| frame.saturating_sub(history));
        tokens.read_from(begin, states, &visible, &mut scratch);
        let first = rng.below(WINDOW as u64) as usize;
        let frame = posed.or_else(|| {
            (0..WINDOW)
                .map(|i| (first + i) % WINDOW)
                .find(|&i| tokens.ridge_head(&scratch, i) == head)
        });
        let Some(frame) = frame.filter(|&i| tokens.ridge_head(&scratch, i) == head) else {
            continue;
        };
        let Some(action) = actions.get(frame * a..(frame + 1) * a) else { continue };
        if picky && episodes.in_contact(episode, start + frame) {
            continue;
        }
        tokens.ridge_features(&scratch, frame, &mut row);
        x[filled * f..(filled + 1) * f].iter_mut().zip(&row).for_each(|(x, &r)| *x = f64::from(r));
        y[filled * a..(filled + 1) * a]
            .iter_mut()
            .zip(action)
            .for_each(|(y, &r)| *y = f64::from(r));
        filled += 1;
        drawn += 1;
        if filled == CHUNK {
            accumulate(&mut xx, &mut xy, &x, &y, filled, f, a);
            filled = 0;
        }
    }
    accumulate(&mut xx, &mut xy, &x, &y, filled, f, a);
    for (per_sample, to) in penalties.iter().zip(to.chunks_exact_mut(f * a)) {
        if cancel.is_cancelled() {
            return Err(Error::Stopped);
        }
        let (mut factor, mut weights) = (xx.clone(), xy.clone());
        let penalty = cfg.lambda + per_sample * drawn as f64;
        factor.iter_mut().step_by(f + 1).for_each(|d| *d += penalty);
        cholesky(&mut factor, f)
            .map_err(|row| Error::Singular { what: format!("ridge head {head}"), row })?;
        solve(&factor, f, &mut weights, a);
        to.iter_mut().zip(&weights).for_each(|(to, &w)| *to = w as f32);
    }
    Ok(())
}

/// Rows of the normal equations that are computed at once.
const TRIANGLE_ROWS: usize = 128;

/// Adds the products of `rows` samples: the lower triangle of xᵀx, and xᵀy.
fn accumulate(
    xx: &mut [f64],
    xy: &mut [f64],
    x: &[f64],
    y: &[f64],
    rows: usize,
    f: usize,
    a: usize,
) {
    // The factorisation reads only the triangle below the diagonal: a block of rows ends there.
    for first in (0..f).step_by(TRIANGLE_ROWS) {
        let end = (first + TRIANGLE_ROWS).min(f);
        let out = MatMut::strided(&mut xx[first * f..], end - first, end, f);
        let left = Mat::strided(&x[first..], rows, end - first, f);
        gemm(out, Init::Add, left.t(), Mat::strided(x, rows, end, f));
    }
    let m = Mat::new(x, rows, f);
    gemm(MatMut::new(xy, f, a), Init::Add, m.t(), Mat::new(y, rows, a));
}

/// Computes the lower Cholesky factor of `m`, (n, n) row-major, in place; the upper part is
/// unchanged.
///
/// # Errors
/// The row whose pivot is not positive; `m` is then not positive definite.
pub fn cholesky<T: Real>(m: &mut [T], n: usize) -> Result<(), usize> {
    for i in 0..n {
        let (above, row) = m.split_at_mut(i * n);
        for j in 0..i {
            let other = &above[j * n..=j * n + j];
            let dot: T = row[..j].iter().zip(other).map(|(&a, &b)| a * b).sum();
            row[j] = (row[j] - dot) / other[j];
        }
        let square: T = row[..i].iter().map(|&a| a * a).sum();
        let pivot = (row[i] - square).f64();
        if !(pivot.is_finite() && pivot > 0.0) {
            return Err(i);
        }
        row[i] = T::of(pivot.sqrt());
    }
    Ok(())
}

/// Solves L Lᵀ x = b for `columns` right sides, in place.
pub fn solve<T: Real>(l: &[T], n: usize, b: &mut [T], columns: usize) {
    for i in 0..n {
        for j in 0..i {
            let factor = l[i * n + j];
            let (above, here) = b.split_at_mut(i * columns);
            for (x, &y) in here.iter_mut().zip(&above[j * columns..(j + 1) * columns]) {
                *x -= factor * y;
            }
        }
        b[i * columns..(i + 1) * columns].iter_mut().for_each(|x| *x = *x / l[i * n + i]);
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            let factor = l[j * n + i];
            let (here, below) = b.split_at_mut(j * columns);
            for (x, &y) in here[i * columns..(i + 1) * columns].iter_mut().zip(&*below) {
                *x -= factor * y;
            }
        }
        b[i * columns..(i + 1) * columns].iter_mut().for_each(|x| *x = *x / l[i * n + i]);
    }
}

/// A plant for tests: damped unit masses pushed by smooth random forces, ten steps of 5 ms per
/// frame, joint 0 with gravity like a pendulum.
#[cfg(test)]
pub(crate) mod toy {
    use super::{Episodes, Rng, Stream};

    #[derive(Debug)]
    pub(crate) struct Toy {
        pub(crate) episodes: Vec<(Vec<f32>, Vec<f32>)>,
    }

    impl Toy {
        pub(crate) fn new(state: usize, count: usize, frames: usize, seed: u64) -> Self {
            let run = |e: usize| {
                let mut rng = Rng::new(seed, Stream::Test, e as u64);
                let (mut q, mut v) = (vec![0.0_f64; state], vec![0.0_f64; state]);
                let mut a = vec![0.0_f64; state];
                let (mut states, mut actions) = (Vec::new(), Vec::new());
                for _ in 0..frames {
                    for a in &mut a {
                        *a = (0.85 * *a + 0.3 * rng.normal()).clamp(-1.0, 1.0);
                    }
                    states.extend(q.iter().map(|&x| x as f32));
                    actions.extend(a.iter().map(|&x| x as f32));
                    for _ in 0..10 {
                        for j in 0..state {
                            let gravity = if j == 0 { 3.0 * q[0].sin() } else { 2.0 * q[j] };
                            v[j] += 0.005 * (8.0 * a[j] - 10.0 * v[j] - gravity);
                            q[j] += 0.005 * v[j];
                        }
                    }
                }
                (states, actions)
            };
            Toy { episodes: (0..count).map(run).collect() }
        }
    }

    impl Episodes for Toy {
        fn count(&self) -> usize {
            self.episodes.len()
        }
        fn states(&self, e: usize) -> &[f32] {
            &self.episodes[e].0
        }
        fn actions(&self, e: usize) -> &[f32] {
            &self.episodes[e].1
        }
    }
}

#[cfg(test)]
mod tests {
    use super::toy::Toy;
    use super::*;
    use crate::token::{Facts, JointFacts, Normaliser, TokenConfig};

    #[test]
    fn cholesky_solves() {
        let n = 7;
        let mut rng = Rng::new(1, Stream::Test, 0);
        let b: Vec<f64> = (0..n * n).map(|_| rng.normal()).collect();
        let mut m = vec![0.0; n * n];
        let mb = Mat::new(&b, n, n);
        gemm(MatMut::new(&mut m, n, n), Init::Zero, mb.t(), mb);
        let x: Vec<f64> = (0..n * 2).map(|_| rng.normal()).collect();
        let mut y = vec![0.0; n * 2];
        gemm(MatMut::new(&mut y, n, 2), Init::Zero, Mat::new(&m, n, n), Mat::new(&x, n, 2));
        cholesky(&mut m, n).unwrap();
        solve(&m, n, &mut y, 2);
        assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() < 1e-8));
        assert_eq!(cholesky(&mut [1.0, 2.0, 2.0, 1.0], 2), Err(1));
    }

    #[test]
    fn infers_the_action_of_a_damped_plant() {
        let data = Toy::new(2, 40, 300, 1);
        let joints = vec![JointFacts { hinge: true, range: None }; 2];
        let facts = Facts { joints, actions: 2 };
        let norm = Normaliser::measure(2, (0..40).map(|e| data.states(e)));
        let cfg = TokenConfig { ridge_history: 8, ..TokenConfig::for_robot(&facts) };
        let tokens = Tokeniser::new(cfg, facts, &norm).unwrap();
        let fit = RidgeConfig { samples: 3000, ..RidgeConfig::default() };
        let ridge = Ridge::fit(&tokens, &data, &fit, 2, &Cancel::default()).unwrap();
        let again = Ridge::fit(&tokens, &data, &fit, 1, &Cancel::default()).unwrap();
        assert_eq!(ridge.weights(), again.weights());
        let stop = Cancel::default();
        stop.cancel();
        assert!(matches!(Ridge::fit(&tokens, &data, &fit, 2, &stop), Err(Error::Stopped)));

        let test = Toy::new(2, 5, 300, 2);
        let mut scratch = tokens.scratch();
        let (mut square, mut power) = ([0.0_f64; 3], 0.0);
        for e in 0..5 {
            for start in (0..240).step_by(7) {
                let states = &test.states(e)[start * 2..(start + WINDOW) * 2];
                let want = &test.actions(e)[(start + CURRENT) * 2..][..2];
                for (case, hidden) in [0, 3, 10].into_iter().enumerate() {
                    let mut visible = vec![true; WINDOW * 2];
                    visible[(CURRENT + 1) * 2..(CURRENT + 1 + hidden) * 2].fill(false);
                    tokens.read(states, &visible, &mut scratch);
                    let mut got = [0.0; 2];
                    ridge.answers(
                        &tokens,
                        &scratch,
                        CURRENT..CURRENT + 1,
                        &mut Vec::new(),
                        &mut got,
                    );
                    for j in 0..2 {
                        square[case] += f64::from(got[j] - want[j]).powi(2);
                    }
                }
                power += want.iter().map(|&a| f64::from(a).powi(2)).sum::<f64>();
            }
        }
        let nmse = square.map(|s| s / power);
        assert!(nmse[0] < 0.02, "next frame known: {nmse:?}");
        assert!(nmse[1] < 0.7 && nmse[1] > nmse[0], "three hidden: {nmse:?}");
        assert!(nmse[2] < 1.05, "ten hidden: {nmse:?}");
    }

    /// Sliders with dry friction and hardly any damping, which need a complete history and the sign
    /// of the goal velocity.
    #[derive(Debug)]
    struct Dry(Vec<(Vec<f32>, Vec<f32>)>);

    impl Dry {
        fn new(friction: f64, damping: f64) -> Self {
            let run = |e: u64| {
                let mut rng = Rng::new(4, Stream::Test, e);
                let (mut q, mut v, mut a) = (0.0_f64, 0.0_f64, 0.0_f64);
                let (mut states, mut actions) = (Vec::new(), Vec::new());
                for _ in 0..250 {
                    a = (0.9 * a + 0.25 * rng.normal()).clamp(-1.0, 1.0);
                    states.push(q as f32);
                    actions.push(a as f32);
                    for _ in 0..10 {
                        // Friction reduces speed, at most to zero.
                        let free = v + 0.005 * (5.0 * a - damping * v);
                        v = free - free.clamp(-0.005 * friction, 0.005 * friction);
                        q += 0.005 * v;
                    }
                }
                (states, actions)
            };
            Dry((0..40).map(run).collect())
        }

        /// The share of the actions' variance that these features leave unexplained if the next
        /// frame is known, over frames slower than `slow` per frame.
        fn left_open(&self, cfg: &TokenConfig, slow: f32) -> f64 {
            self.left_open_by(cfg, slow, RidgeConfig::default().lambda)
        }

        /// As `left_open`, with this penalty.
        fn left_open_by(&self, cfg: &TokenConfig, slow: f32, lambda: f64) -> f64 {
            let facts =
                Facts { joints: vec![JointFacts { hinge: false, range: None }], actions: 1 };
            let norm = Normaliser::measure(1, self.0[..30].iter().map(|e| &e.0[..]));
            let tokens = Tokeniser::new(cfg.clone(), facts, &norm).unwrap();
            let fit = RidgeConfig { samples: 3000, lambda, ..RidgeConfig::default() };
            let ridge =
                Ridge::fit(&tokens, &Dry(self.0[..30].to_vec()), &fit, 2, &Cancel::default())
                    .unwrap();
            let (mut scratch, mut got) = (tokens.scratch(), [0.0]);
            let (mut square, mut power) = (0.0, 0.0);
            for (states, actions) in &self.0[30..] {
                for start in 0..states.len() - WINDOW {
                    let now = start + CURRENT;
                    if (states[now + 1] - states[now]).abs() > slow {
                        continue;
                    }
                    tokens.read(&states[start..start + WINDOW], &[true; WINDOW], &mut scratch);
                    let range = CURRENT..CURRENT + 1;
                    ridge.answers(&tokens, &scratch, range, &mut Vec::new(), &mut got);
                    square += f64::from(got[0] - actions[now]).powi(2);
                    power += f64::from(actions[now]).powi(2);
                }
            }
            square / power
        }
    }

    impl Episodes for Dry {
        fn count(&self) -> usize {
            self.0.len()
        }
        fn states(&self, e: usize) -> &[f32] {
            &self.0[e].0
        }
        fn actions(&self, e: usize) -> &[f32] {
            &self.0[e].1
        }
    }

    fn history(ridge_history: usize, ridge_friction: bool) -> TokenConfig {
        let facts = Facts { joints: vec![JointFacts { hinge: false, range: None }], actions: 1 };
        TokenConfig { ridge_history, ridge_friction, ..TokenConfig::for_robot(&facts) }
    }

    #[test]
    fn a_long_history_tells_the_action_of_a_sliding_puck() {
        // With hardly any damping speeds grow, and second differences, which reveal the force, are
        // small beside them. The usual penalty would suppress them (.05 unexplained at any length).
        let free = Dry::new(0.0, 0.1);
        let open = [2, 8, 20].map(|n| free.left_open_by(&history(n, false), f32::INFINITY, 1e-5));
        // Frames at the window's beginning have no complete history; a fit to them failed.
        assert!(open[2] < 1e-4, "{open:?}");
        assert!(open[0] > 10.0 * open[1] && open[1] > 3.0 * open[2], "{open:?}");
        // The point mass: a time constant of a tenth of a second, the usual penalty.
        let damped = Dry::new(0.0, 10.0).left_open(&history(20, false), f32::INFINITY);
        assert!(damped < 1e-4, "{damped}");
    }

    #[test]
    fn the_sign_of_the_goal_velocity_tells_dry_friction() {
        let data = Dry::new(1.5, 8.0);
        let open = [false, true].map(|friction| data.left_open(&history(8, friction), 0.004));
        assert!(open[1] < 0.7 * open[0], "{open:?}");
    }

    /// A plant whose recordings are useless wherever it touches itself.
    #[derive(Debug)]
    struct Touching(Toy, fn(usize) -> bool);

    impl Episodes for Touching {
        fn count(&self) -> usize {
            self.0.count()
        }
        fn states(&self, e: usize) -> &[f32] {
            self.0.states(e)
        }
        fn actions(&self, e: usize) -> &[f32] {
            self.0.actions(e)
        }
        fn in_contact(&self, _e: usize, frame: usize) -> bool {
            self.1(frame)
        }
    }

    #[test]
    fn frames_in_contact_are_left_out_while_there_are_others() {
        let facts = Facts { joints: vec![JointFacts { hinge: true, range: None }; 2], actions: 2 };
        let clean = Toy::new(2, 20, 200, 1);
        let norm = Normaliser::measure(2, (0..20).map(|e| clean.states(e)));
        let tokens = Tokeniser::new(TokenConfig::for_robot(&facts), facts, &norm).unwrap();
        let cfg = RidgeConfig { samples: 400, ..RidgeConfig::default() };
        let fit = |data: &Touching| {
            Ridge::fit(&tokens, data, &cfg, 1, &Cancel::default()).unwrap().weights().to_vec()
        };
        let spoil = |touches: fn(usize) -> bool| {
            let mut toy = Toy::new(2, 20, 200, 1);
            for (_, actions) in &mut toy.episodes {
                let frames = actions.chunks_exact_mut(2).enumerate();
                frames.filter(|(t, _)| touches(*t)).for_each(|(_, a)| a.fill(0.9));
            }
            Touching(toy, touches)
        };
        let third: fn(usize) -> bool = |t| t % 3 == 0;
        let want = fit(&Touching(clean, third));
        assert_eq!(fit(&spoil(third)), want, "what is left out cannot matter");
        let blind = Touching(spoil(third).0, |_| false);
        assert_ne!(fit(&blind), want);
        // A robot that always touches itself is fitted nevertheless.
        assert!(fit(&Touching(Toy::new(2, 20, 200, 1), |_| true)).iter().any(|w| *w != 0.0));
    }

    #[test]
    fn every_head_has_samples() {
        let data = Toy::new(1, 3, 200, 5);
        let facts = Facts {
            joints: vec![JointFacts { hinge: true, range: Some([-1.0, 1.0]) }],
            actions: 1,
        };
        let norm = Normaliser::measure(1, (0..3).map(|e| data.states(e)));
        let tokens = Tokeniser::new(TokenConfig::for_robot(&facts), facts, &norm).unwrap();
        let fit = RidgeConfig { samples: 400, ..RidgeConfig::default() };
        let ridge = Ridge::fit(&tokens, &data, &fit, 1, &Cancel::default()).unwrap();
        for head in ridge.weights().chunks(tokens.ridge_inputs()) {
            assert!(head.iter().any(|w| w.abs() > 1e-4));
        }
    }
}
