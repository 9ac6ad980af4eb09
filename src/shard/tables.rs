//! The tables of a merge: rows of an evaluation, means over seeds.

use robert_base::json;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use robert_robot::Robot;
use robert_rollout::mean_ci95;
use robert_train::sweep::{Reached, Sweep, figure, rows};
use serde_json::{Value, json};

use super::error::write_error;
use super::spec::Eval;
use super::{Cell, Error, Manifest, evaluating};

/// Numbers of a row that have means over seeds.
const FIGURES: [&str; 7] =
    ["precision", "moving", "masked_mae", "p95", "hold_end", "frames_late", "mean_abs_du"];

/// The rows of one policy on one suite: tasks in the order of the suite, so that sums have the bits
/// of `robert eval`, and each by seed.
#[derive(Default)]
struct Table {
    rows: Vec<(String, BTreeMap<u64, Value>)>,
    /// Position of each task.
    places: BTreeMap<String, usize>,
}

impl Table {
    fn insert(&mut self, task: String, seed: u64, row: Value) {
        let next = self.rows.len();
        let at = *self.places.entry(task.clone()).or_insert(next);
        if at == next {
            self.rows.push((task, BTreeMap::new()));
        }
        self.rows[at].1.insert(seed, row);
    }
}

/// Writes `rows.csv` (one row for each rollout) and `results.json` (means over seeds), and returns
/// the means.
pub(super) fn evaluation(
    spec: &Eval,
    shards: &[PathBuf],
    manifests: &[Manifest],
    out: &Path,
) -> Result<Value, Error> {
    let path = out.join("rows.csv");
    let mut tables: Vec<((String, String), Table)> = Vec::new();
    let mut csv = csv::Writer::from_writer(Vec::new());
    let head = ["suite", "policy", "task", "seed"];
    let fail = |e: csv::Error| write_error(&path)(io::Error::other(e));
    csv.write_record(head.iter().chain(&FIGURES).chain(&["frames", "error"])).map_err(fail)?;
    for (shard, manifest) in shards.iter().zip(manifests) {
        let Cell::Eval { suite, policy, seed, .. } = &manifest.cell else { continue };
        let broken = |why| Error::Plan { why, path: shard.clone() };
        let bytes = manifest.file(shard, evaluating::ROWS).map_err(broken)?;
        let rows: Vec<Value> = serde_json::from_slice(&bytes).map_err(|e| broken(e.to_string()))?;
        let key = (suite.clone(), policy.clone());
        if tables.last().is_none_or(|(k, _)| *k != key) && !tables.iter().any(|(k, _)| *k == key) {
            tables.push((key.clone(), Table::default()));
        }
        let Some((_, table)) = tables.iter_mut().rev().find(|(k, _)| *k == key) else { continue };
        for row in rows {
            let task = text(&row, "name");
            let fixed = [suite.clone(), policy.clone(), task.clone(), seed.to_string()];
            let figures = FIGURES.map(|f| text(&row, f));
            let last = [text(&row, "frames"), text(&row, "error")];
            csv.write_record(fixed.iter().chain(&figures).chain(&last)).map_err(fail)?;
            table.insert(task, *seed, row);
        }
    }
    let bytes =
        csv.into_inner().map_err(|e| write_error(&path)(io::Error::other(e.to_string())))?;
    std::fs::write(&path, bytes).map_err(write_error(&path))?;
    let results: Vec<Value> = tables.iter().map(|(key, table)| summary(key, table)).collect();
    let document = json!({ "spec": spec, "results": results });
    save(&out.join("results.json"), &document)?;
    let short = |r: &Value| json!({ "suite": r["suite"], "policy": r["policy"], "precision_mean": r["precision_mean"], "ci95": r["ci95"] });
    Ok(results.iter().map(short).collect())
}

fn text(row: &Value, field: &str) -> String {
    match row.get(field) {
        None | Some(Value::Null) => String::new(),
        Some(Value::String(s)) => s.clone(),
        Some(other) => other.to_string(),
    }
}

/// One policy on one suite: the mean over tasks with its interval over seeds, and each task.
fn summary((suite, policy): &(String, String), table: &Table) -> Value {
    let number = |row: &Value, field: &str| row.get(field).and_then(Value::as_f64);
    let seeds: Vec<u64> =
        table.rows.first().map(|(_, by)| by.keys().copied().collect()).unwrap_or_default();
    // Each seed gives one mean over the tasks, none if a rollout failed.
    let by_seed: Option<Vec<f64>> = seeds
        .iter()
        .map(|seed| {
            let each: Option<Vec<f64>> =
                table.rows.iter().map(|(_, by)| number(by.get(seed)?, "precision")).collect();
            mean_ci95(&each?).map(|i| i.mean)
        })
        .collect();
    let over = by_seed.and_then(|means| mean_ci95(&means));
    let tasks: Vec<Value> = table
        .rows
        .iter()
        .map(|(name, by)| {
            let mut task = serde_json::Map::new();
            task.insert("name".into(), json!(name));
            for field in FIGURES {
                let each: Option<Vec<f64>> = by.values().map(|r| number(r, field)).collect();
                let Some(interval) = each.and_then(|e| mean_ci95(&e)) else { continue };
                task.insert(field.into(), json!(interval.mean));
                if field == "precision" {
                    task.insert("ci95".into(), json!(interval.ci95));
                }
            }
            let errors: Vec<&Value> = by.values().filter_map(|r| r.get("error")).collect();
            if let Some(error) = errors.first() {
                task.insert("error".into(), (*error).clone());
            }
            Value::Object(task)
        })
        .collect();
    json!({
        "suite": suite,
        "policy": policy,
        "seeds": seeds.len(),
        "precision_mean": over.map(|i| i.mean),
        "ci95": over.and_then(|i| i.ci95),
        "tasks": tasks,
    })
}

/// Writes `results.json` and, for a grid, `sweep.svg`; returns the rows.
pub(super) fn training(sweep: &Sweep, reached: &[Reached], out: &Path) -> Result<Value, Error> {
    let table = rows(&sweep.combinations(), reached);
    let document = json!({ "sweep": sweep, "points": reached, "rows": table });
    save(&out.join("results.json"), &document)?;
    if !sweep.grid.is_empty() {
        let robot = Robot::load(&sweep.robot)?;
        let unit = robot.joints().first().map_or(robert_base::units::Unit::Rad, |j| j.unit);
        if let Some(figure) = figure(sweep, unit, &table) {
            let path = out.join("sweep.svg");
            let svg = figure.svg().map_err(|e| write_error(&path)(io::Error::other(e)))?;
            std::fs::write(&path, svg).map_err(write_error(&path))?;
        }
    }
    Ok(json!(table))
}

fn save(path: &Path, document: &Value) -> Result<(), Error> {
    let text = json::pretty(document) + "\n";
    std::fs::write(path, text).map_err(write_error(path))
}
