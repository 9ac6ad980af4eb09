//! The rows of a sweep's table.

use std::collections::BTreeMap;

use serde::Serialize;

use super::reached::Reached;
use super::value::Combination;
use robert_rollout::{Interval, mean_ci95};

/// One row of the table: a combination, all seeds.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Values.
    pub values: Combination,
    /// Seeds that are done.
    pub seeds: usize,
    /// Mean and 95 % interval over seeds by suite; `None` if a rollout diverged.
    pub suites: BTreeMap<String, Option<Interval>>,
    /// Mean and 95 % interval over seeds of the held-out action error; `None` if it was not
    /// measured.
    pub nmse_clear: Option<Interval>,
}

/// One row for each combination with a result, in the order of `combinations`.
pub fn rows(combinations: &[Combination], found: &[Reached]) -> Vec<Row> {
    let row = |values: &Combination| {
        let mine: Vec<&Reached> = found.iter().filter(|r| r.values == *values).collect();
        let names: Vec<&String> = mine.first().map_or_else(Vec::new, |r| r.suites.keys().collect());
        let over = |of: &dyn Fn(&Reached) -> Option<f64>| {
            let samples: Option<Vec<f64>> = mine.iter().map(|r| of(r)).collect();
            mean_ci95(&samples?)
        };
        let suites = names
            .iter()
            .map(|&n| (n.clone(), over(&|r| r.suites.get(n).copied().flatten())))
            .collect();
        let nmse_clear = over(&|r| r.nmse_clear);
        Row { values: values.clone(), seeds: mine.len(), suites, nmse_clear }
    };
    combinations.iter().map(row).filter(|r| r.seeds > 0).collect()
}
