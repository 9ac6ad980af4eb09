//! The joint columns of a motion: a take, or a CSV file.

use std::collections::BTreeMap;
use std::path::Path;

use crate::cli::failure::{Failure, Outcome};
use crate::cli::{input, motion};
use crate::limits;
use crate::plot::Axis;
use crate::take::{Take, What as Asked};

/// The columns of a motion that are drawn.
#[derive(clap::Args, Debug)]
pub(super) struct Selection {
    /// Draw only these joints.
    #[arg(long, value_delimiter = ',')]
    pub(super) only: Vec<String>,
    #[command(flatten)]
    pub(super) unit: Units,
}

/// The unit of the values in a file.
#[derive(clap::Args, Debug)]
pub(super) struct Units {
    /// Unit of the joints [default: a take's own; rad for a table].
    #[arg(long)]
    unit: Option<String>,
}

/// The joint columns of a motion CSV.
pub(super) struct Columns {
    pub(super) names: Vec<String>,
    /// Units by joint, if the file knows them.
    units: BTreeMap<String, &'static str>,
    values: Vec<Vec<f64>>,
    pub(super) frames: usize,
}

/// The command of a chart: the named file, else that of the first take.
pub(super) fn asked<'a>(
    file: Option<&Path>,
    motions: impl IntoIterator<Item = &'a Path>,
) -> Outcome<Option<Columns>> {
    if let Some(file) = file {
        return Columns::of_file(file, Asked::Command).map(Some);
    }
    let take = motions.into_iter().find(|p| motion::is_take(p));
    take.map(|p| Columns::of_file(p, Asked::Command)).transpose()
}

impl Columns {
    /// The motion in a file.
    pub(super) fn read(path: &Path) -> Outcome<Columns> {
        Columns::of_file(path, Asked::Achieved)
    }

    fn of_file(path: &Path, what: Asked) -> Outcome<Columns> {
        if motion::is_take(path) {
            return Ok(Columns::of_take(&input::take(path)?, what));
        }
        Columns::parse(path, &input::read(path, limits::TABLE_BYTES)?)
    }

    fn of_take(take: &Take, what: Asked) -> Columns {
        let (robot, command) = (&take.robot, &take.command);
        let goal = |f: usize, j: usize| {
            let seen = command.sees(f as u32, j);
            if seen { f64::from(command.row(f as u32)[j]) } else { f64::NAN }
        };
        let value = |f: usize, j: usize| match what {
            Asked::Achieved => take.state(f)[j],
            Asked::Command => goal(f, j),
        };
        let (names, frames) = match what {
            Asked::Achieved => (&robot.joints[..], take.frames()),
            Asked::Command => (command.joints(), command.frames() as usize),
        };
        let joint = |j: usize| (0..frames).map(|f| value(f, j)).collect();
        Columns {
            names: names.to_vec(),
            units: robot
                .joints
                .iter()
                .cloned()
                .zip(robot.units.iter().map(|u| u.symbol()))
                .collect(),
            values: (0..names.len()).map(joint).collect(),
            frames,
        }
    }

    fn parse(path: &Path, bytes: &[u8]) -> Outcome<Columns> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes);
        let bad =
            |line: u64, why: String| Failure::invalid(format!("{}:{line}: {why}", path.display()));
        let head = reader.headers().map_err(|e| bad(1, e.to_string()))?.clone();
        let first = |name: &str| head.iter().position(|h| h == name);
        let frame = first("frame");
        // A joint may have one of these names; its column is the second.
        let lead = [frame, first("time"), first("mask")];
        let picked: Vec<(usize, String)> = head
            .iter()
            .enumerate()
            .filter(|(i, h)| !h.is_empty() && !lead.contains(&Some(*i)))
            .map(|(i, h)| (i, h.to_owned()))
            .collect();
        if picked.is_empty() {
            return Err(bad(1, "no joint columns; expected frame,time,mask,<joint>...".into()));
        }
        let mut values = vec![Vec::new(); picked.len()];
        let mut frames = 0;
        for (row, record) in reader.records().enumerate() {
            let line = row as u64 + 2;
            let record = record.map_err(|e| bad(line, e.to_string()))?;
            // The start, which is no frame of the motion.
            if frame.and_then(|i| record.get(i)).is_some_and(|cell| cell.starts_with('-')) {
                continue;
            }
            for ((i, name), column) in picked.iter().zip(&mut values) {
                let cell = record.get(*i).unwrap_or("");
                let value = if cell.is_empty() {
                    f64::NAN
                } else {
                    cell.parse()
                        .map_err(|_e| bad(line, format!("{name}: {cell:?} is not a number")))?
                };
                column.push(value);
            }
            frames += 1;
        }
        if frames == 0 {
            return Err(bad(2, "no rows".into()));
        }
        let names = picked.into_iter().map(|p| p.1).collect();
        Ok(Columns { names, units: BTreeMap::new(), values, frames })
    }

    pub(super) fn of(&self, name: &str) -> Option<&Vec<f64>> {
        self.names.iter().position(|n| n == name).and_then(|i| self.values.get(i))
    }

    /// The unit of a joint: from the command line, else its own, else rad.
    pub(super) fn unit_of(&self, name: &str, asked: &Units) -> String {
        let own = || self.units.get(name).copied().unwrap_or("rad").to_owned();
        asked.unit.clone().unwrap_or_else(own)
    }

    /// The unit of a mean over all joints.
    pub(super) fn unit(&self, asked: &Units) -> String {
        let mut units: Vec<String> = self.names.iter().map(|n| self.unit_of(n, asked)).collect();
        units.sort_by(|a, b| b.cmp(a));
        units.dedup();
        units.join(" or ")
    }

    pub(super) fn shares_any(&self, other: &Columns) -> bool {
        self.names.iter().any(|n| other.of(n).is_some())
    }

    /// Refuses a motion that was not made from this command.
    pub(super) fn foreign(&self, motion: &Columns, path: &Path) -> Failure {
        let list = |names: &[String]| {
            let first = names.iter().take(4).cloned().collect::<Vec<_>>().join(", ");
            if names.len() > 4 { format!("{first}, ...") } else { first }
        };
        Failure::invalid(format!(
            "{}: its joints are {}, but those of the command are {}: is it another robot?",
            path.display(),
            list(&motion.names),
            list(&self.names)
        ))
    }

    pub(super) fn pick(&self, only: &[String]) -> Outcome<Vec<String>> {
        if let Some(missing) = only.iter().find(|n| self.of(n).is_none()) {
            return Err(Failure::invalid(format!(
                "no column {missing:?}; there are: {}",
                self.names.join(", ")
            )));
        }
        Ok(if only.is_empty() { self.names.clone() } else { only.to_vec() })
    }

    /// The axes of the first two columns.
    pub(super) fn plane_axes(&self, asked: &Units, path: &Path) -> Outcome<[Axis; 2]> {
        match self.names.as_slice() {
            [x, y, ..] => Ok([x, y].map(|n| Axis::new(n, &self.unit_of(n, asked)))),
            _ => Err(Failure::invalid(format!("{}: two columns are needed", path.display()))),
        }
    }

    pub(super) fn plane(&self, path: &Path) -> Outcome<Vec<(f64, f64)>> {
        match self.values.as_slice() {
            [x, y, ..] => Ok(x.iter().copied().zip(y.iter().copied()).collect()),
            _ => Err(Failure::invalid(format!("{}: two columns are needed", path.display()))),
        }
    }

    /// Mean absolute error of a frame over the joints with a goal; NaN if there is no goal.
    pub(super) fn error(&self, reached: &Columns, frame: usize) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0_f64);
        for (name, goal) in self.names.iter().zip(&self.values) {
            let a = reached.of(name).and_then(|v| v.get(frame));
            if let (Some(a), Some(c)) = (a, goal.get(frame))
                && a.is_finite()
                && c.is_finite()
            {
                sum += (a - c).abs();
                count += 1.0;
            }
        }
        if count > 0.0 { sum / count } else { f64::NAN }
    }

    /// Stretches of more than one frame without a goal.
    pub(super) fn masked(&self) -> Vec<(f64, f64)> {
        let seen = |f: usize| self.values.iter().any(|c| c.get(f).is_some_and(|v| v.is_finite()));
        let mut out = Vec::new();
        let mut from = None;
        for f in 0..=self.frames {
            match (f < self.frames && !seen(f), from) {
                (true, None) => from = Some(f),
                (false, Some(a)) => {
                    if f > a + 1 {
                        out.push((a as f64, (f - 1) as f64));
                    }
                    from = None;
                }
                _ => {}
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::clip::{Clip, compile};
    use crate::progress::Cancel;
    use crate::robot::Robot;
    use crate::rollout::{PolicyConfig, PolicyName, Rollout, RolloutConfig, Start};
    use crate::take::Provenance;

    /// A take whose start differs from its first goal, and whose joints have names of columns.
    fn take() -> Take {
        let text = r#"{"format": "robert-clip/1", "robot": {"id": "pointmass", "joints": ["x", "y"]},
            "fps": 20, "length": 5, "start": {"q": [0, 0]},
            "keys": [{"frame": 0, "q": [0.1, null]}, {"frame": 4, "q": [0.2, 0.3]}]}"#;
        let clip = Clip::parse(text).unwrap();
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let command = compile(&clip).unwrap();
        let (policy, config) = (PolicyConfig::new(PolicyName::Pd), RolloutConfig::default());
        let built = policy.build(&robot).unwrap();
        let mut rollout =
            Rollout::new(&robot, built, &command, Start::Pose, config.clone()).unwrap();
        rollout.run(&Cancel::default()).unwrap();
        let provenance = Provenance::new(&robot, &policy, &config).unwrap();
        let mut take = Take::record(&rollout, &command, Some(&clip), provenance).unwrap();
        take.robot.joints = vec!["time".to_owned(), "error".to_owned()];
        take
    }

    #[test]
    fn every_joint_of_a_take_is_a_column() {
        let take = take();
        let reached = Columns::of_take(&take, Asked::Achieved);
        assert_eq!(reached.names, ["time", "error"]);
        assert_eq!((reached.frames, reached.values[1].len()), (5, 5));
        assert_eq!(reached.values[1][4], take.state(4)[1]);
        // A CSV has its start before frame 0; here frame 0 is the first.
        let goals = Columns::of_take(&take, Asked::Command);
        assert!((goals.values[0][0] - 0.1).abs() < 1e-6 && goals.values[1][0].is_nan());
        assert!((goals.values[1][4] - 0.3).abs() < 1e-6 && goals.values[1].len() == 5);
    }

    #[test]
    fn a_table_may_have_a_joint_called_time() {
        let text = "frame,time,mask,time,error\n-1,-0.05,1,7,7\n0,0,0,1,2\n1,0.05,0,3,\n";
        let table = Columns::parse(Path::new("a.csv"), text.as_bytes()).unwrap();
        assert_eq!(table.names, ["time", "error"]);
        assert_eq!((table.frames, &table.values[0][..]), (2, &[1.0, 3.0][..]));
        assert!(table.values[1][1].is_nan());
    }
}
