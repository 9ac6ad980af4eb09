//! The charts of a sweep.

use super::Sweep;
use super::row::Row;
use super::value::Value;
use robert_base::units::Unit;
use robert_plot::{self as plot, Axis, Curve, Figure};
use robert_rollout::Interval;

/// One panel per suite: Precision over the setting `x`, with one curve (or colour of bar) for each
/// combination of the others; bands and whiskers are 95 % intervals over seeds.
pub fn figure(sweep: &Sweep, unit: Unit, rows: &[Row]) -> Option<Figure> {
    let names: Vec<&String> = rows.first()?.suites.keys().collect();
    let xs = sweep.grid.get(&sweep.x)?;
    let numbers: Option<Vec<f64>> = xs.iter().map(Value::number).collect();
    let label = |r: &Row| {
        let others = r.values.iter().filter(|(k, _)| **k != sweep.x);
        others.map(|(k, v)| format!("{k} {v}")).collect::<Vec<_>>().join(", ")
    };
    // In the order of the grid.
    let mut lines: Vec<String> = Vec::new();
    for line in rows.iter().map(label) {
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    let at = |line: &str, x: &Value, suite: &str| {
        let row = rows.iter().find(|r| label(r) == *line && r.values.get(&sweep.x) == Some(x))?;
        *row.suites.get(suite)?
    };
    let seeds = sweep.seeds.len();
    let note = format!("{}, {seeds} seeds, bands and whiskers 95 % (Student's t)", sweep.robot);
    let panels = names.iter().map(|suite| {
        let y = Axis::new("Precision", unit.symbol());
        let figure = if let Some(numbers) = &numbers {
            let curves: Vec<Curve> = lines
                .iter()
                .map(|line| {
                    let found: Vec<(f64, Interval)> = numbers
                        .iter()
                        .zip(xs)
                        .filter_map(|(&n, x)| Some((n, at(line, x, suite)?)))
                        .collect();
                    let half = |i: &Interval| i.ci95.unwrap_or(0.0);
                    Curve {
                        name: line.clone(),
                        points: found.iter().map(|(x, i)| (*x, i.mean)).collect(),
                        ci95: found.iter().map(|(_, i)| half(i)).collect(),
                    }
                })
                .collect();
            let spread = numbers.iter().copied().fold(f64::INFINITY, f64::min);
            let most = numbers.iter().copied().fold(0.0, f64::max);
            let axis = Axis::new(&sweep.x, "");
            let axis = if spread > 0.0 && most / spread > 20.0 { axis.log() } else { axis };
            plot::curves(suite, &curves, axis, y.from_zero())
        } else {
            let groups: Vec<String> = xs.iter().map(ToString::to_string).collect();
            let bar = |i: Option<Interval>| {
                i.map_or((f64::NAN, 0.0), |i| (i.mean, i.ci95.unwrap_or(0.0)))
            };
            let sets: Vec<(String, Vec<(f64, f64)>)> = lines
                .iter()
                .map(|line| (line.clone(), xs.iter().map(|x| bar(at(line, x, suite))).collect()))
                .collect();
            plot::bars(suite, &groups, &sets, y)
        };
        figure.panels.into_iter().next().map(|p| plot::Panel { title: (*suite).clone(), ..p })
    });
    let panels: Vec<_> = panels.flatten().collect();
    // Four panels in rows of three would leave one alone.
    let columns = if panels.len() == 4 { 2 } else { panels.len().clamp(1, 3) };
    Some(Figure::grid(&sweep.title, panels, columns).panel_size(360, 260).note(&note))
}
