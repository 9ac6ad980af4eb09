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

use super::hindsight::{self, Perform};
use super::prepare::{normaliser, prepare};
use super::record::{Line, Record, read_metrics};
use super::source::{Mix, Source};
use super::{Error, TrainConfig, curves};
use crate::dataset::{Dataset, Part, Windows};
use crate::fsio;
use crate::net::checkpoint::{self, OptimiserState};
use crate::net::head::{GAPS, Sums};
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

/// What a closed-loop evaluation found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Mean Precision over the suites: lower is better; selects the best checkpoint.
    pub precision: f64,
    /// Precision by suite.
    pub suites: BTreeMap<String, f64>,
}

/// Judges a network by what it does, not by its loss.
pub trait Evaluate {
    /// Rolls the network out.
    ///
    /// # Errors
    /// A message; the run stops with it.
    fn evaluate(&mut self, model: &Model) -> Result<Evaluation, String>;
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
    /// Closed-loop judge; without one only the last model is kept.
    pub judge: Option<&'a mut dyn Evaluate>,
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
    /// Steps skipped because something was not finite.
    pub skipped: u64,
    /// Best step and its Precision.
    pub best: Option<(u64, f64)>,
    /// Held-out error at the end.
    pub held_out: Option<HeldOut>,
    /// Seconds of this session.
    pub secs: f64,
    /// Training windows a second of this session.
    pub windows_per_sec: f64,
    /// The model to use.
    pub model: PathBuf,
}

/// Error of inferred actions on held-out trajectories, as a share of the actions' variance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Of the current frame, by number of hidden frames before the next visible one, 0 to 19.
    pub nmse_by_hidden: Vec<f64>,
    /// Next frame visible, away from stops and contact.
    pub nmse_clear: f64,
    /// Next frame visible, a joint near a stop: torque that presses against a stop leaves no
    /// trace in positions.
    pub nmse_stop: f64,
    /// Next frame visible, in self-contact.
    pub nmse_contact: f64,
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
    if cfg.self_correct > 0 && opts.perform.is_none() {
        return Err(Error::Setting {
            setting: "self_correct".into(),
            why: "nobody here performs the tasks".into(),
        });
    }
    let mut run = Run::open(data, cfg, &opts)?;
    if run.step == 0 {
        run.judge_linear(&mut opts)?;
        // From the first step on there is something good to fall back on.
        run.save(&opts.dir)?;
    }
    let encoder = run.encoder.clone();
    let source = Source::new(data, &encoder, cfg);
    let windows = Windows::new(data, WINDOW, Part::Train, cfg.seed)?;
    let held_out = Windows::new(data, WINDOW, Part::Test, cfg.seed).ok();
    let begin = Instant::now();
    let first = run.step;
    let mut session = Session {
        begin,
        first,
        saved: begin,
        recent: Sums::default(),
        recent_steps: 0,
        finished: Finished {
            step: run.step,
            steps: cfg.steps,
            interrupted: false,
            skipped: 0,
            best: run.best,
            held_out: None,
            secs: 0.0,
            windows_per_sec: 0.0,
            model: paths::model(&opts.dir),
        },
    };
    // A stretch of steps learns from the data and from what earlier rounds reached.
    for round in 0..=cfg.self_correct {
        let end = cfg.steps * (round + 1) / (cfg.self_correct + 1);
        if run.step >= end && round < cfg.self_correct {
            continue;
        }
        if round > 0 {
            run.perform(data, round, &mut opts)?;
        }
        let reached = hindsight::open(&opts.dir, round)?;
        let mix = Mix::new(&source, &windows, &reached);
        session.stretch(&mut run, &mix, held_out.as_ref(), end, &mut opts)?;
        if session.finished.interrupted {
            break;
        }
    }
    run.save(&opts.dir)?;
    let mut finished = session.finished;
    finished.step = run.step;
    finished.secs = begin.elapsed().as_secs_f64();
    finished.windows_per_sec =
        (run.step - first) as f64 * cfg.batch as f64 / finished.secs.max(1e-9);
    Ok(finished)
}

/// What one call of [`train`] counts.
struct Session {
    begin: Instant,
    /// Step that it began at.
    first: u64,
    saved: Instant,
    recent: Sums,
    recent_steps: u32,
    finished: Finished,
}

impl Session {
    /// Steps up to `end`.
    fn stretch(
        &mut self,
        run: &mut Run<'_>,
        mix: &Mix<'_>,
        held_out: Option<&Windows<'_>>,
        end: u64,
        opts: &mut Options<'_>,
    ) -> Result<(), Error> {
        let cfg = run.cfg;
        let line_every = (cfg.steps / LINES).max(1);
        while run.step < end {
            if opts.cancel.is_cancelled() {
                self.finished.interrupted = true;
                break;
            }
            let step = run.step;
            let lr = cfg.lr * cfg.schedule.factor(step as f64 / cfg.steps as f64);
            let fill = |w: usize, slot: usize, batch: &mut Batch<f32>| {
                mix.train(step, w, slot, batch);
            };
            let report = run.learner.step(lr, &fill);
            run.step += 1;
            if report.applied {
                run.average(cfg.average);
                self.recent.add(&report.sums);
                self.recent_steps += 1;
            } else {
                self.skip(step, opts)?;
            }
            if run.step.is_multiple_of(line_every) || run.step == cfg.steps {
                self.line(run, lr, report.grad_norm, opts.progress);
            }
            if due(run.step, cfg.steps, opts.evaluations) {
                if let Some(held_out) = held_out {
                    let count = if run.step == cfg.steps { MEASURED_AT_END } else { MEASURED };
                    // A small run is not worth a long measurement.
                    let seen = run.step as usize * cfg.batch;
                    let found = run.measure(mix.source, held_out, count.min(seen));
                    let line = serde_json::json!({"step": run.step, "held_out": found});
                    opts.progress.figures(&line);
                    run.metrics.push(line);
                    self.finished.held_out = Some(found);
                }
                if let Some(judge) = opts.judge.as_deref_mut() {
                    run.judge(judge, &opts.dir, opts.progress)?;
                    self.finished.best = run.best;
                }
                run.draw(opts);
            }
            if self.saved.elapsed().as_secs_f64() >= opts.checkpoint_secs {
                run.save(&opts.dir)?;
                self.saved = Instant::now();
            }
        }
        Ok(())
    }

    /// Counts a step whose loss or gradient was not finite; too many end the run.
    fn skip(&mut self, step: u64, opts: &Options<'_>) -> Result<(), Error> {
        self.finished.skipped += 1;
        let skipped = self.finished.skipped;
        opts.progress.log(&format!("step {step}: loss or gradient not finite, skipped"));
        if skipped < MOST_SKIPPED {
            return Ok(());
        }
        Err(Error::Diverged { skipped, step, path: paths::last(&opts.dir) })
    }

    fn line(&mut self, run: &mut Run<'_>, lr: f64, grad_norm: f64, progress: &dyn Progress) {
        let secs = self.begin.elapsed().as_secs_f64();
        let rate = (run.step - self.first) as f64 * run.cfg.batch as f64 / secs.max(1e-9);
        let (recent, steps) = (&self.recent, self.recent_steps);
        let line = Line {
            step: run.step,
            loss: mean_loss(recent, steps),
            action_rms_visible: rms(recent, 0),
            action_rms_masked: rms(recent, 1),
            lr,
            grad_norm,
            windows_per_sec: rate.round(),
            secs: ((run.spent + secs) * 10.0).round() / 10.0,
        };
        progress.tick(run.step, run.cfg.steps, &note(recent, steps, rate));
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
    /// Seconds spent in earlier sessions.
    spent: f64,
}

impl<'a> Run<'a> {
    /// Begins in an empty directory, or resumes.
    fn open(data: &Dataset, cfg: &'a TrainConfig, opts: &Options<'_>) -> Result<Self, Error> {
        let (_, power) = normaliser(data, cfg.seed);
        let (dir, last) = (&opts.dir, paths::last(&opts.dir));
        if !last.exists() {
            opts.progress.log("fitting normaliser, linear answer and action centres");
            let (card, net, encoder) = prepare(data, cfg, opts.threads)?;
            let text = toml::to_string(cfg)
                .map_err(|e| Error::Run { why: e.to_string(), path: paths::config(dir) })?;
            fsio::write_atomic(&paths::config(dir), text.as_bytes())?;
            let meta = serde_json::json!({
                "robot": card.robot.id,
                "dataset": data.path(),
                "dataset_sha256": card.training.dataset_sha256,
                "seed": cfg.seed,
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
        let step = card.training.step;
        let mut learner = Self::learner(net, cfg, opts);
        state.restore(&mut learner)?;
        let metrics = read_metrics(&paths::metrics(dir), step)?;
        let best = best_of(&metrics);
        let spent = |l: &serde_json::Value| l.get("secs").and_then(serde_json::Value::as_f64);
        let spent = metrics.iter().rev().find_map(spent).unwrap_or(0.0);
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

    /// The network of the moment performs tasks from its own data, and what it reached is
    /// written down; nothing to do where an earlier session did.
    fn perform(&mut self, data: &Dataset, round: u64, opts: &mut Options<'_>) -> Result<(), Error> {
        let dir = hindsight::folder(&opts.dir, round);
        if dir.join("manifest.json").exists() {
            return Ok(());
        }
        let Some(perform) = opts.perform.as_deref_mut() else { return Ok(()) };
        let (tasks, seed) = (self.cfg.self_tasks, self.cfg.seed);
        opts.progress.log(&format!("step {}: performing {tasks} tasks from its data", self.step));
        perform
            .perform(&self.model(), data, round, tasks, seed, &dir)
            .map_err(|why| Error::Evaluation { step: self.step, why })
    }

    fn measure(&mut self, source: &Source<'_>, held_out: &Windows<'_>, windows: usize) -> HeldOut {
        let batch = self.cfg.batch;
        // The average, where there is one, is what will be used: measure that.
        let kept = self.averaged.clone().map(|average| {
            let kept = self.learner.net.weights.to_vec();
            self.learner.net.weights.copy_from_slice(&average);
            self.learner.weights_changed();
            kept
        });
        let mut sums = Sums::default();
        for round in 0..windows.div_ceil(batch) {
            let fill = |w: usize, slot: usize, to: &mut Batch<f32>| {
                source.measure(held_out, (round * batch + w) as u64, slot, to);
            };
            sums.add(&self.learner.errors(&fill));
        }
        if let Some(kept) = kept {
            self.learner.net.weights.copy_from_slice(&kept);
            self.learner.weights_changed();
        }
        let nmse = |square: f64, count: f64| square / count.max(1.0) / self.power.max(1e-12);
        let gaps = sums.gap_square.iter().zip(&sums.gap_windows).take(GAPS - 1);
        let place = |p: usize| nmse(sums.place_square[p], sums.place_tokens[p]);
        let tokens: f64 = sums.place_tokens.iter().sum();
        HeldOut {
            nmse_by_hidden: gaps.map(|(&s, &n)| nmse(s, n)).collect(),
            nmse_clear: place(0),
            nmse_stop: place(1),
            nmse_contact: place(2),
            shares: sums.place_tokens.map(|n| n / tokens.max(1.0)),
        }
    }

    /// The linear answer alone on the judge's tasks: what the training has to beat. An
    /// untrained skip network is that answer.
    fn judge_linear(&mut self, opts: &mut Options<'_>) -> Result<(), Error> {
        let Some(judge) = opts.judge.as_deref_mut() else { return Ok(()) };
        if self.cfg.skip == SkipKind::Off || opts.evaluations == 0 {
            return Ok(());
        }
        let found = judge
            .evaluate(&self.model())
            .map_err(|why| Error::Evaluation { step: self.step, why })?;
        opts.progress.log(&format!("linear answer: Precision {:.5}", found.precision));
        self.metrics.push(serde_json::json!({"step": 0, "linear": found}));
        self.card.training.precision = found.suites;
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

    fn judge(
        &mut self,
        judge: &mut dyn Evaluate,
        dir: &Path,
        progress: &dyn Progress,
    ) -> Result<(), Error> {
        let mut model = self.model();
        let found =
            judge.evaluate(&model).map_err(|why| Error::Evaluation { step: self.step, why })?;
        progress.figures(&serde_json::json!({"step": self.step, "evaluation": found}));
        self.metrics.push(serde_json::json!({"step": self.step, "evaluation": found}));
        progress.log(&format!("step {}: Precision {:.5}", self.step, found.precision));
        model.card.training.precision = found.suites.clone();
        self.card.training.precision = found.suites;
        if self.best.is_none_or(|(_, best)| found.precision < best) {
            self.best = Some((self.step, found.precision));
            let ridge = model.encoder.ridge.as_ref();
            checkpoint::save(&paths::best(dir), &model.card, &model.net, ridge, None)?;
        }
        Ok(())
    }

    /// Metrics first: a crash in between leaves lines that resuming cuts off again.
    fn save(&mut self, dir: &Path) -> Result<(), Error> {
        let lines: Vec<String> = self.metrics.iter().map(ToString::to_string).collect();
        let lines = lines.join("\n") + "\n";
        fsio::write_atomic(&paths::metrics(dir), lines.as_bytes())?;
        self.card.training.step = self.step;
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
        let precision = l.get("evaluation")?.get("precision")?.as_f64()?;
        Some((l.get("step")?.as_u64()?, precision))
    });
    found.min_by(|a, b| a.1.total_cmp(&b.1))
}
