//! Converts motion that other programs recorded to clips.

use std::path::{Path, PathBuf};

use clap::ValueEnum;

use super::super::failure::{Failure, Outcome};
use super::super::{input, motion};
use crate::child::{self, Rights};
use crate::clip::{Clip, RobotRef};
use crate::limits;
use crate::take::export::{Bodies, Skeleton};
use crate::take::import::{
    LeRobotSource, Samples, from_bag, from_bvh, from_lafan, from_lerobot, from_tracking,
};
use crate::{fsio, take};

/// Memory for reading a foreign table, whose pages say themselves how large they unpack.
const MEMORY_BYTES: u64 = 4 << 30;

/// Options for clips from recorded motion.
#[derive(clap::Args, Debug)]
pub(super) struct Recorded {
    /// Rows per second: required for LAFAN rows, which do not contain it (LAFAN1 30, robert export
    /// 20); replaces the rate of an npz file.
    #[arg(long, value_name = "HZ")]
    fps: Option<f64>,
    /// Allowed distance between keys and recorded motion, rad or m; 0 keeps every frame. The default is
    /// 0.005.
    #[arg(long, value_name = "TOLERANCE")]
    thin: Option<f64>,
    /// The episode of a LeRobot dataset, from 0, which is the default.
    #[arg(long)]
    episode: Option<u32>,
    /// The column of a LeRobot dataset; observation.state by default.
    #[arg(long)]
    column: Option<String>,
    /// The angles of a LeRobot dataset or of a CSV are degrees.
    #[arg(long)]
    degrees: bool,
    /// Order of the joints in an npz file; mujoco by default.
    #[arg(long, value_enum)]
    bodies: Option<Order>,
    /// Rename joints of the file: a file with TOML lines such as elbow_flex = "elbow_joint", the
    /// robot's name last.
    #[arg(long, value_name = "FILE")]
    rename: Option<PathBuf>,
}

/// [`Bodies`] as it is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Order {
    /// Depth first: MuJoCo, mjlab.
    Mujoco,
    /// Breadth first: PhysX, Isaac Lab.
    Isaac,
}

/// Formats of recorded motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Lafan,
    Npz,
    Bvh,
    Bag,
    Lerobot,
}

impl Recorded {
    /// Whether the angles are degrees.
    pub(super) fn degrees(&self) -> bool {
        self.degrees
    }

    /// Refuses options that an input of this kind does not have; `None` is one that is not recorded motion.
    pub(super) fn check(&self, kind: Option<Kind>, is_csv: bool) -> Outcome {
        let of = |kinds: &[Kind]| kind.is_some_and(|kind| kinds.contains(&kind));
        let given = [
            ("--fps", self.fps.is_some(), of(&[Kind::Lafan, Kind::Npz])),
            ("--thin", self.thin.is_some(), kind.is_some()),
            ("--episode", self.episode.is_some(), of(&[Kind::Lerobot])),
            ("--column", self.column.is_some(), of(&[Kind::Lerobot])),
            ("--degrees", self.degrees, is_csv || of(&[Kind::Lerobot])),
            ("--bodies", self.bodies.is_some(), of(&[Kind::Npz])),
            ("--rename", self.rename.is_some(), kind.is_some()),
        ];
        match given.iter().find(|(_, is_given, is_read)| *is_given && !is_read) {
            Some((name, ..)) => Err(Failure::usage(format!(
                "{name} has no meaning for an input of this format; robert clip convert --help says which have it"
            ))),
            None => Ok(()),
        }
    }

    /// The clip of a recording for a robot; `id` is the robot as it was typed.
    pub(super) fn clip(
        &self,
        path: &Path,
        kind: Kind,
        robot: &RobotRef,
        id: Option<&str>,
    ) -> Outcome<Clip> {
        let thin = self.thin.unwrap_or(0.005);
        if !(0.0..=10.0).contains(&thin) {
            return Err(Failure::usage(format!("--thin takes 0 to 10, not {thin}")));
        }
        let rename = self.rename.as_deref().map(input::names).transpose()?.unwrap_or_default();
        let place = input::place(path);
        let samples = self.samples(path, kind, robot, id)?;
        let clip = samples.clip(robot, &rename, thin);
        Ok(clip.map_err(|e| e.in_file(&place))?)
    }

    fn samples(
        &self,
        path: &Path,
        kind: Kind,
        robot: &RobotRef,
        id: Option<&str>,
    ) -> Outcome<Samples> {
        let place = input::place(path);
        let of = |e: take::Error| e.in_file(&place);
        let text = || -> Outcome<String> {
            String::from_utf8(input::read(path, limits::PROJECT_BYTES)?)
                .map_err(|e| Failure::invalid(format!("{}: {e}", place.display())))
        };
        // The model is loaded before rights are given up.
        let joints = match (kind, self.bodies) {
            (Kind::Npz, Some(Order::Isaac)) => {
                let robot = motion::robot_for(id, &robot.id)?;
                let order = Skeleton::of(&robot)?.joint_order(Bodies::Isaac);
                order.iter().map(|j| robot.joints()[*j].name.clone()).collect()
            }
            _ => robot.joints.clone(),
        };
        Ok(match kind {
            Kind::Lafan => {
                let fps = self.fps.ok_or_else(|| {
                    Failure::usage(format!(
                        "{} does not say its rate: give --fps (LAFAN1 has 30, robert export writes 20)",
                        place.display()
                    ))
                })?;
                from_lafan(&input::read(path, limits::PROJECT_BYTES)?, &joints, fps).map_err(of)?
            }
            Kind::Npz => {
                let bytes = input::read(path, limits::PROJECT_BYTES)?;
                from_tracking(&bytes, &joints, self.fps).map_err(of)?
            }
            Kind::Bvh => {
                let robot = motion::robot_for(id, &robot.id)?;
                from_bvh(&text()?, &robot).map_err(of)?
            }
            Kind::Bag => {
                let file = if path.is_dir() { recording(path)? } else { path.to_owned() };
                let bytes = input::read(&file, limits::TAKE_BYTES)?;
                from_bag(&bytes).map_err(|e| e.in_file(&file))?
            }
            Kind::Lerobot => {
                child::confine(&Rights { memory_bytes: Some(MEMORY_BYTES), ..Rights::default() })?;
                let source = LeRobotSource {
                    episode: i64::from(self.episode.unwrap_or(0)),
                    column: self.column.clone().unwrap_or_else(|| "observation.state".to_owned()),
                    degrees: self.degrees,
                };
                from_lerobot(path, &source)?
            }
        })
    }
}

/// The MCAP file in the folder of a bag.
fn recording(dir: &Path) -> Outcome<PathBuf> {
    let failed = |source| fsio::Error::Read { source, path: dir.to_owned() };
    let mut found: Vec<PathBuf> = Vec::new();
    for entry in dir.read_dir().map_err(failed)?.take(limits::PROJECT_FILES) {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_some_and(|e| e == "mcap") {
            found.push(path);
        }
    }
    match &found[..] {
        [one] => Ok(one.clone()),
        [] => Err(Failure::invalid(format!(
            "{}: no .mcap file; bags of SQLite are converted by: ros2 bag convert",
            dir.display()
        ))),
        _ => Err(Failure::invalid(format!(
            "{}: several .mcap files; give one of them with --from bag",
            dir.display()
        ))),
    }
}
