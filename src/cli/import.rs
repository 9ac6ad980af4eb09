//! `robert import FILE --out DIR`: makes a robot folder from a URDF or MJCF.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::failure::{Failure, Outcome};
use super::{input, out};
use crate::child::{self, Rights};
use crate::exit::Exit;
use crate::fsio;
use crate::limits;
use crate::robot::check;
use crate::robot::import::{Drives, ImportConfig, Report, Servos, import};

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert import arm.urdf --out arm --package arm_description=../arm_description\n  robert import scene/hand.xml --root scene/.. --out hand\n  xacro arm.urdf.xacro | robert import - --out arm --package arm_description=../arm_description\n  robert robots show ./arm"
)]
pub(super) struct Args {
    /// The model: URDF or MJCF, also of MuJoCo 3, or - for stdin, read as if it lay in the current
    /// folder.
    file: PathBuf,
    /// The folder to make.
    #[arg(short, long)]
    out: PathBuf,
    #[command(flatten)]
    model: ModelFlags,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

/// Options for reading a foreign model; shared with `robert new`.
#[derive(clap::Args, Debug)]
pub(super) struct ModelFlags {
    /// The folder that must contain all includes and meshes [default: the file's own].
    #[arg(long, value_name = "DIR")]
    root: Option<PathBuf>,
    /// Folder of a ROS package, for paths such as `package://NAME/arm.stl`. May be repeated.
    #[arg(long = "package", value_name = "NAME=DIR")]
    packages: Vec<String>,
    /// The robot's id [default: the folder's name].
    #[arg(long)]
    pub(super) id: Option<String>,
    /// Fix a floating base in place.
    #[arg(long)]
    fixed_base: bool,
    /// Height of a URDF's root above the floor, m.
    #[arg(long, value_name = "M", default_value_t = 0.0, allow_negative_numbers = true)]
    base_height: f64,
    /// Force limit of motors whose source names none, N m or N [default: enough to carry the robot].
    #[arg(long, allow_negative_numbers = true)]
    effort: Option<f64>,
    /// Weld joints at their zeros. May be repeated.
    #[arg(long = "weld", value_name = "JOINT,...", value_delimiter = ',')]
    weld: Vec<String>,
    /// Leave bodies out, with everything that refers to them (MJCF). May be repeated.
    #[arg(long, value_name = "BODY,...", value_delimiter = ',')]
    without: Vec<String>,
    /// Leave out meshes whose files are missing, also those that collide, and textures.
    #[arg(long)]
    without_meshes: bool,
    /// Whether position and velocity servos are kept, with their control as the action, or replaced
    /// by torque motors.
    #[arg(long, value_enum, default_value_t = ServoFlag::Keep)]
    actuators: ServoFlag,
    /// Whether joints whose file describes no drive get an assumed one, or stay as in the file.
    #[arg(long, value_enum, default_value_t = DriveFlag::Modelled)]
    drives: DriveFlag,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum ServoFlag {
    /// Servos as in the file.
    Keep,
    /// Motors with the same force limit.
    Torque,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum DriveFlag {
    /// Inertia and damping in proportion to the torque limit.
    Modelled,
    /// Joints as in the file.
    File,
}

pub(super) fn run(args: &Args) -> Outcome {
    // It reads foreign files; what it writes is a folder of its own.
    child::confine(&Rights { file_bytes: Some(limits::CHILD_FILE_BYTES), ..Rights::default() })?;
    let report = if input::is_standard(&args.file) || input::is_pipe(&args.file) {
        received(args)?
    } else {
        import(&args.model.plan(&args.file, &args.out)?)?
    };
    if args.json {
        return out::json(&report);
    }
    print(&report)
}

/// Imports a model from stdin or a pipe, as if it lay in the current folder. An import reads its file several times, so
/// a hidden file has the text until the import has ended.
fn received(args: &Args) -> Outcome<Report> {
    let text = input::read(&args.file, limits::MODEL_BYTES)?;
    let kept = fsio::temporary_with(Path::new("."), &text).map_err(|e| {
        let why = format!("the current folder cannot hold the model while it is read: {e}");
        Failure::with(Exit::Failed, format!("{why}; save the model as a file and import that"))
    })?;
    let name = input::place(&args.file).display().to_string();
    let mut plan = args.model.plan(kept.path(), &args.out)?;
    plan.source_name = Some(name.clone());
    import(&plan).map_err(|e| {
        let failure = Failure::from(e);
        // The user does not know the file.
        let said = failure.sentence().replace(&kept.path().display().to_string(), &name);
        Failure::with(failure.exit(), said)
    })
}

impl ModelFlags {
    /// Whether an option but the id was given that changes what is read from a model.
    pub(super) fn are_given(&self) -> bool {
        let ModelFlags {
            root,
            packages,
            id: _,
            fixed_base,
            base_height,
            effort,
            weld,
            without,
            without_meshes,
            actuators,
            drives,
        } = self;
        let lists = [packages, weld, without];
        root.is_some()
            || effort.is_some()
            || *fixed_base
            || *base_height != 0.0
            || *without_meshes
            || lists.iter().any(|list| !list.is_empty())
            || *actuators != ServoFlag::Keep
            || *drives != DriveFlag::Modelled
    }

    /// The checked values.
    pub(super) fn plan(&self, source: &Path, out: &Path) -> Outcome<ImportConfig> {
        let mut packages = BTreeMap::new();
        for word in &self.packages {
            let (name, dir) = word
                .split_once('=')
                .filter(|(n, d)| !n.is_empty() && !d.is_empty())
                .ok_or_else(|| Failure::usage(format!("--package {word}: write NAME=DIR")))?;
            packages.insert(name.to_owned(), PathBuf::from(dir));
        }
        Ok(ImportConfig {
            root: self.root.clone(),
            packages,
            id: self.id.clone(),
            fixed_base: self.fixed_base,
            base_height_m: self.base_height,
            effort: self.effort,
            weld: self.weld.clone(),
            without: self.without.clone(),
            without_meshes: self.without_meshes,
            servos: match self.actuators {
                ServoFlag::Keep => Servos::Keep,
                ServoFlag::Torque => Servos::Torque,
            },
            drives: match self.drives {
                DriveFlag::Modelled => Drives::Modelled,
                DriveFlag::File => Drives::File,
            },
            ..ImportConfig::new(source, out, check::executable()?)
        })
    }
}

/// How much of a mass moves, if it is not all.
pub(super) fn still(mass: f64, moving: f64) -> String {
    if mass - moving > 5e-4 { format!(" ({moving:.3} kg of it move)") } else { String::new() }
}

fn print(r: &Report) -> Outcome {
    out::line(&format!(
        "{}: state {}, action {}, {} bodies, {} files, {:.3} kg{}, from {}",
        r.id,
        r.state_dim,
        r.action_dim,
        r.bodies,
        r.files,
        r.mass_kg,
        still(r.mass_kg, r.moving_kg),
        r.format.to_uppercase()
    ))?;
    for (what, list) in [
        ("dropped", &r.dropped),
        ("assumed", &r.assumed),
        ("changed", &r.changed),
        ("warning", &r.warnings),
    ] {
        for item in list {
            out::line(&format!("  {what}  {item}"))?;
        }
    }
    out::line(&format!("use it:  robert robots show {}", out::word(&r.folder)))
}
