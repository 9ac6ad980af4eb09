//! The training loop: sample, step, log, evaluate, checkpoint.
//!
//! There is no generator state: batch, masks and schedule are functions of seed and step, so
//! weights, moments and the step number are the whole state. A run that is killed anywhere ends
//! with the same bits as one that is not, and two costly kinds of bugs of other trainers (data
//! order and generator state) cannot occur.

use std::time::Instant;

use super::metrics::{Line, Metric};
use super::options::{Finished, Options};
use super::source::{BatchSampler, Source};
use super::state::RunState;
use super::{Error, TrainConfig, hindsight, paths};
use robert_base::progress::Progress;
use robert_dataset::{Dataset, Part, Windows};
use robert_net::WINDOW;
use robert_net::head::Sums;

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
    let mut run = RunState::open(data, cfg, &opts)?;
    let (mut interrupted, mut worsened) = (false, false);
    if run.step == 0 {
        interrupted = !run.evaluate_linear(&mut opts)?;
        // There is a valid checkpoint from the first step on.
        run.save(&opts.dir)?;
    }
    let encoder = run.encoder.clone();
    let source = Source::new(data, &encoder, cfg);
    let windows = Windows::new(data, WINDOW, Part::Train, cfg.seed)?;
    let held_out = Windows::new(data, WINDOW, Part::Test, cfg.seed).ok();
    let mut session = Session::new(&run);
    // An evaluation that was interrupted by a stop is repeated.
    interrupted |= !run.evaluate_if_due(&source, held_out.as_ref(), &mut opts)?;

    // A round of steps learns from the data and from the motion of earlier rounds.
    'rounds: for round in 0..=cfg.self_correct {
        let end = cfg.steps * (round + 1) / (cfg.self_correct + 1);
        if interrupted {
            break;
        }
        if run.step >= end && round < cfg.self_correct {
            continue;
        }
        if round > 0 && !run.perform(data, round, &mut opts)? {
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
            let view = run.gradient(&sampler);
            if view.is_finite() {
                // Only weights whose next step is known to be finite are kept.
                let stop = opts.cancel.is_cancelled();
                if stop || session.saved.0.elapsed().as_secs_f64() >= opts.checkpoint_secs {
                    session.checkpoint(&mut run, &opts)?;
                }
                if stop {
                    interrupted = true;
                    break 'rounds;
                }
                run.learner.apply(lr, &view);
                run.step += 1;
                run.average(cfg.average);
                session.recent.add(&view.sums);
                session.recent_steps += 1;
                session.grad_norm = view.grad_norm;
            } else {
                run.step += 1;
                session.skip(&mut run, &opts)?;
            }
            if run.step.is_multiple_of((cfg.steps / LINES).max(1)) || run.step == cfg.steps {
                session.log(&mut run, lr, opts.progress);
            }
            interrupted |= !run.evaluate_if_due(&source, held_out.as_ref(), &mut opts)?;
            if opts.patience > 0 && run.metrics.worse_in_a_row() >= opts.patience {
                let text =
                    format!("step {}: the closed loop gets worse; the best is kept", run.step);
                opts.progress.log(&text);
                worsened = true;
                session.checkpoint(&mut run, &opts)?;
                break 'rounds;
            }
        }
        if run.step > session.saved.1 && !run.gradient(&sampler).is_finite() {
            return Err(session.diverged(&run, &opts));
        }
        session.checkpoint(&mut run, &opts)?;
    }
    Ok(Finished { worsened, ..session.finish(&run, &opts, interrupted) })
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

    /// A line about the steps since the last one.
    fn log(&mut self, run: &mut RunState<'_>, lr: f64, progress: &dyn Progress) {
        let rate = self.windows_per_sec(run);
        let (recent, steps) = (&self.recent, self.recent_steps);
        progress.tick(run.step, run.cfg.steps, &note(recent, steps, rate));
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
