//! `metrics.jsonl`: the figures of a run, one JSON object per line.

use robert_base::json;
use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::Error;
use robert_base::{fsio, limits};

/// The result of a closed-loop evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Mean Precision over the suites: lower is better; selects the best checkpoint.
    pub precision: f64,
    /// Precision by suite.
    pub suites: BTreeMap<String, f64>,
}

/// Error of inferred actions on held-out trajectories, as a share of the actions' variance;
/// `None` if no frame was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Error of the action at the current frame, by number of hidden frames before the next visible
    /// one, 0 to 19.
    pub nmse_by_hidden: Vec<Option<f64>>,
    /// Next frame visible, away from stops and contact.
    pub nmse_clear: Option<f64>,
    /// Next frame visible, a joint near a stop, where torque cannot be inferred from positions.
    pub nmse_stop: Option<f64>,
    /// Next frame visible, in self-contact.
    pub nmse_contact: Option<f64>,
    /// Share of frames by place: clear, at a stop, in contact.
    pub shares: [f64; 3],
}

/// A line about training steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Last step that it covers.
    pub step: u64,
    /// Mean loss since the line before.
    pub loss: f64,
    /// Root mean square error of the actions of visible frames.
    pub action_rms_visible: f64,
    /// Root mean square of the actions of masked frames.
    pub action_rms_masked: f64,
    /// Learning rate.
    pub lr: f64,
    /// Norm of the gradient before clipping.
    pub grad_norm: f64,
    /// Windows per second in this session.
    pub windows_per_sec: f64,
    /// Seconds spent in the run so far, all sessions.
    #[serde(default)]
    pub secs: f64,
}

/// One line of the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Metric {
    /// The network performed the evaluator's tasks.
    Evaluation {
        /// Steps done.
        step: u64,
        /// The result.
        evaluation: Evaluation,
    },
    /// The linear prediction alone performed them, before the first step.
    Linear {
        /// Steps done.
        step: u64,
        /// The result.
        linear: Evaluation,
    },
    /// Error on held-out trajectories.
    HeldOut {
        /// Steps done.
        step: u64,
        /// The result.
        held_out: HeldOut,
    },
    /// A step was skipped because its loss or gradient was not finite.
    Skipped {
        /// Steps done.
        step: u64,
        /// Steps skipped so far.
        skipped: u64,
    },
    /// Training steps.
    Line(Line),
    /// A line of another version of the program; it is kept unchanged.
    Other(Map<String, Value>),
}

impl Metric {
    /// Steps done when it was measured.
    pub fn step(&self) -> Option<u64> {
        match self {
            Metric::Evaluation { step, .. }
            | Metric::Linear { step, .. }
            | Metric::HeldOut { step, .. }
            | Metric::Skipped { step, .. }
            | Metric::Line(Line { step, .. }) => Some(*step),
            Metric::Other(line) => line.get("step").and_then(Value::as_u64),
        }
    }

    /// A closed-loop evaluation, of the network or of the linear prediction that it starts from.
    pub fn closed_loop(&self) -> Option<(u64, &Evaluation)> {
        match self {
            Metric::Evaluation { step, evaluation: found }
            | Metric::Linear { step, linear: found } => Some((*step, found)),
            _ => None,
        }
    }

    /// As JSON; its keys are sorted.
    pub fn to_json(&self) -> Value {
        // Plain data of this type always becomes JSON.
        json::value(self)
    }
}

/// All lines of a run, in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metrics(Vec<Metric>);

impl Metrics {
    /// Lines of a file up to a step; a torn last line is dropped. Without a file there are none.
    ///
    /// # Errors
    /// [`Error::Files`].
    pub fn read(path: &Path, step: u64) -> Result<Metrics, Error> {
        if !path.exists() {
            return Ok(Metrics::default());
        }
        let bytes = fsio::read_capped(path, limits::TABLE_BYTES)?;
        let text = String::from_utf8_lossy(&bytes);
        let lines = text.lines().filter_map(|l| serde_json::from_str::<Metric>(l).ok());
        Ok(Metrics(lines.filter(|l| l.step().is_some_and(|s| s <= step)).collect()))
    }

    /// Writes the file atomically.
    ///
    /// # Errors
    /// [`Error::Files`].
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let lines: Vec<String> = self.0.iter().map(|l| l.to_json().to_string()).collect();
        let lines = lines.join("\n") + "\n";
        Ok(fsio::write_atomic(path, lines.as_bytes())?)
    }

    /// Adds a line.
    pub fn push(&mut self, metric: Metric) {
        self.0.push(metric);
    }

    /// Number of lines.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are no lines.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The lines in order.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &Metric> {
        self.0.iter()
    }

    /// Whether a line of this step is one of these.
    pub fn has(&self, step: u64, which: fn(&Metric) -> bool) -> bool {
        self.iter().rev().filter(|m| m.step() == Some(step)).any(which)
    }

    /// Steps skipped so far.
    pub fn skipped(&self) -> u64 {
        let last = |m: &Metric| match m {
            Metric::Skipped { skipped, .. } => Some(*skipped),
            _ => None,
        };
        self.iter().rev().find_map(last).unwrap_or(0)
    }

    /// The evaluation of the linear prediction alone.
    pub fn linear(&self) -> Option<&Evaluation> {
        self.iter().rev().find_map(|m| match m {
            Metric::Linear { linear, .. } => Some(linear),
            _ => None,
        })
    }

    /// The last error on held-out trajectories.
    pub fn held_out(&self) -> Option<&HeldOut> {
        self.iter().rev().find_map(|m| match m {
            Metric::HeldOut { held_out, .. } => Some(held_out),
            _ => None,
        })
    }

    /// Step and Precision of the best closed-loop evaluation; the first among equals.
    pub fn best(&self) -> Option<(u64, f64)> {
        let found = self.iter().filter_map(Metric::closed_loop).map(|(s, e)| (s, e.precision));
        found.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The number of last closed-loop evaluations in a row that were much worse than the best; 0 if the last of them
    /// is clearly better than the others.
    pub fn worse_in_a_row(&self) -> u64 {
        /// Precision beyond this multiple of the best is no noise of a high learning rate.
        const MUCH: f64 = 2.0;
        /// So is a smaller difference between two evaluations.
        const CLEARLY: f64 = 0.9;
        let Some((_, best)) = self.best() else { return 0 };
        let found = self.iter().rev().filter_map(Metric::closed_loop).map(|(_, e)| e.precision);
        let worse: Vec<f64> = found.take_while(|p| *p > MUCH * best).collect();
        let Some((newest, others)) = worse.split_first() else { return 0 };
        let falls = !others.is_empty() && others.iter().all(|p| *newest < CLEARLY * p);
        if falls { 0 } else { worse.len() as u64 }
    }

    /// Step of the last closed-loop evaluation.
    pub fn evaluated(&self) -> Option<u64> {
        self.iter().filter_map(Metric::closed_loop).map(|(step, _)| step).max()
    }

    /// Seconds spent up to the last line about training steps.
    pub fn secs(&self) -> f64 {
        let last = |m: &Metric| match m {
            Metric::Line(line) => Some(line.secs),
            _ => None,
        };
        self.iter().rev().find_map(last).unwrap_or(0.0)
    }
}

impl From<Vec<Metric>> for Metrics {
    fn from(lines: Vec<Metric>) -> Metrics {
        Metrics(lines)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read_and_written_byte_for_byte() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("metrics.jsonl");
        // The format of versions that wrote lines without a type.
        let text = concat!(
            r#"{"linear":{"precision":0.0031,"suites":{"manual":0.002,"manual/a":0.0042}},"step":0}"#,
            "\n",
            r#"{"action_rms_masked":0.2,"action_rms_visible":0.1,"grad_norm":0.5,"loss":0.01,"#,
            r#""lr":0.00007,"secs":12.5,"step":10,"windows_per_sec":700.0}"#,
            "\n",
            r#"{"skipped":1,"step":11}"#,
            "\n",
            r#"{"held_out":{"nmse_by_hidden":[0.1,null],"nmse_clear":0.05,"nmse_contact":null,"#,
            r#""nmse_stop":0.7,"shares":[0.9,0.1,0.0]},"step":20}"#,
            "\n",
            r#"{"evaluation":{"precision":0.002,"suites":{}},"step":20}"#,
            "\n",
            r#"{"of tomorrow":[1,2],"step":21}"#,
            "\n",
        );
        std::fs::write(&path, format!("{text}{{\"step\": 22, \"los")).unwrap();
        let read = Metrics::read(&path, u64::MAX).unwrap();
        assert_eq!((read.len(), read.best(), read.evaluated()), (6, Some((20, 0.002)), Some(20)));
        assert_eq!((read.skipped(), read.secs()), (1, 12.5));
        assert_eq!(read.linear().map(|e| e.precision), Some(0.0031));
        assert_eq!(read.held_out().and_then(|h| h.nmse_stop), Some(0.7));
        assert!(read.has(20, |m| matches!(m, Metric::HeldOut { .. })));
        assert!(!read.has(10, |m| matches!(m, Metric::HeldOut { .. })));
        read.write(&path).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        assert_eq!(Metrics::read(&path, 11).unwrap().len(), 3, "resuming cuts off what lies after");
    }

    #[test]
    fn a_training_that_recovers_does_not_get_worse() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("metrics.jsonl");
        let worse = |precisions: &[f64]| {
            let line = |(i, p): (usize, &f64)| {
                format!(
                    "{{\"evaluation\":{{\"precision\":{p},\"suites\":{{}}}},\"step\":{}}}\n",
                    i + 1
                )
            };
            let text: String = precisions.iter().enumerate().map(line).collect();
            std::fs::write(&path, text).unwrap();
            Metrics::read(&path, u64::MAX).unwrap().worse_in_a_row()
        };
        assert_eq!(worse(&[0.01, 0.012, 0.019]), 0);
        assert_eq!(worse(&[0.01, 0.05, 0.06, 0.055]), 3, "a dip is no recovery");
        assert_eq!(worse(&[0.01, 0.05, 0.04, 0.03]), 0, "it falls");
        assert_eq!(worse(&[0.01, 0.05, 0.005, 0.02]), 1);
    }
}
