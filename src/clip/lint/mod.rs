//! Finds content of a clip that is valid but probably not intended. Each finding has its place and,
//! if there is one, an edit that fixes it.
//!
//! All findings are in one list. Checks that need the simulator (self-collision, unreachable poses)
//! come from a [`PoseChecker`], which is implemented on a higher floor.

mod finder;
mod finding;
mod rules;

use super::command::Command;
use super::document::Clip;
use super::joints::JointTable;
use finder::Finder;
pub use finding::{Fix, Level, Lint, PoseChecker, PoseReport, Rule, SettledPose};

/// All findings about a clip, worst first, then by frame.
pub fn lint(
    clip: &Clip,
    command: &Command,
    table: &JointTable,
    checker: Option<&mut dyn PoseChecker>,
) -> Vec<Lint> {
    let mut found = Finder::new(clip, command, table);
    found.robot();
    found.limits();
    found.offsets();
    found.speeds();
    found.tangents();
    found.reach();
    found.blind();
    found.coupled();
    found.partial();
    found.hidden();
    if let Some(checker) = checker {
        found.poses(checker);
    }
    found.rest();
    let mut lints = found.lints;
    lints.sort_by_key(|l| {
        (std::cmp::Reverse(l.level), l.frames.map_or(0, |f| f[0]), l.rule, l.pointer.clone())
    });
    lints
}
