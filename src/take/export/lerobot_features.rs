//! The vectors of a LeRobot dataset.

use super::episode::{Columns, Episode};
use super::lerobot_layout::{LeRobotAction, LeRobotOptions};
use robert_base::units::Unit;

/// A vector of each row.
pub(super) struct Feature {
    pub key: &'static str,
    pub names: Vec<String>,
    /// (rows, names)
    pub values: Vec<f64>,
}

/// State, velocity and action of an episode, with the requested names and units.
pub(super) fn features(e: &Episode, options: &LeRobotOptions) -> Vec<Feature> {
    let frames = e.frames();
    let name = |column: &String, end: &str| {
        let renamed = options.rename.get(column).unwrap_or(column);
        // A slash would begin another folder of features.
        format!("{}.{end}", renamed.replace('/', "_"))
    };
    let scaled = |columns: &Columns| -> Vec<f64> {
        let factor = |j: usize| match e.units.get(j) {
            Some(Unit::Rad) if options.degrees => 1.0_f64.to_degrees(),
            _ => 1.0,
        };
        let rows = columns.rows().flat_map(|r| r.iter().enumerate().map(|(j, v)| v * factor(j)));
        rows.collect()
    };
    let joint = |end: &str| e.position.names.iter().map(|n| name(n, end)).collect::<Vec<_>>();
    let position = scaled(&e.position);
    let (names, action) = match options.action {
        LeRobotAction::Position => {
            let dim = e.position.names.len();
            let commanded: Vec<usize> =
                (0..dim).filter(|j| options.motorised.as_ref().is_none_or(|m| m[*j])).collect();
            let rows = position[dim..].chunks_exact(dim);
            let rows = rows.chain([&position[position.len() - dim..]]);
            let next = rows.flat_map(|row| commanded.iter().map(|j| row[*j])).collect();
            let names = joint("pos");
            (commanded.iter().map(|j| names[*j].clone()).collect(), next)
        }
        LeRobotAction::Torque => {
            let dim = e.control.names.len();
            let mut values = e.control.values.clone();
            let last: Vec<f64> = match values.len().checked_sub(dim) {
                Some(from) => values[from..].to_vec(),
                None => vec![0.0; dim],
            };
            values.extend(last);
            values.truncate(frames * dim);
            (e.control.names.iter().map(|n| name(n, "effort")).collect(), values)
        }
    };
    vec![
        Feature { key: "observation.state", names: joint("pos"), values: position },
        Feature { key: "observation.velocity", names: joint("vel"), values: scaled(&e.velocity) },
        Feature { key: "action", names, values: action },
    ]
}
