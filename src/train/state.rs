//! A run in progress: weights, moments, average, metrics; how it begins, resumes and is saved.

use std::path::Path;

use super::hindsight::{self, Round};
use super::metrics::{Evaluation, Metrics};
use super::options::Options;
use super::prepare::{normaliser, prepare, robot_card};
use super::record::began_with_tiles;
use super::source::BatchSampler;
use super::{Error, TrainConfig, paths};
use robert_base::fsio;
use robert_dataset::Dataset;
use robert_linalg::tiled;
use robert_net::checkpoint::{self, OptimiserState};
use robert_net::step::GradientView;
use robert_net::{Batch, Card, Encoder, Learner, Model, Net};

/// A run in progress.
pub(super) struct RunState<'a> {
    pub(super) cfg: &'a TrainConfig,
    pub(super) card: Card,
    pub(super) encoder: Encoder,
    pub(super) learner: Learner<f32>,
    pub(super) averaged: Option<Vec<f32>>,
    pub(super) metrics: Metrics,
    /// Variance of the actions, mean over actuators.
    pub(super) power: f64,
    pub(super) step: u64,
    pub(super) best: Option<(u64, f64)>,
    /// Step at which the card's Precision was measured.
    evaluated: Option<u64>,
    /// Seconds spent in earlier sessions.
    pub(super) spent: f64,
}

impl<'a> RunState<'a> {
    /// Begins in an empty directory, or resumes.
    pub(super) fn open(
        data: &Dataset,
        cfg: &'a TrainConfig,
        opts: &Options<'_>,
    ) -> Result<Self, Error> {
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
            fsio::write_atomic(&paths::meta(dir), format!("{meta:#}\n").as_bytes())?;
            let averaged = (cfg.average > 0.0).then(|| net.weights.to_vec());
            let learner = Self::learner(net, cfg, opts);
            let metrics = Metrics::default();
            return Ok(RunState {
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
        let found = paths::read_config(dir)?;
        if found != *cfg {
            return refuse("the run has other settings; choose another directory".into());
        }
        let robot = robot_card(&data.manifest().robot);
        let Model { card, net, encoder, optimiser } = checkpoint::load(&last, Some(&robot))?;
        if card.training.dataset_sha256 != data.manifest().sha256() {
            return refuse("the run was started on other data".into());
        }
        let Some(state) = optimiser else {
            return refuse("there is no optimiser state to continue from".into());
        };
        if began_with_tiles(dir).is_some_and(|tiles| tiles != tiled()) {
            let with = if tiled() {
                "without a tile unit and continues with"
            } else {
                "with a tile unit and continues without"
            };
            opts.progress.log(&format!("this run began {with} one: the result is as good, but its last bits differ from those of an undisturbed run"));
        }
        // The checkpoint contains its settings; the file beside it may have been edited.
        let own = serde_json::from_value::<TrainConfig>(card.training.config.clone());
        if own.ok().as_ref() != Some(cfg) {
            let why =
                "config.toml was changed since the run started: restore it, or begin a new run";
            return Err(Error::Run { why: why.into(), path: paths::config(dir) });
        }
        let step = card.training.step;
        let mut learner = Self::learner(net, cfg, opts);
        state.restore(&mut learner)?;
        let metrics = Metrics::read(&paths::metrics(dir), step)?;
        let (best, evaluated, spent) = (metrics.best(), metrics.evaluated(), metrics.secs());
        opts.progress.log(&format!("continuing from step {step}"));
        Ok(RunState {
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

    /// Updates the running average; its memory is short at first, so that the start is forgotten.
    pub(super) fn average(&mut self, decay: f64) {
        let Some(average) = &mut self.averaged else { return };
        let n = self.learner.count as f64;
        let share = 1.0 - decay.min((1.0 + n) / (10.0 + n)) as f32;
        for (a, &w) in average.iter_mut().zip(&self.learner.net.weights[..]) {
            *a += share * (w - *a);
        }
    }

    /// The model to use: averaged weights if there is an average.
    pub(super) fn model(&self) -> Model {
        let mut net = self.learner.net.clone();
        if let Some(average) = &self.averaged {
            net.weights.copy_from_slice(average);
        }
        let mut card = self.card.clone();
        card.training.step = self.step;
        Model { card, net, encoder: self.encoder.clone(), optimiser: None }
    }

    /// Loss and gradient of the next step.
    pub(super) fn gradient(&mut self, sampler: &BatchSampler<'_>) -> GradientView {
        let step = self.step;
        let fill =
            |w: usize, slot: usize, batch: &mut Batch<f32>| sampler.train(step, w, slot, batch);
        self.learner.compute_gradient(&fill)
    }

    /// The current network performs tasks from its own data, and the reached motion is saved,
    /// unless an earlier session did so. False if a stop was requested; then nothing is written.
    pub(super) fn perform(
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

    /// Writes figures to the card, and saves the model if it is the best.
    pub(super) fn note_evaluation(&mut self, found: Evaluation, dir: &Path) -> Result<(), Error> {
        self.card.training.precision = found.suites;
        self.evaluated = Some(self.step);
        if self.best.is_none_or(|(_, best)| found.precision < best) {
            self.best = Some((self.step, found.precision));
            let Model { card, net, encoder, .. } = self.model();
            checkpoint::save(&paths::best(dir), &card, &net, encoder.ridge.as_ref(), None)?;
        }
        Ok(())
    }

    /// Writes the metrics alone.
    pub(super) fn save_metrics(&self, dir: &Path) -> Result<(), Error> {
        self.metrics.write(&paths::metrics(dir))
    }

    /// Metrics are written first; a crash in between leaves lines that resuming removes.
    pub(super) fn save(&mut self, dir: &Path) -> Result<(), Error> {
        self.save_metrics(dir)?;
        self.card.training.step = self.step;
        // Figures of an earlier step do not belong to these weights.
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
