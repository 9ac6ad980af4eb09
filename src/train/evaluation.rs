//! Evaluation during training: error on held-out trajectories, and closed-loop Precision.

use super::metrics::{Evaluation, HeldOut, Metric};
use super::options::Options;
use super::source::Source;
use super::state::RunState;
use super::{Error, curves, paths, record::Record};
use robert_base::progress::Cancel;
use robert_dataset::Windows;
use robert_net::head::{GAPS, Sums};
use robert_net::{Batch, SkipKind};

/// Windows for the held-out error during a run; a twentieth for each number of hidden frames.
const MEASURED: usize = 1_280;
/// Windows for the held-out error at the end, since actions at stops are heavy-tailed.
const MEASURED_AT_END: usize = 5_120;

/// Whether there is an evaluation at the end of this step.
fn due(step: u64, steps: u64, evaluations: u64) -> bool {
    let count = |s: u64| u128::from(s) * u128::from(evaluations) / u128::from(steps.max(1));
    evaluations > 0 && count(step) > count(step - 1)
}

impl RunState<'_> {
    /// Measures and evaluates, if that is due and not done yet. False if a stop was requested
    /// meanwhile; what is left is done when the run continues.
    pub(super) fn evaluate_if_due(
        &mut self,
        source: &Source<'_>,
        held_out: Option<&Windows<'_>>,
        opts: &mut Options<'_>,
    ) -> Result<bool, Error> {
        let cfg = self.cfg;
        if self.step == 0 || !due(self.step, cfg.steps, opts.evaluations) {
            return Ok(true);
        }
        let known = self.metrics.len();
        if let Some(held_out) = held_out
            && !self.metrics.has(self.step, |m| matches!(m, Metric::HeldOut { .. }))
        {
            let count = if self.step == cfg.steps { MEASURED_AT_END } else { MEASURED };
            // A small run gets a short measurement.
            let seen = self.step as usize * cfg.batch;
            let Some(found) = self.measure(source, held_out, count.min(seen), opts.cancel)? else {
                return Ok(false);
            };
            let metric = Metric::HeldOut { step: self.step, held_out: found };
            opts.progress.figures(&metric.to_json());
            self.metrics.push(metric);
        }
        let mut whole = true;
        if !self.metrics.has(self.step, |m| matches!(m, Metric::Evaluation { .. })) {
            whole = self.evaluate(opts)?;
        }
        if self.metrics.len() > known {
            self.draw(opts);
        }
        Ok(whole)
    }

    /// Evaluates the linear prediction alone. It is the baseline and the first candidate for
    /// `best`, since an untrained network with a skip equals it. False if a stop was requested
    /// meanwhile.
    pub(super) fn evaluate_linear(&mut self, opts: &mut Options<'_>) -> Result<bool, Error> {
        let Some(evaluator) = opts.evaluator.as_deref_mut() else { return Ok(true) };
        let known = self.metrics.has(self.step, |m| matches!(m, Metric::Linear { .. }));
        if self.cfg.skip == SkipKind::Off || opts.evaluations == 0 || known {
            return Ok(true);
        }
        let found = evaluator.evaluate_linear(&self.model()?, opts.cancel);
        let found = found.map_err(|why| Error::Evaluation { step: self.step, why })?;
        let Some(found) = found else { return Ok(false) };
        opts.progress.log(&format!("linear prediction: Precision {:.5}", found.precision));
        self.metrics.push(Metric::Linear { step: 0, linear: found.clone() });
        self.note_evaluation(found, &opts.dir)?;
        Ok(true)
    }

    /// Evaluates the network, if there is an evaluator. False if a stop was requested meanwhile.
    fn evaluate(&mut self, opts: &mut Options<'_>) -> Result<bool, Error> {
        let Some(evaluator) = opts.evaluator.as_deref_mut() else { return Ok(true) };
        let found: Result<Option<Evaluation>, String> =
            evaluator.evaluate(&self.model()?, opts.cancel);
        let found = found.map_err(|why| Error::Evaluation { step: self.step, why })?;
        let Some(found) = found else { return Ok(false) };
        let metric = Metric::Evaluation { step: self.step, evaluation: found.clone() };
        opts.progress.figures(&metric.to_json());
        self.metrics.push(metric);
        opts.progress.log(&format!("step {}: Precision {:.5}", self.step, found.precision));
        self.note_evaluation(found, &opts.dir)?;
        Ok(true)
    }

    /// Held-out error; `None` if a stop was requested meanwhile.
    fn measure(
        &mut self,
        source: &Source<'_>,
        held_out: &Windows<'_>,
        windows: usize,
        cancel: &Cancel,
    ) -> Result<Option<HeldOut>, Error> {
        let batch = self.cfg.batch;
        // If there is an average, it is the model that will be used, so it is measured.
        self.engine.swap_average()?;
        let mut sums = Sums::default();
        let rounds = windows.div_ceil(batch);
        let mut done = 0;
        let fill = |round: u64, w: usize, slot: usize, to: &mut Batch<f32>| {
            source.measure(held_out, round * batch as u64 + w as u64, slot, to);
        };
        while done < rounds && !cancel.is_cancelled() {
            sums.add(&self.engine.errors(&fill, done as u64)?);
            done += 1;
        }
        self.engine.swap_average()?;
        if done < rounds {
            return Ok(None);
        }
        let power = self.power.max(1e-12);
        let nmse = |square: f64, count: f64| (count > 0.0).then(|| square / count / power);
        let gaps = sums.gap_square.iter().zip(&sums.gap_windows).take(GAPS - 1);
        let place = |p: usize| nmse(sums.place_square[p], sums.place_tokens[p]);
        let tokens: f64 = sums.place_tokens.iter().sum();
        Ok(Some(HeldOut {
            nmse_by_hidden: gaps.map(|(&s, &n)| nmse(s, n)).collect(),
            nmse_clear: place(0),
            nmse_stop: place(1),
            nmse_contact: place(2),
            shares: sums.place_tokens.map(|n| n / tokens.max(1.0)),
        }))
    }

    /// Draws the curves into the run directory. A chart that cannot be written does not stop the
    /// run.
    fn draw(&self, opts: &Options<'_>) {
        let whole = opts.dir.canonicalize().unwrap_or_else(|_| opts.dir.clone());
        let name = whole.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut record = Record::of(name, self.cfg.clone(), &self.metrics);
        record.robot.clone_from(&self.card.robot.id);
        let Some(figure) = curves::figure(&record) else { return };
        if let Err(e) = figure.save(&paths::curves(&opts.dir)) {
            opts.progress.log(&format!("cannot draw the curves: {e}"));
        }
    }
}
