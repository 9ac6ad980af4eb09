//! Motion as learning tools store it: states, and the action after each.

use robert_base::units::Unit;
use robert_dataset::Dataset;

use super::super::document::Take;

/// Columns of a state or an action.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Names.
    pub names: Vec<String>,
    /// Numbers; (rows, names).
    pub values: Vec<f64>,
}

impl Columns {
    /// Rows of these columns.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[f64]> {
        self.values.chunks_exact(self.names.len().max(1))
    }
}

/// One trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Episode {
    /// The task, in words.
    pub task: String,
    /// Robot id.
    pub robot: String,
    /// Units of the state; (S).
    pub units: Vec<Unit>,
    /// Joint positions, rad or m; (T + 1, S).
    pub position: Columns,
    /// Joint velocities, rad/s or m/s; (T + 1, S).
    pub velocity: Columns,
    /// Controls applied between two states, N m or N; (T, A).
    pub control: Columns,
}

impl Episode {
    /// The episode of a take.
    pub fn of_take(take: &Take, task: &str) -> Episode {
        let columns = |names: &[String], values: &[f64]| Columns {
            names: names.to_vec(),
            values: values.to_vec(),
        };
        Episode {
            task: task.to_owned(),
            robot: take.robot.id.clone(),
            units: take.robot.units.clone(),
            position: columns(&take.robot.joints, &take.reached),
            velocity: columns(&take.robot.joints, &take.velocity),
            control: columns(&take.robot.actuators, &take.ctrl),
        }
    }

    /// The trajectories of a dataset, with controls in N m or N. A transition is missing at
    /// the end of each: the state after the last control is not stored.
    pub fn of_dataset(data: &Dataset) -> impl ExactSizeIterator<Item = Episode> + '_ {
        let robot = &data.manifest().robot;
        data.episodes().iter().map(move |e| {
            let (qpos, qvel, ctrl) = data.frames(e);
            let wide = |values: &[f32]| values.iter().map(|v| f64::from(*v)).collect::<Vec<_>>();
            let steps = (e.length as usize).saturating_sub(1);
            let mut control = wide(&ctrl[..steps * robot.actuators.len()]);
            for row in control.chunks_exact_mut(robot.ctrlranges.len().max(1)) {
                for (u, [low, high]) in row.iter_mut().zip(&robot.ctrlranges) {
                    // Stored is the action, -1 to 1.
                    *u = low + 0.5 * (*u + 1.0) * (high - low);
                }
            }
            Episode {
                task: format!("explore by {}", e.agent),
                robot: robot.id.clone(),
                units: robot.units.clone(),
                position: Columns { names: robot.joints.clone(), values: wide(qpos) },
                velocity: Columns { names: robot.joints.clone(), values: wide(qvel) },
                control: Columns { names: robot.actuators.clone(), values: control },
            }
        })
    }

    /// States in it.
    pub fn frames(&self) -> usize {
        self.position.rows().len()
    }
}
