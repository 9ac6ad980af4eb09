//! Writes the inputs of an export in the chosen format, and reports what the files contain.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::json;

use super::args::Args;
use super::format::{BodiesArg, Format, UrArg};
use super::source::{Source, title};
use crate::cli::failure::{Failure, Outcome};
use crate::cli::global::Global;
use crate::cli::{input, motion, out, output};
use crate::robot::Robot;
use crate::take::export::{
    Export, RosOptions, TRACKING_FPS, bag, bvh, glb, lafan, ros, tracking, ur_script, usda,
};
use crate::take::viser::Recording;
use crate::take::{Take, What, html};
use crate::units::FPS;
use crate::{fsio, limits};

/// One input, written.
pub(super) struct Made {
    pub source: Source,
    pub export: Export,
    pub path: PathBuf,
    pub files: Vec<PathBuf>,
}

/// Prints what the numbers mean and which program opens the file.
pub(super) fn say(export: &Export, path: Option<&Path>, global: Global) {
    if global.quiet {
        return;
    }
    let place = path.map_or_else(|| "FILE".to_owned(), |p| p.display().to_string());
    for sentence in &export.meaning {
        out::aside(sentence.replace(Export::OUT, &place));
    }
    out::aside(format_args!("open it:  {}", export.open.replace(Export::OUT, &place)));
}

/// The settings that apply to every input.
pub(super) struct Plan<'a> {
    pub(super) args: &'a Args,
    pub(super) rename: BTreeMap<String, String>,
    /// The viser client, for a page.
    client: Option<Vec<u8>>,
}

impl Plan<'_> {
    pub(super) fn new(args: &Args) -> Outcome<Plan<'_>> {
        // Before any work: the page may be missing.
        let client = match (args.to, &args.viser_client) {
            (Format::Html, Some(path)) => Some(fsio::read_capped(path, limits::MESH_BYTES)?),
            (Format::Html, None) => Some(html::client()?),
            _ => None,
        };
        let rename = args.rename.as_deref().map(input::names).transpose()?.unwrap_or_default();
        Ok(Plan { args, rename, client })
    }

    /// The output of each input; `-` is stdout.
    ///
    /// # Errors
    /// An output that is one of the inputs, was made by hand, or belongs to two inputs.
    pub(super) fn outputs(&self) -> Outcome<Vec<PathBuf>> {
        let args = self.args;
        let many = args.inputs.len() > 1;
        let output = |input: &String| {
            let name = format!("{}.{}", title(input), args.to.suffix());
            match &args.out {
                Some(dir) if many => dir.join(name),
                Some(path) => path.clone(),
                None if args.to.is_printed() && !many => PathBuf::from("-"),
                None => PathBuf::from(name),
            }
        };
        let outputs: Vec<PathBuf> = args.inputs.iter().map(output).collect();
        for (i, path) in outputs.iter().enumerate().filter(|(_, p)| !input::is_standard(p)) {
            output::may_write(&args.inputs, Some(path))?;
            if let Some(other) = outputs.iter().take(i).position(|p| p == path) {
                let (a, b) = (&args.inputs[other], &args.inputs[i]);
                return Err(Failure::usage(format!(
                    "{a} and {b} would both become {}: export them one by one, with -o",
                    path.display()
                )));
            }
        }
        Ok(outputs)
    }

    fn ros_options(&self, robot: Option<&Arc<Robot>>) -> Outcome<RosOptions> {
        let flags = &self.args.ros;
        Ok(RosOptions {
            lead_in_secs: flags.lead_in,
            goal: flags.goal,
            effort: flags.effort,
            rename: self.rename.clone(),
            ranges: robot.map(|r| r.joints().iter().map(|j| j.range).collect()),
            motorised: robot.map(|r| r.motorised()).transpose()?,
        })
    }

    /// One input in the format.
    pub(super) fn export(&self, source: &Source) -> Outcome<Export> {
        let (args, take) = (self.args, &source.take);
        let what = What::from(args.what);
        let known = source.robot.as_ref().ok();
        Ok(match args.to {
            Format::Glb => glb(take, source.robot()?, &source.title)?,
            Format::Bvh => bvh(take, source.robot()?)?,
            Format::Usda => usda(take, source.robot()?)?,
            Format::Lafan => lafan(take, source.robot()?, args.fps.unwrap_or(FPS))?,
            Format::Npz => {
                let fps = args.fps.unwrap_or(TRACKING_FPS);
                tracking(
                    take,
                    source.robot()?,
                    fps,
                    args.bodies.unwrap_or(BodiesArg::Mujoco).into(),
                )?
            }
            Format::Ros => ros(take, what, &self.ros_options(known)?)?,
            Format::Bag => bag(take, what, &self.ros_options(known)?)?,
            Format::Ur => {
                ur_script(take, what, args.ur_move.unwrap_or(UrArg::Servoj).into(), &source.title)?
            }
            _ => self.own(source, what)?,
        })
    }

    /// Writes one of the formats that are a single file.
    fn own(&self, source: &Source, what: What) -> Outcome<Export> {
        let take = &source.take;
        let out = Export::OUT;
        let (bytes, meaning, open) = match self.args.to {
            Format::Csv => (
                take.to_csv(what).into_bytes(),
                "A row a frame: frame, time (s), 1 where masked, joints (rad, or m).",
                format!("python -c \"import pandas; print(pandas.read_csv('{out}'))\""),
            ),
            Format::Json => (
                take.to_json(what).into_bytes(),
                "Positions in rad or m, velocities in rad/s or m/s, efforts in N m or N; null is masked.",
                format!("python -m json.tool {out}"),
            ),
            Format::Mjcf => {
                let keys = take.to_mjcf(what)?;
                let (text, open) = if self.args.with_model {
                    let open = format!("python -m mujoco.viewer --mjcf={out}");
                    (motion::with_model(source.robot()?, &keys)?, open)
                } else {
                    // Keyframes alone have no bodies to show.
                    let robot = &take.robot.id;
                    let open = format!("robert clip convert {out} again.clip.json --robot {robot}");
                    (keys, open)
                };
                (
                    text.into_bytes(),
                    "A key a frame: qpos and qvel of the simulator, controls in N m or N.",
                    open,
                )
            }
            Format::Viser => (
                Recording::of(take, source.robot()?)?.to_bytes()?,
                "A recording of the scene, for the viser client (pip install viser), which plays it at http://localhost:8000/?playbackPath=take.viser",
                format!(
                    "viser-build-client --out-dir player && cp {out} player/take.viser && python -m http.server -d player"
                ),
            ),
            Format::Html => {
                let recording = Recording::of(take, source.robot()?)?.to_bytes()?;
                let client = self.client.clone().unwrap_or_default();
                (
                    html::page(&client, &source.title, &html::caption(take), &recording)?,
                    "A page with the recording inside; it needs no network.",
                    format!("xdg-open {out}"),
                )
            }
            _ => (
                Self::take_file(take, &source.robot)?,
                "The take: joint states, transforms and figures, for Foxglove, Lichtblick and Rerun.",
                format!("rerun {out}"),
            ),
        };
        Ok(Export::single(bytes, take.frames(), open).says(meaning))
    }

    fn take_file(take: &Take, robot: &Outcome<Arc<Robot>>) -> Outcome<Vec<u8>> {
        if let Ok(robot) = robot {
            let scene = take.scene(robot)?;
            if let Some(what) = scene.left_out() {
                tracing::warn!("{what}");
            }
            return Ok(take.to_mcap(Some(&scene))?);
        }
        tracing::warn!(
            "robot {} is not known here: no geometry in the take; give it with --robot",
            take.robot.id
        );
        Ok(take.to_mcap(None)?)
    }

    /// Prints what was written, as a line or as JSON.
    pub(super) fn report(&self, made: &[Made]) -> Outcome {
        if !self.args.json {
            for m in made {
                let (frames, bytes) = (m.export.frames, m.export.bytes());
                out::line(&format!("{}: {frames} frames, {bytes} bytes", m.path.display()))?;
            }
            return Ok(());
        }
        let frames: usize = made.iter().map(|m| m.export.frames).sum();
        let bytes: usize = made.iter().map(|m| m.export.bytes()).sum();
        let files: Vec<&PathBuf> = made.iter().flat_map(|m| &m.files).collect();
        let mut report = json!({
            "format": self.args.to.name(),
            "files": files,
            "frames": frames,
            "bytes": bytes,
        });
        if let [m] = made {
            let precision = m.source.take.precision();
            report["out"] = json!(m.path);
            report["robot"] = json!(m.source.take.robot.id);
            report["policy"] = json!(m.source.take.provenance.policy);
            report["precision"] = json!(precision.precision);
            report["masked_mae"] = json!(precision.masked_mae);
            report["frames_reached"] = json!(m.source.take.frames());
        }
        out::json(&report)
    }
}
