//! The training loop: steps, metrics, checkpoints, evaluation, resuming.
//!
//! Nothing random is remembered: batch, masks and schedule are functions of seed and step,
//! so weights, moments and the step number are the whole state and a run killed anywhere
//! ends with the bits of one that was not (the two costly bug families of other trainers,
//! data order and generator state, cannot occur).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::hindsight::{self, Perform, Round};
use super::prepare::{normaliser, prepare};
use super::record::{Line, Record, began_with_tiles, read_metrics};
use super::source::{BatchSampler, Source};
use super::{Error, TrainConfig, curves};
use crate::dataset::{Dataset, Part, Windows};
use crate::fsio;
use crate::linalg::tiled;
use crate::net::checkpoint::{self, OptimiserState};
use crate::net::head::{GAPS, Sums};
use crate::net::step::GradientView;
use crate::net::{Batch, Card, Encoder, Learner, Model, Net, SkipKind, WINDOW};
use crate::progress::{Cancel, Progress};

/// Steps with a loss or gradient that is not finite before a run gives up.
const MOST_SKIPPED: u64 = 10;
/// Windows that held-out error is measured on during a run; a twentieth for each number of
/// hidden frames.
const MEASURED: usize = 1_280;
/// Windows that it is measured on at the end: actions at stops are heavy-tailed.
const MEASURED_AT_END: usize = 5_120;
/// Lines of training metrics in a run.
const LINES: u64 = 400;
/// Keys of metrics that hold an [`Evaluation`]: of the network, of the linear prediction that it
/// starts from.
const EVALUATED: [&str; 2] = ["evaluation", "linear"];

/// What a closed-loop evaluation found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Mean Precision over the suites: lower is better; selects the best checkpoint.
    pub precision: f64,
    /// Precision by suite.
    pub suites: BTreeMap<String, f64>,
}

/// Evaluates a network by what it does, not by its loss.
pub trait Evaluate {
    /// Rolls the network out; `None` when a stop was asked for meanwhile.
    ///
    /// # Errors
    /// A message; the run stops with it.
    fn evaluate(&mut self, model: &Model, cancel: &Cancel) -> Result<Option<Evaluation>, String>;

    /// The same for the linear prediction alone, which is what an untrained network with a skip
    /// gives: an evaluator may leave the network out.
    ///
    /// # Errors
    /// As [`Evaluate::evaluate`].
    fn evaluate_linear(
        &mut self,
        model: &Model,
        cancel: &Cancel,
    ) -> Result<Option<Evaluation>, String> {
        self.evaluate(model, cancel)
    }
}

/// How a run is carried out; nothing here changes its bits.
pub struct Options<'a> {
    /// Run directory.
    pub dir: PathBuf,
    /// Threads.
    pub threads: usize,
    /// Seconds between checkpoints.
    pub checkpoint_secs: f64,
    /// Evaluations in a run, spread evenly; the last is at the end.
    pub evaluations: u64,
    /// Who hears of it.
    pub progress: &'a dyn Progress,
    /// Asks for a stop.
    pub cancel: &'a Cancel,
    /// Closed-loop evaluator; without one only the last model is kept.
    pub evaluator: Option<&'a mut dyn Evaluate>,
    /// Performs tasks for self-correction; needed when the settings ask for it.
    pub perform: Option<&'a mut dyn Perform>,
    /// What else to put into meta.json (version, host, command line).
    pub meta: serde_json::Value,
}

impl std::fmt::Debug for Options<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Options").field("dir", &self.dir).finish_non_exhaustive()
    }
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finished {
    /// Steps done, of all.
    pub step: u64,
    /// Steps in all.
    pub steps: u64,
    /// Whether a stop was asked for before the end.
    pub interrupted: bool,
    /// Steps skipped because something was not finite, all sessions.
    pub skipped: u64,
    /// Best step and its Precision; step 0 is the linear prediction that a skip starts from.
    pub best: Option<(u64, f64)>,
    /// Precision of that linear prediction.
    pub linear: Option<f64>,
    /// Held-out error, last measured.
    pub held_out: Option<HeldOut>,
    /// Seconds of this session.
    pub secs: f64,
    /// Training windows a second of this session.
    pub windows_per_sec: f64,
    /// The model to use.
    pub model: PathBuf,
}

/// Error of inferred actions on held-out trajectories, as a share of the actions' variance;
/// `None` where no frame was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Of the current frame, by number of hidden frames before the next visible one, 0 to 19.
    pub nmse_by_hidden: Vec<Option<f64>>,
    /// Next frame visible, away from stops and contact.
    pub nmse_clear: Option<f64>,
    /// Next frame visible, a joint near a stop: torque that presses against a stop leaves no
    /// trace in positions.
    pub nmse_stop: Option<f64>,
    /// Next frame visible, in self-contact.
    pub nmse_contact: Option<f64>,
    /// Share of frames by place: clear, at a stop, in contact.
    pub shares: [f64; 3],
}

/// Paths inside a run directory.
pub mod paths {
    use std::path::{Path, PathBuf};

    /// Settings.
    pub fn config(dir: &Path) -> PathBuf {
        dir.join("config.toml")
    }
    /// Latest state, to resume from.
    pub fn last(dir: &Path) -> PathBuf {
        dir.join("ckpt/last.safetensors")
    }
    /// Best model by Precision.
    pub fn best(dir: &Path) -> PathBuf {
        dir.join("ckpt/best.safetensors")
    }
    /// Latest model, without optimiser state.
    pub fn model(dir: &Path) -> PathBuf {
        dir.join("model.safetensors")
    }
    /// Training curves.
    pub fn curves(dir: &Path) -> PathBuf {
        dir.join("curves.png")
    }
    /// One JSON object a line.
    pub fn metrics(dir: &Path) -> PathBuf {
        dir.join("metrics.jsonl")
    }
}

/// Reads the settings of a run directory.
///
/// # Errors
/// [`Error::Files`], [`Error::Run`].
pub fn read_config(dir: &Path) -> Result<TrainConfig, Error> {
    let path = paths::config(dir);
    let bytes = fsio::read_capped(&path, 1 << 20)?;
    let text = String::from_utf8_lossy(&bytes);
    let cfg: TrainConfig = toml::from_str(&text)
        .map_err(|e| Error::Run { why: e.message().replace('\n', " "), path: path.clone() })?;
    cfg.check()?;
    Ok(cfg)
}

/// Trains in `opts.dir`: begins there, or goes on from its last checkpoint.
///
/// # Errors
/// Those of [`Error`]; whatever happens, the last checkpoint stays whole.
pub fn train(data: &Dataset, cfg: &TrainConfig, mut opts: Options<'_>) -> Result<Finished, Error> {
    cfg.check()?;
    cfg.check_network()?;
    if cfg.self_correct > 0 {
        if opts.perform.is_none() {
            return Err(Error::Setting {
                setting: "self_correct".into(),
                why: "nobody here performs the tasks".into(),
            });
        }
        // The first round comes late: say now when no trajectory is long enough for a task.
        Windows::new(data, hindsight::STATES, Part::Train, cfg.seed)?;
    }
    let mut run = Run::open(data, cfg, &opts)?;
    let mut stopped = false;
    if run.step == 0 {
        stopped = !run.evaluate_linear(&mut opts)?;
        // From the first step on there is something good to fall back on.
        run.save(&opts.dir)?;
    }
    let encoder = run.encoder.clone();
    let source = Source::new(data, &encoder, cfg);
    let windows = Windows::new(data, WINDOW, Part::Train, cfg.seed)?;
    let held_out = Windows::new(data, WINDOW, Part::Test, cfg.seed).ok();
    let mut session = Session::new(&run, held_out.as_ref(), &opts.dir);
    session.finished.interrupted = stopped;
    // An evaluation that a stop cut short is made up for.
    session.evaluate(&mut run, &source, &mut opts)?;
    // A stretch of steps learns from the data and from what earlier rounds reached.
    for round in 0..=cfg.self_correct {
        let end = cfg.steps * (round + 1) / (cfg.self_correct + 1);
        if session.finished.interrupted {
            break;
        }
        if run.step >= end && round < cfg.self_correct {
            continue;
        }
        if round > 0 && !run.perform(data, round, &mut opts)? {
            session.finished.interrupted = true;
            break;
        }
        let reached = hindsight::open(&opts.dir, round)?;
        let sampler = BatchSampler::new(&source, &windows, &reached);
        session.stretch(&mut run, &sampler, end, &mut opts)?;
    }
    let Session { begin, first, mut finished, .. } = session;
    finished.step = run.step;
    finished.best = run.best;
    finished.secs = begin.elapsed().as_secs_f64();
    finished.windows_per_sec =
        (run.step - first) as f64 * cfg.batch as f64 / finished.secs.max(1e-9);
    Ok(finished)
}

/// What one call of [`train`] counts.
struct Session<'a> {
    held_out: Option<&'a Windows<'a>>,
    begin: Instant,
    /// Step that it began at.
    first: u64,
    /// Time and step of the last checkpoint.
    saved: (Instant, u64),
    recent: Sums,
    recent_steps: u32,
    /// Norm of the last gradient that was applied.
    grad_norm: f64,
    finished: Finished,
}

impl<'a> Session<'a> {
    fn new(run: &Run<'_>, held_out: Option<&'a Windows<'a>>, dir: &Path) -> Self {
        let begin = Instant::now();
        let last = |key: &str| run.metrics.iter().rev().find_map(|l| l.get(key));
        Session {
            held_out,
            begin,
            first: run.step,
            saved: (begin, run.step),
            recent: Sums::default(),
            recent_steps: 0,
            grad_norm: 0.0,
            finished: Finished {
                step: run.step,
                steps: run.cfg.steps,
                interrupted: false,
                skipped: last("skipped").and_then(serde_json::Value::as_u64).unwrap_or(0),
                best: run.best,
                linear: last("linear").and_then(|l| l.get("precision")?.as_f64()),
                held_out: last("held_out").and_then(|h| HeldOut::deserialize(h).ok()),
                secs: 0.0,
                windows_per_sec: 0.0,
                model: paths::model(dir),
            },
        }
    }

    /// Steps up to `end`, and a checkpoint there or where a stop was asked for.
    fn stretch(
        &mut self,
        run: &mut Run<'_>,
        sampler: &BatchSampler<'_>,
        end: u64,
        opts: &mut Options<'_>,
    ) -> Result<(), Error> {
        let cfg = run.cfg;
        let line_every = (cfg.steps / LINES).max(1);
        if run.step < end {
            opts.progress.tick(run.step, cfg.steps, "");
        }
        while run.step < end {
            let step = run.step;
            let lr = cfg.lr * cfg.schedule.factor(step as f64 / cfg.steps as f64);
            let view = run.gradient(sampler);
            if view.is_finite() {
                // Only weights from which a step is known to be possible are kept.
                let stop = opts.cancel.is_cancelled();
                if stop || self.saved.0.elapsed().as_secs_f64() >= opts.checkpoint_secs {
                    self.save(run, opts)?;
                }
                if stop {
                    self.finished.interrupted = true;
                    return Ok(());
                }
                run.learner.apply(lr, &view);
                run.step += 1;
                run.average(cfg.average);
                self.recent.add(&view.sums);
                self.recent_steps += 1;
                self.grad_norm = view.grad_norm;
            } else {
                run.step += 1;
                self.skip(run, step, opts)?;
            }
            if run.step.is_multiple_of(line_every) || run.step == cfg.steps {
                self.line(run, lr, opts.progress);
            }
            self.evaluate(run, sampler.source, opts)?;
        }
        if run.step > self.saved.1 && !run.gradient(sampler).is_finite() {
            return Err(self.diverged(run, opts));
        }
        self.save(run, opts)
    }

    fn save(&mut self, run: &mut Run<'_>, opts: &Options<'_>) -> Result<(), Error> {
        run.save(&opts.dir)?;
        self.saved = (Instant::now(), run.step);
        Ok(())
    }

    /// Measures and evaluates, where that is due and not done yet; a stop cuts it short.
    fn evaluate(
        &mut self,
        run: &mut Run<'_>,
        source: &Source<'_>,
        opts: &mut Options<'_>,
    ) -> Result<(), Error> {
        let cfg = run.cfg;
        if run.step == 0 || !due(run.step, cfg.steps, opts.evaluations) {
            return Ok(());
        }
        let known = run.metrics.len();
        if let Some(held_out) = self.held_out
            && !run.has("held_out")
        {
            let count = if run.step == cfg.steps { MEASURED_AT_END } else { MEASURED };
            // A small run is not worth a long measurement.
            let seen = run.step as usize * cfg.batch;
            let Some(found) = run.measure(source, held_out, count.min(seen), opts.cancel) else {
                self.finished.interrupted = true;
                return Ok(());
            };
            let line = serde_json::json!({"step": run.step, "held_out": found});
            opts.progress.figures(&line);
            run.metrics.push(line);
            self.finished.held_out = Some(found);
        }
        if let Some(evaluator) = opts.evaluator.as_deref_mut()
            && !run.has("evaluation")
            && !run.evaluate(evaluator, &opts.dir, opts.progress, opts.cancel)?
        {
            self.finished.interrupted = true;
        }
        if run.metrics.len() > known {
            run.draw(opts);
        }
        Ok(())
    }

    /// Counts a step whose loss or gradient was not finite; too many end the run.
    fn skip(&mut self, run: &mut Run<'_>, step: u64, opts: &Options<'_>) -> Result<(), Error> {
        self.finished.skipped += 1;
        let skipped = self.finished.skipped;
        run.metrics.push(serde_json::json!({"step": run.step, "skipped": skipped}));
        opts.progress.log(&format!("step {step}: loss or gradient not finite, skipped"));
        if skipped < MOST_SKIPPED {
            return Ok(());
        }
        Err(self.diverged(run, opts))
    }

    fn diverged(&self, run: &Run<'_>, opts: &Options<'_>) -> Error {
        // For whoever looks at the run; resuming cuts off what lies after the checkpoint.
        if let Err(e) = run.save_metrics(&opts.dir) {
            opts.progress.log(&format!("metrics not written: {e}"));
        }
        let skipped = self.finished.skipped;
        Error::Diverged { skipped, step: run.step, path: paths::last(&opts.dir) }
    }

    fn line(&mut self, run: &mut Run<'_>, lr: f64, progress: &dyn Progress) {
        let secs = self.begin.elapsed().as_secs_f64();
        let rate = (run.step - self.first) as f64 * run.cfg.batch as f64 / secs.max(1e-9);
        let (recent, steps) = (&self.recent, self.recent_steps);
        progress.tick(run.step, run.cfg.steps, &note(recent, steps, rate));
        // All of them skipped: there is nothing to tell.
        if steps == 0 {
            return;
        }
        let line = Line {
            step: run.step,
            loss: mean_loss(recent, steps),
            action_rms_visible: rms(recent, 0),
            action_rms_masked: rms(recent, 1),
            lr,
            grad_norm: self.grad_norm,
            windows_per_sec: rate.round(),
            secs: ((run.spent + secs) * 10.0).round() / 10.0,
        };
        let line = serde_json::to_value(line).unwrap_or_default();
        progress.figures(&line);
        run.metrics.push(line);
        (self.recent, self.recent_steps) = (Sums::default(), 0);
    }
}

/// Whether an evaluation falls on the end of this step.
fn due(step: u64, steps: u64, evaluations: u64) -> bool {
    let count = |s: u64| u128::from(s) * u128::from(evaluations) / u128::from(steps.max(1));
    evaluations > 0 && count(step) > count(step - 1)
}

/// A run in progress.
struct Run<'a> {
    cfg: &'a TrainConfig,
    card: Card,
    encoder: Encoder,
    learner: Learner<f32>,
    averaged: Option<Vec<f32>>,
    metrics: Vec<serde_json::Value>,
    /// Variance of the actions, mean over actuators.
    power: f64,
    step: u64,
    best: Option<(u64, f64)>,
    /// Step at which the card's Precision was measured.
    evaluated: Option<u64>,
    /// Seconds spent in earlier sessions.
    spent: f64,
}

impl<'a> Run<'a> {
    /// Begins in an empty directory, or resumes.
    fn open(data: &Dataset, cfg: &'a TrainConfig, opts: &Options<'_>) -> Result<Self, Error> {
        let (_, power) = normaliser(data, cfg.seed);
        let (dir, last) = (&opts.dir, paths::last(&opts.dir));
        if !last.exists() {
            opts.progress.log("fitting normaliser, linear prediction and action centres");
            let (card, net, encoder) = prepare(data, cfg, opts.threads)?;
            let text = toml::to_string(cfg)
                .map_err(|e| Error::Run { why: e.to_string(), path: paths::config(dir) })?;
            fsio::write_atomic(&paths::config(dir), text.as_bytes())?;
            let meta = serde_json::json!({
                "robot": card.robot.id,
                "dataset": data.path(),
                "dataset_sha256": card.training.dataset_sha256,
                "seed": cfg.seed,
                "tiles": tiled(),
                "run": opts.meta,
            });
            fsio::write_atomic(&dir.join("meta.json"), format!("{meta:#}\n").as_bytes())?;
            let averaged = (cfg.average > 0.0).then(|| net.weights.to_vec());
            let learner = Self::learner(net, cfg, opts);
            let metrics = Vec::new();
            return Ok(Run {
                cfg,
                card,
                encoder,
                learner,
                averaged,
                metrics,
                power,
                step: 0,
                best: None,
                evaluated: None,
                spent: 0.0,
            });
        }
        let refuse = |why: String| Err(Error::Run { why, path: last.clone() });
        let found = read_config(dir)?;
        if found != *cfg {
            return refuse("the run has other settings than these; give another directory".into());
        }
        let robot = super::prepare::robot_card(&data.manifest().robot);
        let Model { card, net, encoder, optimiser } = checkpoint::load(&last, Some(&robot))?;
        if card.training.dataset_sha256 != data.manifest().sha256() {
            return refuse("the run was started on other data".into());
        }
        let Some(state) = optimiser else {
            return refuse("no optimiser state to go on from".into());
        };
        if began_with_tiles(dir).is_some_and(|tiles| tiles != tiled()) {
            let with = if tiled() {
                "without a tile unit, and goes on with"
            } else {
                "with a tile unit, and goes on without"
            };
            opts.progress.log(&format!("this run began {with} one: as good, but its last bits are no longer those of an undisturbed run"));
        }
        // The checkpoint knows what it was trained with; the file beside it can be edited.
        let own = serde_json::from_value::<TrainConfig>(card.training.config.clone());
        if own.ok().as_ref() != Some(cfg) {
            let why = "config.toml is no longer the one that the run was started with: put it back, or begin a new run";
            return Err(Error::Run { why: why.into(), path: paths::config(dir) });
        }
        let step = card.training.step;
        let mut learner = Self::learner(net, cfg, opts);
        state.restore(&mut learner)?;
        let metrics = read_metrics(&paths::metrics(dir), step)?;
        let best = best_of(&metrics);
        let spent = |l: &serde_json::Value| l.get("secs").and_then(serde_json::Value::as_f64);
        let spent = metrics.iter().rev().find_map(spent).unwrap_or(0.0);
        let evaluated = metrics.iter().filter(|l| EVALUATED.iter().any(|key| l.get(key).is_some()));
        let evaluated = evaluated.filter_map(|l| l.get("step")?.as_u64()).max();
        opts.progress.log(&format!("going on from step {step}"));
        Ok(Run {
            cfg,
            card,
            encoder,
            learner,
            averaged: state.average,
            metrics,
            power,
            step,
            best,
            evaluated,
            spent,
        })
    }

    fn learner(net: Net<f32>, cfg: &TrainConfig, opts: &Options<'_>) -> Learner<f32> {
        let mut learner = Learner::new(net, cfg.adam(), cfg.batch, opts.threads);
        learner.current_only = cfg.current_only;
        learner
    }

    /// Moves the running average; a short memory at first, so that the start is forgotten.
    fn average(&mut self, decay: f64) {
        let Some(average) = &mut self.averaged else { return };
        let n = self.learner.count as f64;
        let share = 1.0 - decay.min((1.0 + n) / (10.0 + n)) as f32;
        for (a, &w) in average.iter_mut().zip(&self.learner.net.weights[..]) {
            *a += share * (w - *a);
        }
    }

    /// The model to use: averaged weights where an average is kept.
    fn model(&self) -> Model {
        let mut net = self.learner.net.clone();
        if let Some(average) = &self.averaged {
            net.weights.copy_from_slice(average);
        }
        let mut card = self.card.clone();
        card.training.step = self.step;
        Model { card, net, encoder: self.encoder.clone(), optimiser: None }
    }

    /// Loss and gradient of the next step.
    fn gradient(&mut self, sampler: &BatchSampler<'_>) -> GradientView {
        let step = self.step;
        let fill =
            |w: usize, slot: usize, batch: &mut Batch<f32>| sampler.train(step, w, slot, batch);
        self.learner.compute_gradient(&fill)
    }

    /// Whether the metrics have this of the step of the moment.
    fn has(&self, key: &str) -> bool {
        let here = |l: &&serde_json::Value| {
            l.get("step").and_then(serde_json::Value::as_u64) == Some(self.step)
        };
        self.metrics.iter().rev().filter(here).any(|l| l.get(key).is_some())
    }

    /// The network of the moment performs tasks from its own data, and what it reached is
    /// written down; nothing to do where an earlier session did. False when a stop was asked
    /// for: then nothing is written.
    fn perform(
        &mut self,
        data: &Dataset,
        round: u64,
        opts: &mut Options<'_>,
    ) -> Result<bool, Error> {
        let dir = hindsight::folder(&opts.dir, round);
        if dir.join("manifest.json").exists() {
            return Ok(true);
        }
        let Some(perform) = opts.perform.as_deref_mut() else { return Ok(true) };
        let (tasks, seed) = (self.cfg.self_tasks, self.cfg.seed);
        opts.progress.log(&format!("step {}: performing {tasks} tasks from its data", self.step));
        let job = Round { round, tasks, seed, dir: &dir };
        perform
            .perform(&self.model(), data, &job, opts.cancel)
            .map_err(|why| Error::Evaluation { step: self.step, why })
    }

    /// Held-out error; `None` when a stop was asked for meanwhile.
    fn measure(
        &mut self,
        source: &Source<'_>,
        held_out: &Windows<'_>,
        windows: usize,
        cancel: &Cancel,
    ) -> Option<HeldOut> {
        let batch = self.cfg.batch;
        // The average, where there is one, is what will be used: measure that.
        let kept = self.averaged.clone().map(|average| {
            let kept = self.learner.net.weights.to_vec();
            self.learner.net.weights.copy_from_slice(&average);
            self.learner.weights_changed();
            kept
        });
        let mut sums = Sums::default();
        let rounds = windows.div_ceil(batch);
        let mut done = 0;
        while done < rounds && !cancel.is_cancelled() {
            let round = done;
            let fill = |w: usize, slot: usize, to: &mut Batch<f32>| {
                source.measure(held_out, (round * batch + w) as u64, slot, to);
            };
            sums.add(&self.learner.errors(&fill));
            done += 1;
        }
        if let Some(kept) = kept {
            self.learner.net.weights.copy_from_slice(&kept);
            self.learner.weights_changed();
        }
        if done < rounds {
            return None;
        }
        let power = self.power.max(1e-12);
        let nmse = |square: f64, count: f64| (count > 0.0).then(|| square / count / power);
        let gaps = sums.gap_square.iter().zip(&sums.gap_windows).take(GAPS - 1);
        let place = |p: usize| nmse(sums.place_square[p], sums.place_tokens[p]);
        let tokens: f64 = sums.place_tokens.iter().sum();
        Some(HeldOut {
            nmse_by_hidden: gaps.map(|(&s, &n)| nmse(s, n)).collect(),
            nmse_clear: place(0),
            nmse_stop: place(1),
            nmse_contact: place(2),
            shares: sums.place_tokens.map(|n| n / tokens.max(1.0)),
        })
    }

    /// The linear prediction alone on the evaluator's tasks: what the training has to beat, and the
    /// first candidate for `best`, since an untrained skip network is that answer. False when
    /// a stop was asked for meanwhile.
    fn evaluate_linear(&mut self, opts: &mut Options<'_>) -> Result<bool, Error> {
        let Some(evaluator) = opts.evaluator.as_deref_mut() else { return Ok(true) };
        if self.cfg.skip == SkipKind::Off || opts.evaluations == 0 || self.has("linear") {
            return Ok(true);
        }
        let found = evaluator.evaluate_linear(&self.model(), opts.cancel);
        let found = found.map_err(|why| Error::Evaluation { step: self.step, why })?;
        let Some(found) = found else { return Ok(false) };
        opts.progress.log(&format!("linear prediction: Precision {:.5}", found.precision));
        self.metrics.push(serde_json::json!({"step": 0, "linear": found}));
        self.note_evaluated(found, &opts.dir)?;
        Ok(true)
    }

    /// Figures into the card, and a file where none was better.
    fn note_evaluated(&mut self, found: Evaluation, dir: &Path) -> Result<(), Error> {
        self.card.training.precision = found.suites;
        self.evaluated = Some(self.step);
        if self.best.is_none_or(|(_, best)| found.precision < best) {
            self.best = Some((self.step, found.precision));
            let Model { card, net, encoder, .. } = self.model();
            checkpoint::save(&paths::best(dir), &card, &net, encoder.ridge.as_ref(), None)?;
        }
        Ok(())
    }

    /// Curves into the run directory. A picture that fails is no reason to stop.
    fn draw(&self, opts: &Options<'_>) {
        let whole = opts.dir.canonicalize().unwrap_or_else(|_| opts.dir.clone());
        let name = whole.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut record = Record::of(name, self.cfg.clone(), &self.metrics);
        record.robot.clone_from(&self.card.robot.id);
        let Some(figure) = curves::figure(&record) else { return };
        if let Err(e) = figure.save(&paths::curves(&opts.dir)) {
            opts.progress.log(&format!("no picture of the curves: {e}"));
        }
    }

    /// False when a stop was asked for meanwhile.
    fn evaluate(
        &mut self,
        evaluator: &mut dyn Evaluate,
        dir: &Path,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<bool, Error> {
        let found = evaluator.evaluate(&self.model(), cancel);
        let found = found.map_err(|why| Error::Evaluation { step: self.step, why })?;
        let Some(found) = found else { return Ok(false) };
        let line = serde_json::json!({"step": self.step, "evaluation": found});
        progress.figures(&line);
        self.metrics.push(line);
        progress.log(&format!("step {}: Precision {:.5}", self.step, found.precision));
        self.note_evaluated(found, dir)?;
        Ok(true)
    }

    fn save_metrics(&self, dir: &Path) -> Result<(), Error> {
        let lines: Vec<String> = self.metrics.iter().map(ToString::to_string).collect();
        let lines = lines.join("\n") + "\n";
        Ok(fsio::write_atomic(&paths::metrics(dir), lines.as_bytes())?)
    }

    /// Metrics first: a crash in between leaves lines that resuming cuts off again.
    fn save(&mut self, dir: &Path) -> Result<(), Error> {
        self.save_metrics(dir)?;
        self.card.training.step = self.step;
        // Figures of an earlier step are none of these weights.
        if self.evaluated != Some(self.step) {
            self.card.training.precision.clear();
        }
        let ridge = self.encoder.ridge.as_ref();
        let state = OptimiserState::of(&self.learner, self.averaged.as_deref());
        let net = &self.learner.net;
        checkpoint::save(&paths::last(dir), &self.card, net, ridge, Some(&state))?;
        let model = self.model();
        checkpoint::save(&paths::model(dir), &model.card, &model.net, ridge, None)?;
        Ok(())
    }
}

fn mean_loss(sums: &Sums, steps: u32) -> f64 {
    sums.loss / f64::from(steps.max(1))
}

fn rms(sums: &Sums, side: usize) -> f64 {
    (sums.square[side] / sums.tokens[side].max(1.0)).sqrt()
}

fn note(sums: &Sums, steps: u32, rate: f64) -> String {
    format!(
        "loss {:.5}, action error {:.4} visible {:.4} masked, {rate:.0} windows/s",
        mean_loss(sums, steps),
        rms(sums, 0),
        rms(sums, 1),
    )
}

fn best_of(metrics: &[serde_json::Value]) -> Option<(u64, f64)> {
    let found = metrics.iter().filter_map(|l| {
        let found = EVALUATED.iter().find_map(|key| l.get(key))?;
        Some((l.get("step")?.as_u64()?, found.get("precision")?.as_f64()?))
    });
    found.min_by(|a, b| a.1.total_cmp(&b.1))
}
