//! Rows with times, on the way from a file to a clip.

use std::collections::BTreeMap;

use super::super::error::Error;
use robert_base::limits;
use robert_base::units::Unit;
use robert_clip::formats::{Sample, from_samples};
use robert_clip::{Clip, ClipError, Fill, RobotRef, thin};

/// A recording: joint values at rising times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Names of the columns.
    pub joints: Vec<String>,
    /// Times, s; (rows).
    pub secs: Vec<f64>,
    /// Values, rad or m; (rows)(joints).
    pub rows: Vec<Vec<f64>>,
    /// Whether angles are degrees instead.
    pub degrees: bool,
}

impl Samples {
    /// Rows at a steady rate.
    pub(super) fn steady(joints: Vec<String>, fps: f64, rows: Vec<Vec<f64>>) -> Samples {
        let secs = (0..rows.len()).map(|r| r as f64 / fps).collect();
        Samples { joints, secs, rows, degrees: false }
    }

    /// The clip for a robot. The samples must contain all its joints; other columns are left out.
    /// `rename` maps names in the file to the robot's names. A positive `tolerance` (rad or m)
    /// thins the rows into keys.
    ///
    /// # Errors
    /// [`ClipError`] for a joint that is missing, times that do not rise, or values that are
    /// none.
    pub fn clip(
        &self,
        robot: &RobotRef,
        rename: &BTreeMap<String, String>,
        tolerance: f64,
    ) -> Result<Clip, ClipError> {
        let wrong = |message: String| ClipError::at(message, 1, 1);
        let known = |name: &String| rename.get(name).unwrap_or(name).clone();
        let names: Vec<String> = self.joints.iter().map(known).collect();
        let place = |joint: &String| {
            names.iter().position(|n| n == joint).ok_or_else(|| {
                let has: Vec<&str> = names.iter().take(6).map(String::as_str).collect();
                wrong(format!(
                    "no values for joint \"{joint}\" of {}; the file has {} (others are mapped with --rename)",
                    robot.id,
                    has.join(", ")
                ))
            })
        };
        let order = robot.joints.iter().map(place).collect::<Result<Vec<usize>, _>>()?;
        if self.rows.len().saturating_mul(order.len()) > limits::CLIP_VALUES {
            return Err(wrong(format!("{} rows are too many", self.rows.len())));
        }
        if let Some(row) = self.secs.windows(2).position(|w| w[1].is_nan() || w[1] <= w[0]) {
            return Err(wrong(format!("row {}: its time is not after the one before", row + 1)));
        }
        // Slides are in metres in any case.
        let turns = |j: usize| robot.units.get(j).is_none_or(|unit| *unit == Unit::Rad);
        let value = |j: usize, v: f64| if self.degrees && turns(j) { v.to_radians() } else { v };
        let values = |row: &[f64]| {
            order.iter().enumerate().map(|(j, &from)| Some(value(j, row[from]))).collect()
        };
        let rows = self.secs.iter().zip(&self.rows);
        let samples: Vec<Sample> = rows.map(|(secs, row)| (*secs, values(row))).collect();
        let mut clip = from_samples(&samples, robot, Fill::Linear)?;
        if tolerance > 0.0 {
            thin(&mut clip, tolerance);
        }
        Ok(clip)
    }
}

/// Foreign data that makes no sense.
pub(super) fn foreign(problem: impl Into<String>) -> Error {
    Error::Foreign { problem: problem.into(), path: None }
}

/// Foreign data that makes no sense, with its line.
pub(super) fn at_line(line: usize, problem: impl std::fmt::Display) -> Error {
    foreign(format!("line {line}: {problem}"))
}

/// A rate that a file gave.
pub(super) fn rate(fps: f64) -> Result<f64, Error> {
    if (0.1..=10_000.0).contains(&fps) {
        return Ok(fps);
    }
    Err(foreign(format!("{fps} rows a second")))
}
