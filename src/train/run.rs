//! The training loop: sample, step, log, evaluate, checkpoint.
//!
//! There is no state of a random generator: batch, masks and schedule are functions of seed and
//! step, so weights, moments and the step number are the whole state. A run that is killed anywhere
//! ends with the same bits as one that is not. Two costly kinds of bugs of other trainers (in the
//! order of data, and in the generator's state) cannot occur.

use std::fmt::Write as _;
use std::time::Instant;

use super::metrics::{Line, Metric};
use super::options::{Finished, Options};
use super::source::{BatchSampler, Source};
use super::state::RunState;
use super::{Error, TrainConfig, hindsight, paths};
use robert_base::progress::Progress;
use robert_dataset::{Dataset, Part, Windows};
use robert_net::head::Sums;
use robert_net::{Engines, WINDOW};

/// Steps with a loss or gradient that is not finite before a run stops.
const MOST_SKIPPED: u64 = 10;
/// Lines of training metrics in a run.
const LINES: u64 = 400;

/// Trains in `opts.dir`: begins there, or continues from its last checkpoint.
///
/// # Errors
/// Those of [`Error`]; the last checkpoint always stays intact.
pub fn train(data: &Dataset, cfg: &TrainConfig, mut opts: Options<'_>) -> Result<Finished, Error> {
    check(data, cfg, &opts)?;
    loop {
        match session(data, cfg, &mut opts) {
            // The weights since the last checkpoint were in the card's memory.
            Err(Error::Net(lost @ robert_net::Error::Lost { .. }))
                if opts.engines.is_some_and(Engines::survives) =>
            {
                opts.progress
                    .log(&format!("{lost}; the processor goes on from the last checkpoint"));
                opts.engines = None;
            }
            Err(Error::Net(lost @ robert_net::Error::Lost { .. })) => {
                return Err(Error::Lost { why: lost.to_string(), path: opts.dir });
            }
            done => return done,
        }
    }
}

/// Trains until the end, a stop, or an error.
fn session(data: &Dataset, cfg: &TrainConfig, opts: &mut Options<'_>) -> Result<Finished, Error> {
    let mut run = RunState::open(data, cfg, opts)?;
    let (mut interrupted, mut worsened) = (false, false);
    if run.step == 0 {
        interrupted = !run.evaluate_linear(opts)?;
        // There is a valid checkpoint from the first step on.
        run.save(&opts.dir)?;
    }
    let encoder = run.encoder.clone();
    let source = Source::new(data, &encoder, cfg);
    let windows = Windows::new(data, WINDOW, Part::Train, cfg.seed)?;
    let held_out = Windows::new(data, WINDOW, Part::Test, cfg.seed).ok();
    let mut session = Session::new(&run);
    // An evaluation that was interrupted by a stop is repeated.
    interrupted |= !run.evaluate_if_due(&source, held_out.as_ref(), opts)?;

    // A round of steps learns from the data and from the motion of earlier rounds.
    'rounds: for round in 0..=cfg.self_correct {
        let end = cfg.steps * (round + 1) / (cfg.self_correct + 1);
        if interrupted {
            break;
        }
        if run.step >= end && round < cfg.self_correct {
            continue;
        }
        if round > 0 && !run.perform(data, round, opts)? {
            interrupted = true;
            break;
        }
        let reached = hindsight::open(&opts.dir, round)?;
        let sampler = BatchSampler::new(&source, &windows, &reached);
        if run.step < end {
            opts.progress.tick(run.step, cfg.steps, "");
        }
        while run.step < end {
            let lr = cfg.lr * cfg.schedule.factor(run.step as f64 / cfg.steps as f64);
            let view = run.gradient(&sampler, end)?;
            if view.is_finite() {
                // Only weights whose next step is known to be finite are kept.
                let stop = opts.cancel.is_cancelled();
                if stop || session.saved.0.elapsed().as_secs_f64() >= opts.checkpoint_secs {
                    session.checkpoint(&mut run, opts)?;
                }
                if stop {
                    interrupted = true;
                    break 'rounds;
                }
                run.engine.apply(lr, &view, cfg.average)?;
                run.step += 1;
                session.recent.add(&view.sums);
                session.recent_steps += 1;
                session.grad_norm = view.grad_norm;
            } else {
                run.step += 1;
                session.skip(&mut run, opts)?;
            }
            if run.step.is_multiple_of((cfg.steps / LINES).max(1)) || run.step == cfg.steps {
                session.log(&mut run, lr, opts.progress);
            }
            interrupted |= !run.evaluate_if_due(&source, held_out.as_ref(), opts)?;
            if opts.patience > 0 && run.metrics.worse_in_a_row() >= opts.patience {
                let text = format!(
                    "step {}: the error in closed loop stays above twice the best; the best is kept",
                    run.step
                );
                opts.progress.log(&text);
                worsened = true;
                session.checkpoint(&mut run, opts)?;
                break 'rounds;
            }
        }
        if run.step > session.saved.1 && !run.gradient(&sampler, end)?.is_finite() {
            return Err(session.diverged(&run, opts));
        }
        session.checkpoint(&mut run, opts)?;
    }
    Ok(Finished { worsened, ..session.finish(&run, opts, interrupted) })
}

/// Refuses settings that cannot work, before the first step.
fn check(data: &Dataset, cfg: &TrainConfig, opts: &Options<'_>) -> Result<(), Error> {
    cfg.check()?;
    cfg.check_network()?;
    if cfg.self_correct > 0 {
        if opts.perform.is_none() {
            return Err(Error::Setting {
                setting: "self_correct".into(),
                why: "there is no evaluator for the tasks".into(),
            });
        }
        // The first round is late, so a dataset without long enough trajectories is refused now.
        Windows::new(data, hindsight::STATES, Part::Train, cfg.seed)?;
    }
    Ok(())
}

/// Counters of one call of [`train`].
struct Session {
    begin: Instant,
    /// Step that it began at.
    first: u64,
    /// Time and step of the last checkpoint.
    saved: (Instant, u64),
    /// Values since the last line of the log.
    recent: Sums,
    recent_steps: u32,
    /// Norm of the last gradient that was applied.
    grad_norm: f64,
    /// Steps skipped, all sessions.
    skipped: u64,
}

impl Session {
    fn new(run: &RunState<'_>) -> Self {
        let begin = Instant::now();
        Session {
            begin,
            first: run.step,
            saved: (begin, run.step),
            recent: Sums::default(),
            recent_steps: 0,
            grad_norm: 0.0,
            skipped: run.metrics.skipped(),
        }
    }

    fn checkpoint(&mut self, run: &mut RunState<'_>, opts: &Options<'_>) -> Result<(), Error> {
        run.save(&opts.dir)?;
        self.saved = (Instant::now(), run.step);
        Ok(())
    }

    /// Counts a step whose loss or gradient was not finite; too many end the run.
    fn skip(&mut self, run: &mut RunState<'_>, opts: &Options<'_>) -> Result<(), Error> {
        self.skipped += 1;
        run.metrics.push(Metric::Skipped { step: run.step, skipped: self.skipped });
        let step = run.step - 1;
        opts.progress.log(&format!("step {step} was skipped: loss or gradient is not finite"));
        if self.skipped < MOST_SKIPPED {
            return Ok(());
        }
        Err(self.diverged(run, opts))
    }

    fn diverged(&self, run: &RunState<'_>, opts: &Options<'_>) -> Error {
        // For people who look at the run; resuming removes the lines after the checkpoint.
        if let Err(e) = run.save_metrics(&opts.dir) {
            opts.progress.log(&format!("cannot write the metrics: {e}"));
        }
        Error::Diverged { skipped: self.skipped, step: run.step, path: paths::last(&opts.dir) }
    }

    /// Writes a line about the steps since the last line.
    fn log(&mut self, run: &mut RunState<'_>, lr: f64, progress: &dyn Progress) {
        let rate = self.windows_per_sec(run);
        let (recent, steps) = (&self.recent, self.recent_steps);
        let mut text = note(recent, steps, rate);
        if let Some(device) = run.engine.device() {
            write!(text, " on {}, {} MiB", device.name, device.bytes >> 20).ok();
        }
        progress.tick(run.step, run.cfg.steps, &text);
        // If all of them were skipped, there is nothing to report.
        if steps == 0 {
            return;
        }
        let secs = self.begin.elapsed().as_secs_f64();
        let metric = Metric::Line(Line {
            step: run.step,
            loss: mean_loss(recent, steps),
            action_rms_visible: rms(recent, 0),
            action_rms_masked: rms(recent, 1),
            lr,
            grad_norm: self.grad_norm,
            windows_per_sec: rate.round(),
            secs: ((run.spent + secs) * 10.0).round() / 10.0,
        });
        progress.figures(&metric.to_json());
        run.metrics.push(metric);
        (self.recent, self.recent_steps) = (Sums::default(), 0);
    }

    /// Training windows a second of this session.
    fn windows_per_sec(&self, run: &RunState<'_>) -> f64 {
        let secs = self.begin.elapsed().as_secs_f64();
        (run.step - self.first) as f64 * run.cfg.batch as f64 / secs.max(1e-9)
    }

    fn finish(&self, run: &RunState<'_>, opts: &Options<'_>, interrupted: bool) -> Finished {
        Finished {
            step: run.step,
            steps: run.cfg.steps,
            interrupted,
            worsened: false,
            skipped: self.skipped,
            best: run.best,
            linear: run.metrics.linear().map(|l| l.precision),
            held_out: run.metrics.held_out().cloned(),
            secs: self.begin.elapsed().as_secs_f64(),
            windows_per_sec: self.windows_per_sec(run),
            device: run.engine.device().map(|d| d.name),
            model: paths::model(&opts.dir),
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{dataset, options, small};
    use robert_base::exit::{Exit, HasExit};
    use robert_base::progress::{Cancel, Silent};
    use robert_net::checkpoint::OptimiserState;
    use robert_net::engine::{DeviceUse, Fill};
    use robert_net::step::GradientView;
    use robert_net::{CpuEngine, Engine, Net, Setup};

    type Answer<T> = Result<T, robert_net::Error>;

    /// The processor as a card that is gone after some gradients.
    struct Card(CpuEngine, u64);

    impl Engine for Card {
        fn gradient(
            &mut self,
            fill: &Fill<'_>,
            index: u64,
            next: Option<u64>,
        ) -> Answer<GradientView> {
            if self.1 == 0 {
                return Err(robert_net::Error::Lost { device: "card".into(), why: "reset".into() });
            }
            self.1 -= 1;
            self.0.gradient(fill, index, next)
        }
        fn apply(&mut self, lr: f64, view: &GradientView, decay: f64) -> Answer<()> {
            self.0.apply(lr, view, decay)
        }
        fn errors(&mut self, fill: &Fill<'_>, index: u64) -> Answer<Sums> {
            self.0.errors(fill, index)
        }
        fn infer(&mut self, fill: &Fill<'_>, index: u64) -> Answer<Vec<f32>> {
            self.0.infer(fill, index)
        }
        fn swap_average(&mut self) -> Answer<()> {
            self.0.swap_average()
        }
        fn net(&mut self, averaged: bool) -> Answer<Net<f32>> {
            self.0.net(averaged)
        }
        fn state(&mut self) -> Answer<OptimiserState> {
            self.0.state()
        }
        fn restore(&mut self, state: &OptimiserState) -> Answer<()> {
            self.0.restore(state)
        }
        fn device(&self) -> Option<DeviceUse> {
            Some(DeviceUse { name: "card".into(), bytes: 1 << 20, windows: 1 })
        }
    }

    struct Lose {
        survives: bool,
        after: u64,
    }

    impl Engines for Lose {
        fn open(&self, setup: Setup, _: &dyn Progress) -> Answer<Box<dyn Engine>> {
            Ok(Box::new(Card(CpuEngine::new(setup), self.after)))
        }
        fn survives(&self) -> bool {
            self.survives
        }
    }

    #[test]
    fn a_lost_card_costs_the_steps_since_the_checkpoint_and_no_more() {
        let dir = tempfile::tempdir().unwrap();
        let data = dataset(&dir.path().join("data"));
        let cancel = Cancel::default();
        let whole = dir.path().join("whole");
        train(&data, &small(8), options(&whole, 1, &cancel, &Silent)).unwrap();
        let model = |dir: &std::path::Path| std::fs::read(paths::model(dir)).unwrap();
        for (after, checkpoint_secs) in [(0, 1e9), (5, 1e9), (5, 0.0)] {
            // The processor goes on if that was asked for.
            let run = dir.path().join(format!("goes-on-{after}-{checkpoint_secs}"));
            let engines = Lose { survives: true, after };
            let opts = Options {
                engines: Some(&engines),
                checkpoint_secs,
                ..options(&run, 1, &cancel, &Silent)
            };
            let done = train(&data, &small(8), opts).unwrap();
            assert_eq!((done.step, done.device), (8, None));
            assert!(model(&run) == model(&whole), "to the byte that of an undisturbed run");

            // Else the run ends, and can be resumed.
            let run = dir.path().join(format!("ends-{after}-{checkpoint_secs}"));
            let engines = Lose { survives: false, after };
            let opts = Options {
                engines: Some(&engines),
                checkpoint_secs,
                ..options(&run, 1, &cancel, &Silent)
            };
            let e = train(&data, &small(8), opts).unwrap_err();
            assert_eq!(e.exit(), Exit::Failed);
            assert!(e.to_string().contains("card") && e.to_string().contains("--resume"), "{e}");
            train(&data, &small(8), options(&run, 1, &cancel, &Silent)).unwrap();
            assert!(model(&run) == model(&whole));
        }
    }
}
