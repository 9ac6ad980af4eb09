//! Training curves as one chart, written to the run directory during training.

use super::metrics::{Evaluation, HeldOut, Line};
use super::record::Record;
use robert_plot::{Axis, Curve, Dash, Figure, INK, Layer, Mark, Panel};

/// Numbers of hidden frames whose error is drawn over training.
const HIDDEN: [usize; 3] = [0, 4, 16];

/// Four panels: closed-loop Precision by suite, action error, held-out error over training
/// and by hidden frames. `None` before there is anything to draw.
pub fn figure(record: &Record) -> Option<Figure> {
    let mut panels: Vec<Panel> =
        [precision(record), action_error(record), held_out(record), by_hidden(record)]
            .into_iter()
            .flatten()
            .collect();
    // Figures that were never measured (no contact, no masked frame) are left out.
    let drawn = |l: &Layer| !matches!(l, Layer::Line { points, .. } if points.is_empty());
    for panel in &mut panels {
        panel.layers.retain(drawn);
    }
    panels.retain(|p| !p.layers.is_empty());
    if panels.is_empty() {
        return None;
    }
    let columns = if panels.len() > 1 { 2 } else { 1 };
    let c = &record.config;
    let note = format!(
        "{}, {} x {}, {} tokens, skip {}, {} of {} steps of {}, {:.1} min",
        if record.robot.is_empty() { "unknown robot" } else { &record.robot },
        c.layers,
        c.width,
        word(&c.tokens),
        word(&c.skip),
        record.step,
        c.steps,
        c.batch,
        record.secs / 60.0
    );
    let figure = Figure::grid(&record.name, panels, columns).own_legends();
    Some(figure.panel_size(460, 330).note(&note))
}

/// The spelling of a setting in files.
pub(super) fn word(value: &impl serde::Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(s)) => s,
        Ok(other) => other.to_string(),
        Err(_) => String::new(),
    }
}

fn line(name: &str, points: Vec<(f64, f64)>, color: usize, dash: Dash) -> Layer {
    Layer::Line { name: name.to_owned(), points, color, dash }
}

/// Precision over training of several runs, for [`robert_plot::curves`].
pub fn precision_curve(record: &Record) -> Curve {
    let points = record.evaluations.iter().map(|(s, e)| (*s as f64, e.precision)).collect();
    Curve { name: record.name.clone(), points, ci95: Vec::new() }
}

fn precision(record: &Record) -> Option<Panel> {
    let (best, best_found) = record.best()?;
    let suites: Vec<String> = record.tasks().into_iter().filter(|t| !t.contains('/')).collect();
    let mut layers = Vec::new();
    for (color, suite) in suites.iter().enumerate() {
        let at = |(s, e): &(u64, Evaluation)| Some((*s as f64, *e.suites.get(suite)?));
        layers.push(line(
            suite,
            record.evaluations.iter().filter_map(at).collect(),
            color,
            Dash::Solid,
        ));
        let linear = record.linear.as_ref().and_then(|l| l.suites.get(suite));
        if let Some(&y) = linear {
            let end = record.config.steps.max(1) as f64;
            let name = format!("{suite}, linear prediction");
            layers.push(line(&name, vec![(0.0, y), (end, y)], color, Dash::Dotted));
        }
    }
    layers.push(Layer::Marks {
        name: format!("best: {:.5} at step {best}", best_found.precision),
        points: vec![(best as f64, best_found.precision)],
        color: INK,
        mark: Mark::Cross,
    });
    Some(Panel {
        title: "closed loop: Precision, lower is better".into(),
        x: Axis::new("step", ""),
        y: Axis::new("", "rad or m").log(),
        layers,
        equal: false,
    })
}

fn action_error(record: &Record) -> Option<Panel> {
    let of = |f: fn(&Line) -> f64| -> Vec<(f64, f64)> {
        let points = record.lines.iter().map(|l| (l.step as f64, f(l)));
        points.filter(|p| p.1 > 0.0).collect()
    };
    let (visible, masked) = (of(|l| l.action_rms_visible), of(|l| l.action_rms_masked));
    if visible.is_empty() {
        return None;
    }
    Some(Panel {
        title: "action error in training batches, RMS".into(),
        x: Axis::new("step", ""),
        y: Axis::new("", "of full torque").log(),
        layers: vec![
            line("visible frames", visible, 0, Dash::Solid),
            line("masked frames", masked, 1, Dash::Solid),
        ],
        equal: false,
    })
}

fn held_out(record: &Record) -> Option<Panel> {
    let of = |f: &dyn Fn(&HeldOut) -> Option<f64>| -> Vec<(f64, f64)> {
        let points = record.held_out.iter().filter_map(|(s, h)| Some((*s as f64, f(h)?)));
        points.filter(|p| p.1 > 0.0).collect()
    };
    let mut layers = vec![
        line("next known, clear", of(&|h| h.nmse_clear), 0, Dash::Solid),
        line("next known, at a stop", of(&|h| h.nmse_stop), 1, Dash::Solid),
        line("next known, in contact", of(&|h| h.nmse_contact), 2, Dash::Solid),
    ];
    for (i, hidden) in HIDDEN.into_iter().enumerate() {
        let points = of(&|h| h.nmse_by_hidden.get(hidden).copied().flatten());
        layers.push(line(&format!("{hidden} hidden, all places"), points, 3 + i, Dash::Dotted));
    }
    (!record.held_out.is_empty()).then(|| Panel {
        title: "held-out action error, share of variance".into(),
        x: Axis::new("step", ""),
        y: Axis::new("nMSE", "").log(),
        layers,
        equal: false,
    })
}

fn by_hidden(record: &Record) -> Option<Panel> {
    let all = &record.held_out;
    let mut pick: Vec<usize> = vec![0, all.len() / 2, all.len().checked_sub(1)?];
    pick.dedup();
    let one = |(color, &i): (usize, &usize)| {
        let (step, found) = all.get(i)?;
        let points = found.nmse_by_hidden.iter().enumerate();
        let points = points.filter_map(|(k, y)| Some((k as f64, (*y)?))).collect();
        Some(line(&format!("step {step}"), points, color, Dash::Solid))
    };
    Some(Panel {
        title: "held-out action error by hidden frames".into(),
        x: Axis::new("hidden frames before the next goal", ""),
        y: Axis::new("nMSE", "").from_zero(),
        layers: pick.iter().enumerate().filter_map(one).collect(),
        equal: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TrainConfig;
    use crate::metrics::Metric;

    #[test]
    fn only_what_was_measured_is_listed() {
        let held_out = serde_json::json!({
            "nmse_by_hidden": [0.1, 0.2], "nmse_clear": 0.1, "nmse_stop": 0.3,
            "nmse_contact": null, "shares": [0.9, 0.1, 0.0],
        });
        let metrics = [
            serde_json::json!({"step": 5, "held_out": held_out}),
            serde_json::json!({"step": 10, "held_out": held_out}),
        ];
        let metrics = metrics.map(|m| serde_json::from_value::<Metric>(m).unwrap()).to_vec();
        let record = Record::of("a".into(), TrainConfig::default(), &metrics.into());
        let figure = figure(&record).unwrap();
        assert_eq!(figure.panels.len(), 2, "no training line, no evaluation");
        let svg = figure.svg().unwrap();
        assert!(svg.contains("next known, clear") && svg.contains("0 hidden, all places"));
        assert!(!svg.contains("in contact") && !svg.contains("16 hidden"));
    }
}
