//! A run in progress: weights, moments, average, metrics; how it begins, resumes and is saved.

use std::path::Path;

use super::hindsight::{self, Round};
use super::metrics::{Evaluation, Metrics};
use super::options::Options;
use super::prepare::{normaliser, prepare, robot_card};
use super::record::{began_on, began_with_tiles};
use super::source::BatchSampler;
use super::{Error, TrainConfig, paths};
use robert_base::fsio;
use robert_dataset::Dataset;
use robert_linalg::tiled;
use robert_net::checkpoint;
use robert_net::engine::Engine;
use robert_net::step::GradientView;
use robert_net::{Batch, Card, CpuEngine, Encoder, Model, Net, Setup};

/// A run in progress.
pub(super) struct RunState<'a> {
    pub(super) cfg: &'a TrainConfig,
    pub(super) card: Card,
    pub(super) encoder: Encoder,
    pub(super) engine: Box<dyn Engine>,
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
            opts.progress.log("preparing normaliser, linear prediction and action centres");
            let (card, net, encoder) = prepare(data, cfg, opts.linear, opts.threads, opts.cancel)?;
            let text = toml::to_string(cfg)
                .map_err(|e| Error::Run { why: e.to_string(), path: paths::config(dir) })?;
            fsio::write_atomic(&paths::config(dir), text.as_bytes())?;
            let engine = Self::engine(net, cfg, opts)?;
            let meta = serde_json::json!({
                "robot": card.robot.id,
                "dataset": data.path(),
                "dataset_sha256": card.training.dataset_sha256,
                "seed": cfg.seed,
                "tiles": tiled(),
                "device": kind(engine.as_ref()),
                "evaluations": opts.evaluations,
                "run": opts.meta,
            });
            fsio::write_atomic(&paths::meta(dir), format!("{meta:#}\n").as_bytes())?;
            let metrics = Metrics::default();
            return Ok(RunState {
                cfg,
                card,
                encoder,
                engine,
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
        // The checkpoint contains its settings; the file beside it may have been edited.
        let own = serde_json::from_value::<TrainConfig>(card.training.config.clone());
        if own.ok().as_ref() != Some(cfg) {
            let why =
                "config.toml was changed since the run started: restore it, or begin a new run";
            return Err(Error::Run { why: why.into(), path: paths::config(dir) });
        }
        let step = card.training.step;
        let mut engine = Self::engine(net, cfg, opts)?;
        engine.restore(&state)?;
        if let Some(from) = other_numerics(dir, engine.as_ref()) {
            opts.progress.log(&format!("this run began {from}: the result is as good, but its last bits differ from those of an undisturbed run"));
        }
        let metrics = Metrics::read(&paths::metrics(dir), step)?;
        let (best, evaluated, spent) = (metrics.best(), metrics.evaluated(), metrics.secs());
        opts.progress.log(&format!("continuing from step {step}"));
        Ok(RunState { cfg, card, encoder, engine, metrics, power, step, best, evaluated, spent })
    }

    fn engine(
        net: Net<f32>,
        cfg: &TrainConfig,
        opts: &Options<'_>,
    ) -> Result<Box<dyn Engine>, Error> {
        let setup = Setup {
            net,
            adam: cfg.adam(),
            batch: cfg.batch,
            threads: opts.threads,
            current_only: cfg.current_only,
            averages: cfg.average > 0.0,
        };
        Ok(match opts.engines {
            // A linear prediction alone needs no card.
            Some(engines) if cfg.steps > 0 => engines.open(setup, opts.progress)?,
            _ => Box::new(CpuEngine::new(setup)),
        })
    }

    /// The model to use: averaged weights if there is an average.
    pub(super) fn model(&mut self) -> Result<Model, Error> {
        let net = self.engine.net(true)?;
        let mut card = self.card.clone();
        card.training.step = self.step;
        Ok(Model { card, net, encoder: self.encoder.clone(), optimiser: None })
    }

    /// Loss and gradient of the next step; steps up to `end` draw from the same data.
    pub(super) fn gradient(
        &mut self,
        sampler: &BatchSampler<'_>,
        end: u64,
    ) -> Result<GradientView, Error> {
        let fill = |step: u64, w: usize, slot: usize, batch: &mut Batch<f32>| {
            sampler.train(step, w, slot, batch);
        };
        let next = Some(self.step + 1).filter(|&next| next < end);
        Ok(self.engine.gradient(&fill, self.step, next)?)
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
            .perform(&self.model()?, data, &job, opts.cancel)
            .map_err(|why| Error::Evaluation { step: self.step, why })
    }

    /// Writes figures to the card, and saves the model if it is the best.
    pub(super) fn note_evaluation(&mut self, found: Evaluation, dir: &Path) -> Result<(), Error> {
        self.card.training.precision = found.suites;
        self.evaluated = Some(self.step);
        if self.best.is_none_or(|(_, best)| found.precision < best) {
            self.best = Some((self.step, found.precision));
            let Model { card, net, encoder, .. } = self.model()?;
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
        let state = self.engine.state()?;
        let net = self.engine.net(false)?;
        checkpoint::save(&paths::last(dir), &self.card, &net, ridge, Some(&state))?;
        drop((net, state));
        let model = self.model()?;
        let ridge = model.encoder.ridge.as_ref();
        checkpoint::save(&paths::model(dir), &model.card, &model.net, ridge, None)?;
        Ok(())
    }
}

/// The processor or the card of an engine, as `meta.json` names it.
fn kind(engine: &dyn Engine) -> String {
    engine.device().map_or_else(|| "cpu".to_owned(), |d| d.name)
}

/// The kind of numerics with which the run began, if the last bits of this device would differ from
/// it.
fn other_numerics(dir: &Path, engine: &dyn Engine) -> Option<String> {
    let now = kind(engine);
    let then = began_on(dir).unwrap_or_else(|| "cpu".to_owned());
    if then != now {
        return Some(format!("on {then} and continues on {now}"));
    }
    let tiles = began_with_tiles(dir).filter(|&tiles| tiles != tiled() && now == "cpu")?;
    Some(if tiles {
        "with a tile unit and continues without one".to_owned()
    } else {
        "without a tile unit and continues with one".to_owned()
    })
}
