//! The results of an evaluation as CSV.

use std::io;

use crate::cli::failure::Outcome;
use crate::rollout::Evaluation;

/// A row for each task and policy.
pub(super) fn rows_csv(results: &[Evaluation]) -> Outcome<Vec<u8>> {
    let mut w = csv::Writer::from_writer(Vec::new());
    let head = [
        "suite",
        "task",
        "policy",
        "uses_model",
        "plant",
        "precision",
        "ci95",
        "floor",
        "excess",
        "moving",
        "gap_path",
        "gap_overshoot",
        "gap_jerk",
        "jams",
        "masked_mae",
        "p95",
        "hold_end",
        "frames_late",
        "mean_abs_du",
        "wall_secs",
        "frames",
        "error",
    ];
    w.write_record(head).map_err(io::Error::other)?;
    let cell = |v: Option<f64>| v.map_or_else(String::new, |v| v.to_string());
    for r in results {
        for t in &r.tasks {
            let ran = !t.is_interrupted();
            w.write_record([
                r.suite.clone(),
                t.name.clone(),
                r.policy.clone(),
                r.uses_model.to_string(),
                r.plant.clone().unwrap_or_default(),
                cell(t.precision),
                cell(t.ci95),
                cell(t.floor),
                cell(t.excess),
                cell(t.moving),
                cell(t.gap.as_ref().and_then(|g| g.path)),
                cell(t.gap.as_ref().and_then(|g| Some(g.overshoot.as_ref()?.value))),
                cell(t.gap.as_ref().and_then(|g| g.jerk)),
                t.jams.as_ref().map_or_else(String::new, |j| j.len().to_string()),
                cell(t.masked_mae),
                cell(t.p95),
                cell(t.hold_end),
                cell(t.frames_late),
                cell(t.mean_abs_du),
                cell(ran.then_some(t.wall_secs)),
                if ran { t.frames.to_string() } else { String::new() },
                t.error.clone().unwrap_or_default(),
            ])
            .map_err(io::Error::other)?;
        }
    }
    Ok(w.into_inner().map_err(|e| io::Error::other(e.to_string()))?)
}

/// A row for each frame that has an error.
pub(super) fn errors_csv(results: &[Evaluation]) -> Outcome<Vec<u8>> {
    let mut w = csv::Writer::from_writer(Vec::new());
    w.write_record(["suite", "task", "policy", "frame", "error"]).map_err(io::Error::other)?;
    for r in results {
        for t in &r.tasks {
            for (frame, error) in t.per_frame.iter().enumerate() {
                let Some(error) = error else { continue };
                w.write_record([
                    &r.suite,
                    &t.name,
                    &r.policy,
                    &frame.to_string(),
                    &error.to_string(),
                ])
                .map_err(io::Error::other)?;
            }
        }
    }
    Ok(w.into_inner().map_err(|e| io::Error::other(e.to_string()))?)
}
