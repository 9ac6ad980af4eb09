//! A run as read from its directory: settings, metrics, and the comparison with the linear
//! prediction. `robert runs`, sweeps and charts use it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;

use super::metrics::{Evaluation, HeldOut, Line, Metric, Metrics};
use super::{Error, TrainConfig, paths};
use robert_base::{fsio, limits};
use robert_rollout::runs_near;

/// A whole run.
#[derive(Clone, Debug, Serialize)]
pub struct Record {
    /// Name of its folder.
    pub name: String,
    /// Its folder.
    pub dir: PathBuf,
    /// Robot, if the run recorded it.
    pub robot: String,
    /// Settings.
    pub config: TrainConfig,
    /// Steps done, according to the metrics.
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
    /// [`Error::Run`] if the directory is not a run, [`Error::Files`].
    pub fn read(dir: &Path) -> Result<Self, Error> {
        if !paths::config(dir).exists() {
            let near = runs_near(dir);
            let known = match near.as_slice() {
                [] => String::new(),
                near => format!("; there are {}", near.join(", ")),
            };
            let why = format!("not a run directory (no config.toml){known}");
            return Err(Error::Run { why, path: dir.to_owned() });
        }
        let config = paths::read_config(dir)?;
        let metrics = Metrics::read(&paths::metrics(dir), u64::MAX)?;
        let whole = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
        let name = whole.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut record = Self::of(name, config, &metrics);
        dir.clone_into(&mut record.dir);
        record.robot = robot(dir);
        Ok(record)
    }

    /// From settings and metrics alone.
    pub fn of(name: String, config: TrainConfig, metrics: &Metrics) -> Self {
        let (mut lines, mut evaluations, mut held_out) = (Vec::new(), Vec::new(), Vec::new());
        for metric in metrics.iter() {
            match metric {
                Metric::Line(line) => lines.push(*line),
                Metric::Evaluation { step, evaluation } => {
                    evaluations.push((*step, evaluation.clone()));
                }
                Metric::HeldOut { step, held_out: found } => held_out.push((*step, found.clone())),
                Metric::Linear { .. } | Metric::Skipped { .. } | Metric::Other(_) => {}
            }
        }
        Record {
            name,
            dir: PathBuf::new(),
            robot: String::new(),
            config,
            step: metrics.iter().filter_map(Metric::step).max().unwrap_or(0),
            secs: metrics.secs(),
            evaluations,
            linear: metrics.linear().cloned(),
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

    /// Suites, then tasks, of all evaluations.
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

/// All runs in a folder, by name; other content is skipped.
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

/// The robot's id from meta.json; empty in older runs.
fn robot(dir: &Path) -> String {
    meta(dir).get("robot").and_then(Value::as_str).unwrap_or_default().to_owned()
}

/// The robot and the dataset that a run was begun with: as they were given then, relative to the
/// folder of that time. In older runs the robot is its id. `None`: the run has no such record.
pub fn began_with(dir: &Path) -> Option<(String, PathBuf)> {
    let meta = meta(dir);
    let text = |v: Option<&Value>| v.and_then(Value::as_str).map(str::to_owned);
    let given = meta.get("run").and_then(|run| run.get("robot"));
    let robot = text(given.or_else(|| meta.get("robot")))?;
    Some((robot, text(meta.get("dataset"))?.into()))
}

/// The number of evaluations that a run was begun with; `None` in older runs.
pub fn began_with_evaluations(dir: &Path) -> Option<u64> {
    meta(dir).get("evaluations")?.as_u64()
}

/// Whether a run was begun on a tile unit; `None` in older runs.
pub(super) fn began_with_tiles(dir: &Path) -> Option<bool> {
    meta(dir).get("tiles").and_then(Value::as_bool)
}

/// The processor or card that a run was begun on; `None` in older runs.
pub(super) fn began_on(dir: &Path) -> Option<String> {
    meta(dir).get("device").and_then(Value::as_str).map(str::to_owned)
}

fn meta(dir: &Path) -> Value {
    let bytes = fsio::read_capped(&paths::meta(dir), limits::RUN_BYTES).unwrap_or_default();
    serde_json::from_slice(&bytes).unwrap_or_default()
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
        let lines = [
            serde_json::json!({"step": 0, "linear": evaluation(0.3)}),
            line(5),
            serde_json::json!({"step": 5, "evaluation": evaluation(0.2)}),
            line(10),
            serde_json::json!({"step": 10, "evaluation": evaluation(0.4)}),
            serde_json::json!({"torn": true}),
        ];
        let metrics = |lines: &[Value]| {
            let of = |l: &Value| serde_json::from_value::<Metric>(l.clone()).unwrap();
            Metrics::from(lines.iter().map(of).collect::<Vec<_>>())
        };
        let r = Record::of("a".into(), TrainConfig::default(), &metrics(&lines));
        assert_eq!((r.step, r.secs, r.lines.len()), (10, 20.0, 2));
        assert_eq!(r.best().map(|(s, e)| (s, e.precision)), Some((5, 0.2)));
        assert_eq!(r.last().map(|(s, e)| (s, e.precision)), Some((10, 0.4)));
        assert!(r.worse_than_linear());
        // The linear prediction is the best if no step improved on it.
        let worse = Record::of(
            "b".into(),
            TrainConfig::default(),
            &metrics(&[
                serde_json::json!({"step": 0, "linear": evaluation(0.3)}),
                serde_json::json!({"step": 5, "evaluation": evaluation(0.31)}),
            ]),
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
