//! Policies that are fitted in seconds to a minute: `ridge`, `nearest`, `mlp-inverse`.
//!
//! They are baselines for a trained network with the same data, and the first policies of a new
//! robot.

use std::path::Path;

use super::prepare::{Side, normaliser, prepare, robot_card};
use super::{Error, TrainConfig};
use robert_base::progress::{Cancel, Progress};
use robert_base::rng::{Rng, Stream};
use robert_dataset::{Dataset, Part, Windows};
use robert_explore::{Adam, Tape};
use robert_net::reach::Reach;
use robert_net::{COMMAND, CURRENT, Card, Episodes as _, WINDOW, checkpoint};
use robert_rollout::{FitCard, FitKind, Inverse, InverseSettings, Linear, Nearest, Window};

/// Windows for the held-out error, for each number of hidden frames.
const MEASURED: u64 = 256;
/// Numbers of hidden frames before the next visible one for which it is measured.
pub const HIDDEN: [usize; 3] = [0, 4, 16];
/// Draws of a frame without self-contact before one with contact is taken.
const DRAWS: usize = 16;
/// Steps between checks of the time and of the stop request.
const REPORT_EVERY: u64 = 100;

/// A fitted policy.
#[derive(Debug)]
pub enum Fitted {
    /// The linear prediction.
    Ridge(Box<Linear>),
    /// Retrieval.
    Nearest(Box<Nearest>),
    /// The three-frame network.
    MlpInverse(Box<Inverse>),
}

impl Fitted {
    /// The action for a window, (A).
    fn answer(&mut self, window: &Window, action: &mut [f64]) {
        match self {
            Fitted::Ridge(p) => p.answer(window, action),
            Fitted::Nearest(p) => p.answer(window, action),
            Fitted::MlpInverse(p) => p.answer(window, action),
        }
    }
}

/// Fits one head for every gap length and writes it as a model without a trained network.
///
/// # Errors
/// [`Error::Net`].
pub fn ridge(
    data: &Dataset,
    seed: u64,
    threads: usize,
    out: &Path,
    cancel: &Cancel,
) -> Result<Fitted, Error> {
    let cfg = TrainConfig { seed, ..TrainConfig::preset("instant")? };
    let (card, net, encoder) = prepare(data, &cfg, None, threads, cancel)?;
    checkpoint::save(out, &card, &net, encoder.ridge.as_ref(), None)?;
    let linear = Linear::new(encoder)
        .map_err(|e| Error::Setting { setting: "skip".to_owned(), why: e.to_string() })?;
    Ok(Fitted::Ridge(Box::new(linear)))
}

/// Learns what actions move from the training split of a dataset, for a model of the same robot.
///
/// # Errors
/// [`Error::Net`] when the dataset is from another robot or too short.
pub fn reach(data: &Dataset, card: &Card) -> Result<Reach, Error> {
    checkpoint::same_robot(&robot_card(&data.manifest().robot), &card.robot, data.path())?;
    let seed = card.training.seed;
    Ok(Reach::fit(&card.facts, &Side::new(data, Part::Train, seed), seed)?)
}

/// Copies recorded frames, at most `frames` of them: whole trajectories, evenly spread.
///
/// # Errors
/// [`Error::Net`].
pub fn nearest(data: &Dataset, seed: u64, frames: usize, out: &Path) -> Result<Fitted, Error> {
    let found = Nearest::of(data, seed, frames)?;
    found.save(out)?;
    Ok(Fitted::Nearest(Box::new(found)))
}

/// Trains the three-frame network. Draw i of step t is a function of the seed and t alone.
///
/// # Errors
/// [`Error::Run`] when stopped, [`Error::Net`], [`Error::Data`].
pub fn mlp_inverse(
    data: &Dataset,
    seed: u64,
    settings: &InverseSettings,
    out: &Path,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Fitted, Error> {
    let card = FitCard::of(FitKind::MlpInverse, data, seed, settings.clone());
    let (s, a) = (card.state(), card.actions());
    let mut policy = Inverse::new(card)?;
    let side = Side::new(data, Part::Train, seed);
    // A frame needs one before it and one after it.
    let episodes: Vec<(usize, u64)> = (0..side.count())
        .map(|e| (e, (side.states(e).len() / s) as u64))
        .filter(|(_, n)| *n >= 3)
        .collect();
    let total: u64 = episodes.iter().map(|(_, n)| n - 2).sum();
    if total == 0 {
        return Err(Error::Data(robert_dataset::Error::Empty {
            frames: 3,
            part: "train",
            path: data.path().to_owned(),
        }));
    }
    let mut adam = Adam::new(policy.net.params.len());
    let mut tape = Tape::default();
    let b = settings.batch;
    let (mut x, mut y) = (vec![0.0_f32; b * 3 * s], vec![0.0_f32; b * a]);
    let (mut sum, mut count) = (0.0, 0_u64);
    for step in 0..settings.steps {
        for i in 0..b {
            let mut rng = Rng::new(seed, Stream::Fit, step * b as u64 + i as u64);
            let &(e, n) = &episodes[rng.below(episodes.len() as u64) as usize];
            // In self-contact the torque presses one link against another instead of moving it.
            let mut draws = (0..DRAWS).map(|_| 1 + rng.below(n - 2) as usize);
            let free = draws.find(|&t| !side.in_contact(e, t));
            let t = free.unwrap_or_else(|| 1 + rng.below(n - 2) as usize);
            let q = |t: usize| &side.states(e)[t * s..(t + 1) * s];
            policy.encode(q(t - 1), q(t), q(t + 1), &mut x[i * 3 * s..(i + 1) * 3 * s]);
            y[i * a..(i + 1) * a].copy_from_slice(&side.actions(e)[t * a..(t + 1) * a]);
        }
        let found = policy.net.forward(&x, b, &mut tape);
        let scale = 2.0 / (b * a) as f32;
        let mut d: Vec<f32> = found.iter().zip(&y).map(|(f, y)| f - y).collect();
        sum += d.iter().map(|e| f64::from(e * e)).sum::<f64>() / (b * a) as f64;
        count += 1;
        d.iter_mut().for_each(|e| *e *= scale);
        policy.net.backward(&mut tape, &mut d, Some(&mut adam.grads), false);
        let f = step as f64 / settings.steps as f64;
        let lr = settings.lr * 0.5 * (1.0 + (std::f64::consts::PI * f).cos());
        adam.step(&mut policy.net.params, lr);
        if (step + 1) % REPORT_EVERY == 0 || step + 1 == settings.steps {
            if cancel.is_cancelled() {
                return Err(Error::Stopped { step: step + 1, steps: settings.steps });
            }
            let note = format!("action error {:.4}", (sum / count as f64).sqrt());
            progress.tick(step + 1, settings.steps, &note);
            (sum, count) = (0.0, 0);
        }
    }
    policy.save(out)?;
    Ok(Fitted::MlpInverse(Box::new(policy)))
}

/// Error of inferred actions on held-out trajectories as a share of their variance, for
/// each number of hidden frames in [`HIDDEN`].
///
/// # Errors
/// [`Error::Data`] when no held-out trajectory is long enough.
pub fn held_out(data: &Dataset, seed: u64, fitted: &mut Fitted) -> Result<[f64; 3], Error> {
    let windows = Windows::new(data, WINDOW, Part::Test, seed)?;
    let robot = &data.manifest().robot;
    let (s, a) = (robot.joints.len(), robot.actuators.len());
    let power = normaliser(data, seed).1 * (MEASURED * a as u64) as f64;
    let (mut q, mut u) = (vec![0.0_f32; WINDOW * s], vec![0.0_f32; WINDOW * a]);
    let mut window = Window::new(s);
    let mut action = vec![0.0; a];
    let mut errors = [0.0; 3];
    for (error, hidden) in errors.iter_mut().zip(HIDDEN) {
        let mut sum = 0.0;
        for i in 0..MEASURED {
            windows.fill(seed, i, &mut q, &mut u);
            let wide = |range: std::ops::Range<usize>| {
                q[range.start * s..range.end * s].iter().map(|&x| f64::from(x))
            };
            window.history.clear();
            window.history.extend(wide(0..CURRENT));
            window.current.clear();
            window.current.extend(wide(CURRENT..CURRENT + 1));
            window.command.clear();
            window.command.extend(wide(CURRENT + 1..WINDOW));
            for frame in 0..COMMAND {
                window.visible[frame * s..(frame + 1) * s].fill(frame >= hidden);
            }
            fitted.answer(&window, &mut action);
            let want = &u[CURRENT * a..(CURRENT + 1) * a];
            sum += action.iter().zip(want).map(|(x, &y)| (x - f64::from(y)).powi(2)).sum::<f64>();
        }
        *error = sum / power.max(1e-12);
    }
    Ok(errors)
}
