//! One input of an export: a take, and its robot if it is known.

use std::path::Path;
use std::sync::Arc;

use super::args::Args;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::global::Global;
use crate::cli::perform::perform;
use crate::cli::{input, motion};
use crate::exit::HasExit as _;
use crate::limits;
use crate::robot::Robot;
use crate::take::Take;

/// A take on its way to other formats.
pub(super) struct Source {
    pub take: Take,
    /// The robot of the take. It may be unknown on this machine; the failure says so.
    pub robot: Outcome<Arc<Robot>>,
    /// The title: `wave` for `dir/wave.clip.json`, `reacher` for `ur5e/reacher`.
    pub title: String,
}

impl Source {
    /// Reads a take, or performs a clip.
    pub(super) fn read(text: &str, args: &Args, global: Global) -> Outcome<Source> {
        let title = title(text);
        let path = Path::new(text);
        if !motion::is_take(path) {
            let mut done = perform(text, &args.perform, global)?;
            if let Some(e) = done.broke.take() {
                return Err(e.into());
            }
            return Ok(Source { take: done.take()?, robot: Ok(done.robot), title });
        }
        args.perform.must_be_absent(text)?;
        let take = if args.recover {
            let bytes = input::read(path, limits::TAKE_BYTES)?;
            let found = Take::recover_mcap(&bytes).map_err(|e| e.in_file(&input::place(path)))?;
            if let Some(damage) = found.damage {
                tracing::warn!("{text}: {damage}; {} frames recovered", found.take.frames());
            }
            found.take
        } else {
            input::take(path)?
        };
        let robot = motion::robot_for(args.perform.robot.as_deref(), &take.robot.id);
        // A robot that was named must be there.
        let robot = match robot {
            Err(e) if args.perform.robot.is_some() => return Err(e),
            Ok(robot) => match take.check_robot(&robot) {
                Err(e) if args.perform.robot.is_some() => return Err(e.into()),
                Err(e) => Err(Failure::with(e.exit(), e)),
                Ok(()) => Ok(robot),
            },
            Err(e) => Err(e),
        };
        Ok(Source { take, robot, title })
    }

    /// The robot, which the format needs.
    pub(super) fn robot(&self) -> Outcome<&Arc<Robot>> {
        self.robot.as_ref().map_err(|e| Failure::with(e.exit(), e.sentence()))
    }

    /// The task in words: the clip's name, else the file's.
    pub(super) fn task(&self) -> String {
        let clip = self.take.clip_text.as_ref().and_then(|t| crate::clip::Clip::parse(t).ok());
        clip.map(|c| c.name).filter(|n| !n.trim().is_empty()).unwrap_or_else(|| self.title.clone())
    }
}

/// The title of an input.
pub(super) fn title(input: &str) -> String {
    let name = Path::new(input).file_name().map(|n| n.to_string_lossy().into_owned());
    let name = name.unwrap_or_else(|| input.to_owned());
    let stem = [motion::CLIP_SUFFIX, ".json", ".mcap"].iter().find_map(|s| name.strip_suffix(s));
    match stem.unwrap_or(&name) {
        "-" => "take".to_owned(),
        stem => stem.to_owned(),
    }
}
