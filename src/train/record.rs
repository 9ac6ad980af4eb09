//! A run as its directory tells it: settings, metrics, how it stands against the linear
//! answer. What `robert runs`, sweeps and the pictures read.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::run::{Evaluation, HeldOut, paths, read_config};
use super::{Error, TrainConfig};
use crate::fsio;

/// Bytes of a metrics file.
const METRICS_BYTES: u64 = 256 << 20;
/// Bytes of a meta file.
const META_BYTES: u64 = 1 << 20;

/// A line about training steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Last step that it covers.
    pub step: u64,
    /// Mean loss since the line before.
    pub loss: f64,
    /// Root mean square error of the actions of visible frames.
    pub action_rms_visible: f64,
    /// Of masked frames.
    pub action_rms_masked: f64,
    /// Learning rate.
    pub lr: f64,
    /// Norm of the gradient before clipping.
    pub grad_norm: f64,
    /// Windows a second of the session.
    pub windows_per_sec: f64,
    /// Seconds spent in the run up to here, all sessions.
    #[serde(default)]
    pub secs: f64,
}

/// A whole run.
#[derive(Clone, Debug, Serialize)]
pub struct Record {
    /// Name of its folder.
    pub name: String,
    /// Its folder.
    pub dir: PathBuf,
    /// Robot, where the run wrote it down.
    pub robot: String,
    /// Settings.
    pub config: TrainConfig,
    /// Steps done, as far as the metrics know.
    pub step: u64,
    /// Seconds spent, all sessions.
    pub secs: f64,
    /// Closed-loop evaluations by step.
    pub evaluations: Vec<(u64, Evaluation)>,
    /// The linear prediction alone, on the same tasks.
    pub linear: Option<Evaluation>,
    /// Held-out action errors by step.
    pub held_out: Vec<(u64, HeldOut)>,
    /// Training lines.
    #[serde(skip)]
    pub lines: Vec<Line>,
}

impl Record {
    /// Reads a run directory.
    ///
    /// # Errors
    /// [`Error::Run`] when it is none, [`Error::Files`].
    pub fn read(dir: &Path) -> Result<Self, Error> {
        if !paths::config(dir).exists() {
            let why = "no run directory (no config.toml)".to_owned();
            return Err(Error::Run { why, path: dir.to_owned() });
        }
        let config = read_config(dir)?;
        let metrics = read_metrics(&paths::metrics(dir), u64::MAX)?;
        let whole = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
        let name = whole.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut record = Self::of(name, config, &metrics);
        dir.clone_into(&mut record.dir);
        record.robot = robot(dir);
        Ok(record)
    }

    /// From settings and metrics alone.
    pub fn of(name: String, config: TrainConfig, metrics: &[Value]) -> Self {
        let (mut lines, mut evaluations, mut held_out) = (Vec::new(), Vec::new(), Vec::new());
        let mut linear = None;
        for value in metrics {
            let step = step_of(value).unwrap_or(0);
            if let Ok(line) = Line::deserialize(value) {
                lines.push(line);
            }
            if let Some(found) =
                value.get("evaluation").and_then(|e| Evaluation::deserialize(e).ok())
            {
                evaluations.push((step, found));
            }
            if let Some(found) = value.get("held_out").and_then(|h| HeldOut::deserialize(h).ok()) {
                held_out.push((step, found));
            }
            if let Some(found) = value.get("linear").and_then(|e| Evaluation::deserialize(e).ok()) {
                linear = Some(found);
            }
        }
        Record {
            name,
            dir: PathBuf::new(),
            robot: String::new(),
            config,
            step: metrics.iter().filter_map(step_of).max().unwrap_or(0),
            secs: lines.last().map_or(0.0, |l: &Line| l.secs),
            evaluations,
            linear,
            held_out,
            lines,
        }
    }

    /// The evaluation with the lowest Precision: the checkpoint `best`. The linear prediction is
    /// the untrained network, step 0.
    pub fn best(&self) -> Option<(u64, &Evaluation)> {
        let start = self.linear.iter().map(|e| (0, e));
        let all = start.chain(self.evaluations.iter().map(|(s, e)| (*s, e)));
        all.min_by(|a, b| a.1.precision.total_cmp(&b.1.precision))
    }

    /// The last evaluation.
    pub fn last(&self) -> Option<(u64, &Evaluation)> {
        self.evaluations.last().map(|(s, e)| (*s, e))
    }

    /// The last held-out measurement.
    pub fn held_out(&self) -> Option<&HeldOut> {
        self.held_out.last().map(|(_, h)| h)
    }

    /// Windows a second over the whole run.
    pub fn windows_per_sec(&self) -> f64 {
        self.lines.last().map_or(0.0, |l| l.windows_per_sec)
    }

    /// Suites, then tasks, that any evaluation names.
    pub fn tasks(&self) -> Vec<String> {
        let all = self.evaluations.iter().map(|(_, e)| e).chain(&self.linear);
        let names: BTreeSet<(bool, &String)> =
            all.flat_map(|e| e.suites.keys()).map(|n| (n.contains('/'), n)).collect();
        names.into_iter().map(|(_, n)| n.clone()).collect()
    }

    /// Whether training made the policy worse than the linear prediction it started from.
    pub fn worse_than_linear(&self) -> bool {
        match (&self.linear, self.last()) {
            (Some(linear), Some((_, last))) => last.precision > linear.precision,
            _ => false,
        }
    }
}

/// All runs inside a folder, by name; what is no run is passed over.
///
/// # Errors
/// [`Error::Files`] when the folder cannot be read.
pub fn runs_in(dir: &Path) -> Result<Vec<Record>, Error> {
    let unreadable = |source| fsio::Error::Read { source, path: dir.to_owned() };
    let mut folders = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if paths::config(&path).exists() {
            folders.push(path);
        }
    }
    folders.sort();
    Ok(folders.iter().filter_map(|f| Record::read(f).ok()).collect())
}

/// The robot's id out of meta.json; empty in runs of before it was kept.
fn robot(dir: &Path) -> String {
    meta(dir).get("robot").and_then(Value::as_str).unwrap_or_default().to_owned()
}

/// Whether a run was begun on a tile unit; none in runs of before that was kept.
pub(super) fn began_with_tiles(dir: &Path) -> Option<bool> {
    meta(dir).get("tiles").and_then(Value::as_bool)
}

fn meta(dir: &Path) -> Value {
    let bytes = fsio::read_capped(&dir.join("meta.json"), META_BYTES).unwrap_or_default();
    serde_json::from_slice(&bytes).unwrap_or_default()
}

fn step_of(line: &Value) -> Option<u64> {
    line.get("step").and_then(Value::as_u64)
}

/// Lines of a run up to a step; a torn last line is dropped.
pub(super) fn read_metrics(path: &Path, step: u64) -> Result<Vec<Value>, Error> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let bytes = fsio::read_capped(path, METRICS_BYTES)?;
    let text = String::from_utf8_lossy(&bytes);
    let lines = text.lines().filter_map(|l| serde_json::from_str::<Value>(l).ok());
    Ok(lines.filter(|l| step_of(l).is_some_and(|s| s <= step)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evaluation(precision: f64) -> Value {
        serde_json::json!({"precision": precision, "suites": {"manual": precision, "manual/a": 1.0}})
    }

    #[test]
    fn a_record_knows_best_last_and_the_linear_answer() {
        let line = |step: u64| {
            serde_json::json!({
                "step": step, "loss": 0.1, "action_rms_visible": 0.1, "action_rms_masked": 0.2,
                "lr": 1e-3, "grad_norm": 0.5, "windows_per_sec": 700.0, "secs": 2.0 * step as f64,
            })
        };
        let metrics = [
            serde_json::json!({"step": 0, "linear": evaluation(0.3)}),
            line(5),
            serde_json::json!({"step": 5, "evaluation": evaluation(0.2)}),
            line(10),
            serde_json::json!({"step": 10, "evaluation": evaluation(0.4)}),
            serde_json::json!({"torn": true}),
        ];
        let r = Record::of("a".into(), TrainConfig::default(), &metrics);
        assert_eq!((r.step, r.secs, r.lines.len()), (10, 20.0, 2));
        assert_eq!(r.best().map(|(s, e)| (s, e.precision)), Some((5, 0.2)));
        assert_eq!(r.last().map(|(s, e)| (s, e.precision)), Some((10, 0.4)));
        assert!(r.worse_than_linear());
        // What no step improved on is the best there is.
        let worse = Record::of(
            "b".into(),
            TrainConfig::default(),
            &[
                serde_json::json!({"step": 0, "linear": evaluation(0.3)}),
                serde_json::json!({"step": 5, "evaluation": evaluation(0.31)}),
            ],
        );
        assert_eq!(worse.best().map(|(s, e)| (s, e.precision)), Some((0, 0.3)));
        assert_eq!(r.tasks(), ["manual", "manual/a"]);
    }

    #[test]
    fn a_folder_that_is_no_run_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let e = Record::read(dir.path()).unwrap_err().to_string();
        assert!(e.contains("config.toml") && e.contains(&dir.path().display().to_string()), "{e}");
        assert!(runs_in(dir.path()).unwrap().is_empty());
    }
}
