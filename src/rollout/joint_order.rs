//! The joints of a command and those of the robot.

use super::error::Error;
use robert_clip::Command;
use robert_robot::Robot;

/// A command with its joints in the robot's order.
///
/// # Errors
/// [`Error::Joints`] if they are not the robot's joints.
pub fn in_order(robot: &Robot, command: Command) -> Result<Command, Error> {
    let names: Vec<String> = robot.joints().iter().map(|j| j.name.clone()).collect();
    let same = command.dim() == names.len();
    let command = same.then(|| command.reordered(&names)).flatten().unwrap_or(command);
    check_joints(robot, &command)?;
    Ok(command)
}

/// The command must name the robot's joints in the robot's order.
pub(super) fn check_joints(robot: &Robot, command: &Command) -> Result<(), Error> {
    let known: Vec<&str> = robot.joints().iter().map(|j| j.name.as_str()).collect();
    if known.iter().eq(command.joints().iter()) {
        return Ok(());
    }
    let strange = command.joints().iter().find(|j| !known.contains(&j.as_str()));
    let why = match strange {
        Some(joint) => format!("\"{joint}\" is not a joint of the robot"),
        None => {
            let missing: Vec<&str> = known
                .iter()
                .filter(|name| !command.joints().iter().any(|j| j == *name))
                .copied()
                .collect();
            match missing.len() {
                0 => "their order differs".to_owned(),
                n => {
                    let some = missing[..n.min(5)].join(", ");
                    let more = if n > 5 { format!(" and {} more", n - 5) } else { String::new() };
                    format!(
                        "it lacks {some}{more}: every joint of the robot has a place in each row, with null where it has no goal"
                    )
                }
            }
        }
    };
    Err(Error::Joints {
        robot: robot.id().to_owned(),
        got: command.dim(),
        want: robot.state_dim(),
        hint: format!("{why}; correct the clip, or name its own robot with --robot"),
    })
}
