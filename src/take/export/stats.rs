//! Statistics of a feature, by the names that LeRobot gives them.

use serde_json::{Value, json};

/// Statistics of each column of a feature.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stats {
    /// Name and one number for each column.
    pub rows: Vec<(&'static str, Vec<f64>)>,
    /// Rows that were counted.
    pub count: usize,
}

/// Quantiles and their names.
const QUANTILES: [(&str, f64); 5] =
    [("q01", 0.01), ("q10", 0.10), ("q50", 0.50), ("q90", 0.90), ("q99", 0.99)];

impl Stats {
    /// Statistics of rows with `width` columns.
    pub(super) fn of(values: &[f64], width: usize) -> Stats {
        let count = values.len() / width;
        let mut rows: Vec<(&'static str, Vec<f64>)> = ["min", "max", "mean", "std"]
            .into_iter()
            .chain(QUANTILES.iter().map(|(name, _)| *name))
            .map(|name| (name, Vec::with_capacity(width)))
            .collect();
        for column in 0..width {
            let mut sorted: Vec<f64> = values.iter().skip(column).step_by(width).copied().collect();
            sorted.sort_by(f64::total_cmp);
            let mean = sorted.iter().sum::<f64>() / count as f64;
            let square = sorted.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count as f64;
            let head = [sorted[0], sorted[count - 1], mean, square.sqrt()];
            let quantiles = QUANTILES.iter().map(|(_, q)| quantile(&sorted, *q));
            for ((_, row), value) in rows.iter_mut().zip(head.into_iter().chain(quantiles)) {
                row.push(value);
            }
        }
        Stats { rows, count }
    }

    /// Statistics of picture channels, in 0 to 1; each number is in a list of shape (1, 1).
    pub(super) fn json(&self, picture: bool) -> Value {
        let mut out = serde_json::Map::new();
        for (name, row) in &self.rows {
            let value =
                if picture { row.iter().map(|v| json!([[v]])).collect() } else { json!(row) };
            out.insert((*name).to_owned(), value);
        }
        out.insert("count".to_owned(), json!([self.count]));
        Value::Object(out)
    }
}

/// Interpolated between the two nearest values, as numpy does by default.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let at = q * (sorted.len() - 1) as f64;
    let (low, share) = (at.floor() as usize, at.fract());
    let next = sorted[(low + 1).min(sorted.len() - 1)];
    sorted[low] + share * (next - sorted[low])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_those_of_numpy() {
        // numpy.quantile(range(11), [.01, .1, .5, .9, .99]) and a column of ones beside it.
        let values: Vec<f64> = (0..11).flat_map(|v| [f64::from(v), 1.0]).collect();
        let stats = Stats::of(&values, 2);
        let column: Vec<f64> = stats.rows.iter().map(|(_, r)| r[0]).collect();
        let want = [0.0, 10.0, 5.0, 10.0_f64.sqrt(), 0.1, 1.0, 5.0, 9.0, 9.9];
        assert!(column.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-12), "{column:?}");
        assert!(stats.rows.iter().all(|(n, r)| r[1] == if *n == "std" { 0.0 } else { 1.0 }));
        assert_eq!(stats.json(false)["count"][0], 11);
        assert_eq!(stats.json(true)["max"][0][0][0], 10.0);
    }
}
