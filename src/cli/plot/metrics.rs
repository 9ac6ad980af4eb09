//! Charts over training steps, from metrics.jsonl files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::cli::failure::{Failure, Outcome};
use crate::cli::input;
use crate::limits;
use crate::plot::{Axis, Curve, Figure, curves};

/// The field `y` over the field `x`; files with the same name become a mean with its 95 % interval.
pub(super) fn curve_chart(
    files: Vec<(String, PathBuf)>,
    x: &str,
    y: &str,
    axis: Axis,
    title: &str,
) -> Outcome<Figure> {
    let mut runs: BTreeMap<String, Vec<Vec<(f64, f64)>>> = BTreeMap::new();
    for (name, path) in files {
        runs.entry(name).or_default().push(series(&path, x, y)?);
    }
    let lines: Vec<Curve> = runs.into_iter().map(|(name, runs)| mean(name, &runs)).collect();
    Ok(curves(title, &lines, Axis::new(x, ""), axis))
}

/// The values of two fields in a file of JSON lines. Lines that lack one of them are other events.
fn series(path: &Path, x: &str, y: &str) -> Outcome<Vec<(f64, f64)>> {
    let bytes = input::read(path, limits::TABLE_BYTES)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut points = Vec::new();
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let value: serde_json::Value = serde_json::from_str(line)
            .map_err(|e| Failure::invalid(format!("{}:{}: {e}", path.display(), i + 1)))?;
        let field = |k: &str| value.get(k).and_then(serde_json::Value::as_f64);
        if let (Some(x), Some(y)) = (field(x), field(y)) {
            points.push((x, y));
        }
    }
    if points.is_empty() {
        return Err(Failure::invalid(format!("{}: no line has {x:?} and {y:?}", path.display())));
    }
    Ok(points)
}

/// Combines runs of one name into their mean at common x, with its interval.
fn mean(name: String, runs: &[Vec<(f64, f64)>]) -> Curve {
    if let [only] = runs {
        return Curve { name, points: only.clone(), ci95: Vec::new() };
    }
    let mut at: BTreeMap<u64, (f64, Vec<f64>)> = BTreeMap::new();
    for (x, y) in runs.iter().flatten().filter(|p| p.0 >= 0.0) {
        // Bits of a positive number sort as the number does.
        at.entry(x.to_bits()).or_insert_with(|| (*x, Vec::new())).1.push(*y);
    }
    let (mut points, mut ci95) = (Vec::new(), Vec::new());
    for (x, ys) in at.into_values().filter(|(_, ys)| ys.len() == runs.len()) {
        if let Some(i) = crate::rollout::mean_ci95(&ys) {
            points.push((x, i.mean));
            ci95.push(i.ci95.unwrap_or(0.0));
        }
    }
    Curve { name, points, ci95 }
}
