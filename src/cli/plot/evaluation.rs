//! Charts of evaluations: bars with 95 % intervals.

use std::path::Path;

use crate::cli::failure::{Failure, Outcome};
use crate::cli::input;
use crate::limits;
use crate::plot::{Axis, Figure, Panel, bars};

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct BarFile {
    #[serde(default)]
    unit: String,
    #[serde(default)]
    label: String,
    groups: Vec<String>,
    sets: Vec<BarSet>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct BarSet {
    name: String,
    mean: Vec<Option<f64>>,
    #[serde(default)]
    ci95: Vec<Option<f64>>,
}

/// The part of `robert eval --json` that is read.
#[derive(serde::Deserialize)]
struct EvalFile {
    unit: String,
    #[serde(default)]
    interrupted: bool,
    results: Vec<EvalResult>,
}

#[derive(serde::Deserialize)]
struct EvalResult {
    policy: String,
    suite: String,
    precision_mean: Option<f64>,
    ci95: Option<f64>,
    tasks: Vec<EvalTask>,
}

#[derive(serde::Deserialize)]
struct EvalTask {
    name: String,
    precision: Option<f64>,
    ci95: Option<f64>,
}

impl EvalFile {
    /// Tasks and their mean as groups, policies as sets.
    fn bars(&self, path: &Path, suite: Option<&str>) -> Outcome<BarFile> {
        let wanted = suite.or(self.results.first().map(|r| r.suite.as_str())).unwrap_or_default();
        let results: Vec<&EvalResult> = self.results.iter().filter(|r| r.suite == wanted).collect();
        let Some(first) = results.first() else {
            let mut known: Vec<&str> = self.results.iter().map(|r| r.suite.as_str()).collect();
            known.dedup();
            return Err(Failure::invalid(format!(
                "{}: no suite {wanted:?}; there are: {}",
                path.display(),
                known.join(", ")
            )));
        };
        let mut groups: Vec<String> = first.tasks.iter().map(|t| t.name.clone()).collect();
        groups.push("mean".to_owned());
        let sets = results
            .iter()
            .map(|r| BarSet {
                name: r.policy.clone(),
                mean: r.tasks.iter().map(|t| t.precision).chain([r.precision_mean]).collect(),
                ci95: r.tasks.iter().map(|t| t.ci95).chain([r.ci95]).collect(),
            })
            .collect();
        let label = if self.interrupted { "Precision (interrupted)" } else { "Precision" };
        Ok(BarFile { unit: self.unit.clone(), label: label.to_owned(), groups, sets })
    }
}

pub(super) fn bar_chart(path: &Path, suite: Option<&str>, title: &str) -> Outcome<Figure> {
    let bytes = input::read(path, limits::TABLE_BYTES)?;
    let bad = |e: serde_json::Error| {
        Failure::invalid(format!("{}:{}:{}: {e}", path.display(), e.line(), e.column()))
    };
    let value: serde_json::Value = serde_json::from_slice(&bytes).map_err(bad)?;
    let file: BarFile = if value.get("results").is_some() {
        serde_json::from_slice::<EvalFile>(&bytes).map_err(bad)?.bars(path, suite)?
    } else {
        serde_json::from_slice(&bytes).map_err(bad)?
    };
    file.check(path)?;
    Ok(file.figure(title))
}

impl BarFile {
    /// Refuses a file whose chart would be misleading.
    fn check(&self, path: &Path) -> Outcome {
        let bad = |why: String| Err(Failure::invalid(format!("{}: {why}", path.display())));
        if self.groups.is_empty() || self.sets.is_empty() {
            return bad("there is nothing to draw: no groups or no sets".to_owned());
        }
        let groups = self.groups.len();
        for s in &self.sets {
            if s.mean.len() != groups || !(s.ci95.is_empty() || s.ci95.len() == groups) {
                return bad(format!(
                    "set {:?} has {} means and {} intervals for {groups} groups",
                    s.name,
                    s.mean.len(),
                    s.ci95.len()
                ));
            }
        }
        Ok(())
    }

    fn figure(self, title: &str) -> Figure {
        let file = self;
        let set = |s: BarSet| {
            let values = (0..file.groups.len())
                .map(|i| {
                    let at = |v: &[Option<f64>]| v.get(i).copied().flatten();
                    (at(&s.mean).unwrap_or(f64::NAN), at(&s.ci95).unwrap_or(0.0))
                })
                .collect();
            (s.name, values)
        };
        let sets: Vec<_> = file.sets.into_iter().map(set).collect();
        let label = if file.label.is_empty() { "precision" } else { &file.label };
        bars(title, &file.groups, &sets, Axis::new(label, &file.unit))
    }
}

/// Every suite of an evaluation as bars with 95 % intervals; `report` as `robert eval --json`
/// prints it.
pub(in crate::cli) fn of_evaluation(title: &str, report: serde_json::Value) -> Outcome<Figure> {
    let file: EvalFile = serde_json::from_value(report).map_err(std::io::Error::other)?;
    let mut suites: Vec<&str> = file.results.iter().map(|r| r.suite.as_str()).collect();
    suites.dedup();
    let several = suites.len() > 1;
    let (mut panels, mut size) = (Vec::new(), (0, 0));
    for suite in suites {
        let figure = file.bars(Path::new("the evaluation"), Some(suite))?.figure("");
        size = (size.0.max(figure.panel.0), size.1.max(figure.panel.1));
        let name = if several { suite } else { "" };
        panels.extend(figure.panels.into_iter().map(|p| Panel { title: name.to_owned(), ..p }));
    }
    Ok(Figure::grid(title, panels, 1).panel_size(size.0, size.1))
}
