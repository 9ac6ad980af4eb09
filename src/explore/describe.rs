//! The description of a robot in a dataset.

use robert_dataset::Robot as Described;
use robert_robot::{Robot, StateJoint};

/// The distance to a stop below which a joint counts as being at it: that of the profile, but at
/// most 2 % of the joint's range. With .1 rad, a hand's spreading joint would count as being at a
/// stop over a third of its range without touching anything.
fn near_limit(robot: &Robot, joint: &StateJoint) -> f64 {
    let range = if joint.unbounded { f64::INFINITY } else { joint.range[1] - joint.range[0] };
    robot.profile().near_limit.min(0.02 * range)
}

/// The manifest's description of a robot.
pub fn describe(robot: &Robot) -> Described {
    Described {
        id: robot.id().to_owned(),
        model_sha256: robot.model_sha256().to_owned(),
        joints: robot.joints().iter().map(|j| j.name.clone()).collect(),
        units: robot.joints().iter().map(|j| j.unit).collect(),
        ranges: robot.joints().iter().map(|j| (!j.unbounded).then_some(j.range)).collect(),
        near_limit: robot.joints().iter().map(|j| near_limit(robot, j)).collect(),
        actuators: robot.actuators().iter().map(|a| a.name.clone()).collect(),
        ctrlranges: robot.actuators().iter().map(|a| a.ctrlrange).collect(),
    }
}
