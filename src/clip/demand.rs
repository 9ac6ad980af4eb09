//! The joint speeds that an edit asks for: the hint while a key is dragged.

use serde::Serialize;

use super::command::Command;
use super::joints::JointTable;
use robert_base::units::{CTRL_DT, Unit};

/// The joint that an edit demands most of.
#[derive(Clone, Debug, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Demand {
    /// Its name.
    pub joint: String,
    /// Its unit.
    pub unit: Unit,
    /// The frames of the two goals between which it must move.
    pub frames: [u32; 2],
    /// Mean speed between them, rad/s or m/s.
    pub needed: f64,
    /// The speed that 99 of 100 frames of the policy's data stay below, rad/s or m/s, if known.
    pub usual: Option<f64>,
    /// The speed that the plant can sustain, rad/s or m/s, if known.
    pub max: Option<f64>,
}

impl Demand {
    /// The speed that it should stay below.
    fn limit(&self) -> Option<f64> {
        match (self.usual, self.max) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }

    fn share(&self) -> f64 {
        self.limit().filter(|l| *l > 0.0).map_or(0.0, |l| self.needed / l)
    }
}

/// The most demanding pair of goals of one joint, among those that differ from `old`, by its speed
/// relative to the limit. `None` if nothing moves or no limit is known.
pub fn demand(command: &Command, old: &Command, table: &JointTable) -> Option<Demand> {
    let first = command.first_changed_frame(old)?;
    let last = last_changed(command, old);
    let mut worst: Option<Demand> = None;
    for (j, name) in command.joints().iter().enumerate() {
        let Some(fact) = table.joint(name) else { continue };
        let mut before: Option<(u32, f32)> = None;
        for t in 0..command.frames() {
            if !command.sees(t, j) {
                continue;
            }
            let Some(&v) = command.row(t).get(j) else { continue };
            let Some((a, from)) = before.replace((t, v)) else { continue };
            if t < first || a > last {
                continue;
            }
            let needed = (f64::from(v) - f64::from(from)).abs() / (f64::from(t - a) * CTRL_DT);
            let found = Demand {
                joint: name.clone(),
                unit: fact.unit,
                frames: [a, t],
                needed,
                usual: fact.speed_usual,
                max: fact.speed_max,
            };
            let share = found.share();
            if share > 1e-9 && worst.as_ref().is_none_or(|w| share > w.share()) {
                worst = Some(found);
            }
        }
    }
    worst
}

/// The last frame that differs or exists in only one of the two.
fn last_changed(command: &Command, old: &Command) -> u32 {
    if command.frames() != old.frames() || command.dim() != old.dim() {
        return command.frames();
    }
    let differs = |t: &u32| {
        (0..command.dim()).any(|j| {
            command.sees(*t, j) != old.sees(*t, j)
                || (command.sees(*t, j) && command.row(*t).get(j) != old.row(*t).get(j))
        })
    };
    (0..command.frames()).rev().find(differs).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Clip, compile, parse};

    fn clip(frame: u32) -> Clip {
        let text = format!(
            r#"{{"format": "robert-clip/1", "robot": {{"id": "x", "joints": ["a", "b"]}}, "fps": 20, "length": 80,
            "keys": [{{"frame": 0, "q": [0, 0]}}, {{"frame": {frame}, "q": [1, 0.1]}}, {{"frame": 60, "q": [4, 0.1]}}]}}"#
        );
        parse(text).unwrap().clip
    }

    #[test]
    fn a_key_that_comes_near_another_asks_for_speed() {
        let [old, new] = [40, 10].map(|f| compile(&clip(f)).unwrap());
        let mut table = JointTable::from_clip(&clip(40));
        assert_eq!(demand(&new, &old, &table), None, "no limit is known");
        for joint in &mut table.joints {
            joint.speed_max = Some(5.0);
        }
        let found = demand(&new, &old, &table).unwrap();
        assert_eq!((found.joint.as_str(), found.frames), ("a", [0, 10]));
        assert!((found.needed - 2.0).abs() < 1e-6, "1 rad in half a second: {}", found.needed);
        // This is slow for the plant, but fast for the policy's data.
        table.joints[1].speed_usual = Some(0.01);
        assert_eq!(demand(&new, &old, &table).unwrap().joint, "b");
        assert_eq!(demand(&old, &old, &table), None, "nothing was changed");
    }
}
