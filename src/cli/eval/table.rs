//! The results of a suite as a table.

use std::fmt::Write as _;

use crate::cli::{motion, out};
use crate::robot::{PlantRange, Robot};
use crate::rollout::{CaseResult, Evaluation, mean_ci95};

/// Tasks as rows, policies as columns.
pub(super) fn table(
    robot: &Robot,
    suite: &str,
    plant: PlantRange,
    results: &[Evaluation],
) -> String {
    let columns: Vec<&Evaluation> = results.iter().filter(|r| r.suite == suite).collect();
    let unit = motion::unit(robot);
    let mut header = vec!["task".to_owned()];
    header.extend(
        columns.iter().map(|c| format!("{}{}", c.policy, if c.uses_model { " (m)" } else { "" })),
    );
    let floors: Vec<Option<f64>> =
        columns.first().map(|c| c.tasks.iter().map(|t| t.floor).collect()).unwrap_or_default();
    let has_floor = floors.iter().any(Option::is_some);
    header.extend(has_floor.then(|| "floor".to_owned()));
    let mut t = out::table(&header.iter().map(String::as_str).collect::<Vec<_>>());
    // What was interrupted did not fail.
    let word = |interrupted: bool| if interrupted { "-" } else { "failed" };
    let rows = columns.first().map_or(0, |c| c.tasks.len());
    for row in 0..rows {
        let values: Vec<Option<f64>> =
            columns.iter().map(|c| c.tasks.get(row).and_then(|t| t.precision)).collect();
        let cis: Vec<Option<f64>> =
            columns.iter().map(|c| c.tasks.get(row).and_then(|t| t.ci95)).collect();
        let name = columns.first().and_then(|c| c.tasks.get(row)).map_or("", |t| t.name.as_str());
        let floor = has_floor.then(|| floors.get(row).copied().flatten().map_or("-".into(), short));
        let interrupted =
            |c: &&Evaluation| c.tasks.get(row).is_some_and(CaseResult::is_interrupted);
        let missing: Vec<&str> = columns.iter().map(|c| word(interrupted(c))).collect();
        t.add_row(cells(name, &values, &cis, &missing).into_iter().chain(floor));
    }
    let means: Vec<Option<f64>> = columns.iter().map(|c| c.precision_mean).collect();
    let cis: Vec<Option<f64>> = columns.iter().map(|c| c.ci95).collect();
    let interrupted = |c: &&Evaluation| c.tasks.iter().any(CaseResult::is_interrupted);
    let missing: Vec<&str> = columns.iter().map(|c| word(interrupted(c))).collect();
    t.add_row(cells("mean", &means, &cis, &missing));
    // Figures of some tasks only cannot stand beside those of all.
    let is_whole = |c: &Evaluation| c.tasks.iter().all(|t| t.error.is_none());
    for (name, figure) in FIGURES {
        let cells: Vec<Option<String>> =
            columns.iter().map(|c| figure(c).filter(|_| is_whole(c))).collect();
        if cells.iter().any(Option::is_some) {
            let cells = cells.into_iter().map(|c| c.unwrap_or_else(|| "-".to_owned()));
            t.add_row(std::iter::once(name.to_owned()).chain(cells));
        }
    }
    let ms_per_frame = |t: &CaseResult| Some(1e3 * t.wall_secs / t.frames.max(1) as f64);
    let averages: [(&str, TaskFigure); 2] =
        [("mean |du|", |t| t.mean_abs_du), ("ms per frame", ms_per_frame)];
    for (name, figure) in averages {
        let cells = columns.iter().map(|c| average(c, figure).filter(|_| is_whole(c)));
        let cells = cells.map(|v| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.3}")));
        t.add_row(std::iter::once(name.to_owned()).chain(cells));
    }
    out::right(&mut t, 1);
    let plant =
        if plant == PlantRange::default() { String::new() } else { format!(", plant {plant}") };
    let mut text = format!(
        "{} {suite}: Precision in {unit} (mean |error| over unmasked frames; lower is better){plant}\n{t}\n* best in the row",
        robot.id()
    );
    if columns.iter().any(|c| c.uses_model) {
        text.push_str("; (m) uses a model of the robot");
    }
    if has_floor {
        text.push_str("; floor: iLQR, which knows the model");
    }
    if columns.iter().any(|c| c.tasks.iter().any(|t| t.gap.is_some())) {
        text.push_str(
            "\ngaps: mean (worst); path relative to the straight line, jerk relative to the minimum, overshoot beyond its allowance",
        );
    }
    for c in &columns {
        for task in &c.tasks {
            if let Some(e) = task.error.as_ref().filter(|_| !task.is_interrupted()) {
                write!(text, "\n{} {}: {e}", c.policy, task.name).ok();
            }
        }
    }
    text
}

/// A figure of a policy that is printed below its Precisions; `None` if it was not measured.
type PolicyFigure = fn(&Evaluation) -> Option<String>;

/// A figure of a task.
type TaskFigure = fn(&CaseResult) -> Option<f64>;

const FIGURES: [(&str, PolicyFigure); 7] = [
    ("over the floor", |e| e.excess_mean.map(|x| format!("{:+.0} %", 100.0 * x))),
    ("moving", |e| mean_of(e, |t| t.moving).map(short)),
    ("gap path", |e| {
        let worst = worst_of(e, |t| t.gap.as_ref()?.path_worst.as_ref().map(|w| w.value));
        spread(mean_of(e, |t| t.gap.as_ref()?.path), worst)
    }),
    ("gap overshoot", |e| {
        e.tasks.iter().any(|t| t.gap.is_some()).then(|| {
            let worst = |by_contact: bool| {
                worst_of(e, |t| {
                    let overshoot = t.gap.as_ref()?.overshoot.as_ref()?;
                    (overshoot.by_contact == by_contact).then_some(overshoot.value)
                })
            };
            match (worst(false), worst(true)) {
                (Some(worst), _) => format!("{worst:.3}"),
                (None, Some(worst)) => format!("{worst:.3} by touch"),
                (None, None) => "none".to_owned(),
            }
        })
    }),
    ("gap jerk", |e| {
        let worst = worst_of(e, |t| t.gap.as_ref()?.jerk_worst.as_ref().map(|w| w.value));
        spread(mean_of(e, |t| t.gap.as_ref()?.jerk), worst)
    }),
    ("gap error / a cubic's", |e| {
        mean_of(e, |t| t.gap.as_ref()?.to_cubic).map(|x| format!("{x:.2}"))
    }),
    ("jams", |e| {
        let jams: Vec<usize> =
            e.tasks.iter().filter_map(|t| Some(t.jams.as_ref()?.len())).collect();
        (!jams.is_empty()).then(|| jams.iter().sum::<usize>().to_string())
    }),
];

/// Mean over the tasks that have it.
fn mean_of(e: &Evaluation, f: impl Fn(&CaseResult) -> Option<f64>) -> Option<f64> {
    let values: Vec<f64> = e.tasks.iter().filter_map(f).collect();
    mean_ci95(&values).map(|i| i.mean)
}

fn worst_of(e: &Evaluation, f: impl Fn(&CaseResult) -> Option<f64>) -> Option<f64> {
    e.tasks.iter().filter_map(f).max_by(f64::total_cmp)
}

fn spread(mean: Option<f64>, worst: Option<f64>) -> Option<String> {
    Some(format!("{:.2} ({:.2})", mean?, worst?))
}

/// A row of Precisions, with a mark at the best one; `missing` stands where there is none.
fn cells(name: &str, values: &[Option<f64>], cis: &[Option<f64>], missing: &[&str]) -> Vec<String> {
    let best = values.iter().flatten().copied().min_by(f64::total_cmp);
    let mut cells = vec![name.to_owned()];
    for ((v, ci), missing) in values.iter().zip(cis).zip(missing) {
        cells.push(match v {
            None => (*missing).to_owned(),
            Some(v) => {
                let mark = if values.len() > 1 && Some(*v) == best { "* " } else { "" };
                let ci = ci.map_or_else(String::new, |c| format!(" ±{c:.5}"));
                format!("{mark}{}{ci}", short(*v))
            }
        });
    }
    cells
}

/// Five decimals. An error that would round to zero is shown as `<0.00001`.
fn short(v: f64) -> String {
    if v > 0.0 && v < 5e-6 { "<0.00001".to_owned() } else { format!("{v:.5}") }
}

/// Mean over all tasks; `None` if one of them has none.
fn average(e: &Evaluation, f: impl Fn(&CaseResult) -> Option<f64>) -> Option<f64> {
    let values: Option<Vec<f64>> = e.tasks.iter().map(f).collect();
    values.and_then(|v| mean_ci95(&v)).map(|i| i.mean)
}
