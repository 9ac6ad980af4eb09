//! `robert clip convert`: clips from and to CSV, MJCF keys, ROS trajectories, dense JSON.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use super::super::failure::{Failure, Outcome};
use super::super::{input, motion, out};
use super::recorded::{Kind, Recorded};
use crate::clip::formats::{
    from_command_json, from_csv, from_mjcf, from_ros, to_command_json, to_csv, to_mjcf, to_ros,
};
use crate::clip::{Clip, ClipError, Fill, Goal, RobotRef, Start};
use crate::limits;
use crate::units::Unit;

/// Convert clips from and to other formats.
///
/// The file name decides the format: .clip.json, .csv, .xml (MJCF keyframes), .yaml (ROS 2
/// JointTrajectory) or .json (dense command). A take (.mcap, or .json of robert export) can be read
/// too; its clip is converted. A dense format that is written and read again gives the same
/// command, bit for bit. Recorded motion can be read and is thinned into keys: LAFAN rows
/// (.lafan.csv), motion files of trackers (.npz), .bvh, folders of LeRobot, and ROS bags (a folder,
/// or .mcap with --from bag).
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert clip convert wave.clip.json wave.csv\n  robert clip convert log.csv log.clip.json --robot ur5e\n  robert clip convert plan.yaml plan.clip.json --robot ur5e --fill linear\n  robert clip convert scene.xml poses.clip.json --like wave.clip.json\n  robert clip convert wave.clip.json wave.xml --with-model       a model that loads by itself\n  robert clip convert wave.clip.json light.clip.json --robot ur5e_light   another plant\n  robert clip convert wave.mcap again.clip.json            the clip inside a take\n  robert clip convert walk.lafan.csv walk.clip.json --robot my_arm --fps 30 --thin 0.01\n  robert clip convert demos walk.clip.json --robot my_arm --episode 3     a LeRobot folder"
)]
pub(super) struct Convert {
    /// The file to read; - is stdin (with --from, unless it is a clip).
    input: PathBuf,
    /// The file to write; - is stdout (with --to, unless it is a clip).
    #[arg(required_unless_present = "out")]
    output: Option<PathBuf>,
    /// The file to write, as in other commands.
    #[arg(short, long, value_name = "FILE", conflicts_with = "output")]
    out: Option<PathBuf>,
    /// The robot of an input that does not name one. If the input is a clip, the robot to convert
    /// it for; its joints must have the same names.
    #[arg(long)]
    robot: Option<String>,
    /// Use the robot and joint order of this clip.
    #[arg(long, value_name = "CLIP", conflicts_with = "robot")]
    like: Option<PathBuf>,
    /// How to fill the frames between imported keys: mask, linear, cubic or hold.
    /// [default: mask]
    #[arg(long, value_parser = super::files::fill_word)]
    fill: Option<Fill>,
    /// Format of the input, if its name does not show it.
    #[arg(long)]
    from: Option<Format>,
    /// Format of the output, if its name does not show it.
    #[arg(long, value_parser = writable())]
    to: Option<Format>,
    /// For MJCF keyframes: also write the robot's model, so that the file loads by itself.
    #[arg(long)]
    with_model: bool,
    #[command(flatten)]
    recorded: Recorded,
    /// Overwrite an existing file.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    Clip,
    Csv,
    Mjcf,
    Ros,
    Json,
    /// A take: the clip that it was made from.
    Mcap,
    /// Rows of base pose and joints, without header or rate (--fps).
    Lafan,
    /// Motion of BeyondMimic and mjlab.
    Npz,
    /// Motion capture of a skeleton like the robot's.
    Bvh,
    /// The messages on /joint_states of a ROS 2 bag.
    Bag,
    /// An episode of a LeRobot dataset.
    Lerobot,
}

impl Format {
    /// The kind of recorded motion, for formats that can only be read.
    fn recorded(self) -> Option<Kind> {
        match self {
            Format::Lafan => Some(Kind::Lafan),
            Format::Npz => Some(Kind::Npz),
            Format::Bvh => Some(Kind::Bvh),
            Format::Bag => Some(Kind::Bag),
            Format::Lerobot => Some(Kind::Lerobot),
            Format::Clip
            | Format::Csv
            | Format::Mjcf
            | Format::Ros
            | Format::Json
            | Format::Mcap => None,
        }
    }
}

/// All formats that clips can be written in. Recorded motion is written by `robert export`.
fn writable() -> impl TypedValueParser<Value = Format> {
    let words =
        Format::value_variants().iter().filter(|f| **f != Format::Mcap && f.recorded().is_none());
    PossibleValuesParser::new(words.filter_map(ValueEnum::to_possible_value))
        .try_map(|word| Format::from_str(&word, false))
}

impl Format {
    fn of(path: &Path, asked: Option<Format>) -> Result<Format, Failure> {
        if let Some(format) = asked {
            return Ok(format);
        }
        let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
        let ends = |end: &str| name.ends_with(end);
        Ok(match () {
            () if path.join("meta/info.json").is_file() => Format::Lerobot,
            () if path.join("metadata.yaml").is_file() => Format::Bag,
            () if ends(".clip.json") || input::is_standard(path) => Format::Clip,
            () if ends(".lafan.csv") => Format::Lafan,
            () if ends(".npz") => Format::Npz,
            () if ends(".bvh") => Format::Bvh,
            () if ends(".csv") => Format::Csv,
            () if ends(".xml") || ends(".mjcf") => Format::Mjcf,
            () if ends(".yaml") || ends(".yml") => Format::Ros,
            () if ends(".json") => Format::Json,
            () if ends(".mcap") => Format::Mcap,
            () => {
                return Err(Failure::usage(format!(
                    "{}: unknown suffix; use .clip.json, .csv, .xml, .yaml, .json, .mcap, .lafan.csv, .npz or .bvh, or name the format with --from or --to",
                    path.display()
                )));
            }
        })
    }
}

pub(super) fn run(a: &Convert) -> Outcome {
    let Some(output) = a.output.as_deref().or(a.out.as_deref()) else {
        return Err(Failure::usage("no file to write is given"));
    };
    let (from, to) = (Format::of(&a.input, a.from)?, Format::of(output, a.to)?);
    let to_stdout = input::is_standard(output);
    if !a.force && !to_stdout && output.exists() {
        let path = output.display();
        return Err(Failure::usage(format!("{path} exists; --force overwrites it")));
    }
    if to.recorded().is_some() {
        return Err(Failure::usage(format!(
            "recorded motion is written by robert export {} --to FORMAT",
            a.input.display()
        )));
    }
    if to == Format::Mcap {
        return Err(Failure::usage(format!(
            "a take is a motion that was performed: robert export {} --to mcap -o {}",
            a.input.display(),
            output.display()
        )));
    }
    let robot = super::files::reference(a.robot.as_deref(), a.like.as_ref())?;
    let clip = read(a, from, robot.as_ref())?;
    if a.with_model && to != Format::Mjcf {
        return Err(Failure::usage("--with-model is only for MJCF (--to mjcf)"));
    }
    let text = text(&clip, to, a)?;
    input::write(output, text.as_bytes())?;
    if to_stdout {
        return Ok(());
    }
    out::line(&format!(
        "{}: {} frames, {} keys, {} joints",
        output.display(),
        clip.length,
        clip.keys.len(),
        clip.dim()
    ))
}

impl Convert {
    /// Refuses `--fill` for an input whose keys have fills already, or get them from the motion.
    fn without_fill(&self, input: &str) -> Outcome {
        match self.fill {
            None => Ok(()),
            Some(_) => Err(Failure::usage(format!(
                "--fill is for rows and keyframes, and {} is {input}",
                input::place(&self.input).display()
            ))),
        }
    }
}

fn read(a: &Convert, from: Format, robot: Option<&RobotRef>) -> Result<Clip, Failure> {
    let place = input::place(&a.input);
    a.recorded.check(from.recorded(), from == Format::Csv)?;
    let adopt = |clip: Clip| match robot {
        Some(robot) => adopted(clip, robot, &a.input),
        None => Ok(clip),
    };
    if from == Format::Clip {
        a.without_fill("a clip")?;
        return adopt(super::files::load(&a.input)?.clip);
    }
    if from == Format::Mcap {
        a.without_fill("a take")?;
        let take = input::take(&a.input)?;
        return adopt(motion::clip_of(&take, &place.display().to_string())?);
    }
    let whose = || {
        Failure::usage(format!(
            "{} does not name its robot; give --robot ID or --like CLIP",
            place.display()
        ))
    };
    if let Some(kind) = from.recorded() {
        a.without_fill("recorded motion")?;
        return a.recorded.clip(&a.input, kind, robot.ok_or_else(whose)?, a.robot.as_deref());
    }
    let cap = limits::PROJECT_BYTES;
    let bytes = input::read(&a.input, cap)?;
    let text = || {
        String::from_utf8(bytes.clone())
            .map_err(|e| Failure::invalid(format!("{}: {e}", place.display())))
    };
    if from == Format::Json
        && let Some(clip) = inside_take(&text()?)
    {
        a.without_fill("a take")?;
        return adopt(clip.map_err(|e| e.in_file(&place))?);
    }
    let fill = a.fill.unwrap_or_default();
    let robot_ref = robot.ok_or_else(whose);
    let clip: Result<Clip, ClipError> = match from {
        Format::Csv => from_csv(&bytes, Some(robot_ref?), fill)
            .map(|clip| in_radians(clip, a.recorded.degrees())),
        Format::Mjcf => from_mjcf(&text()?, robot_ref?, fill),
        Format::Ros => from_ros(&text()?, Some(robot_ref?), fill),
        _ => from_command_json(&text()?, robot, fill),
    };
    Ok(clip.map_err(|e| e.in_file(&place))?)
}

/// The clip with its angles converted, if they are `degrees`.
fn in_radians(mut clip: Clip, degrees: bool) -> Clip {
    if !degrees {
        return clip;
    }
    let units = clip.robot.units.clone();
    let turns = |j: usize| units.get(j).is_none_or(|unit| *unit == Unit::Rad);
    for key in &mut clip.keys {
        let Goal::Q(row) = &mut key.goal else { continue };
        let angles = row.iter_mut().enumerate().filter(|(j, _)| turns(*j));
        angles.for_each(|(_, q)| *q = q.map(f64::to_radians));
    }
    if let Some(Start::Q(row)) = &mut clip.start {
        let angles = row.iter_mut().enumerate().filter(|(j, _)| turns(*j));
        angles.for_each(|(_, q)| *q = q.to_radians());
    }
    clip
}

/// The same clip for another robot, or for another version of its model. The clip keeps its own
/// joint order, and values are found by name.
fn adopted(mut clip: Clip, robot: &RobotRef, path: &Path) -> Result<Clip, Failure> {
    let strangers = |of: &[String], with: &[String]| {
        let odd: Vec<&str> =
            of.iter().filter(|j| !with.contains(j)).map(String::as_str).take(5).collect();
        odd.join(", ")
    };
    let (more, less) = (
        strangers(&clip.robot.joints, &robot.joints),
        strangers(&robot.joints, &clip.robot.joints),
    );
    if !more.is_empty() || !less.is_empty() {
        let dash = |s: String| if s.is_empty() { "none".to_owned() } else { s };
        return Err(Failure::invalid(format!(
            "{}: the joints differ from those of {}: unknown: {}; missing: {}",
            path.display(),
            robot.id,
            dash(more),
            dash(less)
        )));
    }
    let unit =
        |j: &String| robot.joints.iter().position(|r| r == j).and_then(|i| robot.units.get(i));
    let units: Option<Vec<_>> = clip.robot.joints.iter().map(|j| unit(j).copied()).collect();
    clip.robot = RobotRef {
        joints: std::mem::take(&mut clip.robot.joints),
        units: units.unwrap_or_default(),
        ..robot.clone()
    };
    Ok(clip)
}

/// The clip in a take that was exported as JSON; `None` for other documents.
fn inside_take(text: &str) -> Option<Result<Clip, ClipError>> {
    #[derive(serde::Deserialize)]
    struct Outer<'a> {
        format: String,
        #[serde(borrow)]
        clip: Option<&'a serde_json::value::RawValue>,
    }
    let outer: Outer<'_> = serde_json::from_str(text).ok()?;
    if !outer.format.starts_with("robert-take/") {
        return None;
    }
    outer.clip.map(|clip| Clip::parse(clip.get()))
}

fn text(clip: &Clip, to: Format, a: &Convert) -> Outcome<String> {
    let command = super::files::compiled(clip, a.robot.as_deref())?;
    Ok(match to {
        Format::Clip => clip.to_text(),
        Format::Csv => to_csv(&command),
        Format::Mjcf if a.with_model => {
            let robot = motion::robot_for(a.robot.as_deref(), &clip.robot.id)?;
            let place = input::place(&a.input).display().to_string();
            motion::with_model(&robot, &to_mjcf(&motion::command(clip, &robot, &place)?)?)?
        }
        Format::Mjcf => to_mjcf(&command)?,
        Format::Ros => to_ros(&command)?,
        _ => to_command_json(&command, &clip.robot.id),
    })
}
