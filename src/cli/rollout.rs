//! `robert rollout CLIP`: performs a clip with a policy.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::arrivals::{arrivals, said};
use super::failure::{Failure, Outcome};
use super::global::Global;
use super::perform::{PerformArgs, Performed, perform};
use super::{input, interrupt, motion, out, output};
use crate::clip::formats::motion_to_csv;
use crate::clip::lint;
use crate::exit::HasExit as _;
use crate::robot::PlantConfig;
use crate::rollout::{ClipFacts as _, GapFigures, Precision, Rollout, Settler, Trial};
use crate::units::{CTRL_DT, short_unit, significant};

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert rollout wave.clip.json --policy ilqr --out wave.mcap\n  robert rollout ur5e/reacher --policy pd --guide linear\n  robert rollout fire --policy computed-torque --plant mass=1.25,damping=1.5,gear=0.85 --json\n\nThe milliseconds per frame (ms_per_frame in JSON) are those of the rollout alone: the policy and the\nsimulation. Where auto or +ilc chose among finished rollouts, there are none. wall_secs also contains\nloading and comparing policies."
)]
pub(super) struct Args {
    /// A clip file (- is stdin), or the name of a built-in task (robert tasks ls).
    clip: String,
    #[command(flatten)]
    perform: PerformArgs,
    /// Write a take: an MCAP file for Foxglove, Lichtblick, Rerun and robert export; - is stdout.
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the reached motion as CSV: frame, time, mask, one column per joint; - is stdout.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The Precision from which poses that cannot be held are looked for, rad or m.
const SEEN: f64 = 0.005;
/// The number of such poses that are shown.
const SHOWN: usize = 3;
/// The most keys and poses that are settled for `unreachable`: each takes about a hundredth of a
/// second.
const SETTLED: usize = 100;

/// Why there is no Precision.
const NOTHING_ASKED: &str = "none: the clip has no goals after frame 0 (add a key, or unmask one)";

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    let standard = [&args.out, &args.csv].into_iter().flatten().filter(|p| input::is_standard(p));
    let taken = match standard.count() + usize::from(args.json) {
        0 | 1 => {
            !args.json
                && [&args.out, &args.csv].into_iter().flatten().any(|p| input::is_standard(p))
        }
        _ => {
            return Err(Failure::usage("only one of --out, --csv and --json can go to stdout"));
        }
    };
    // A film under the name of a take would be a file that no player opens.
    const OTHERS: [&str; 6] = ["mp4", "gif", "png", "apng", "html", "csv"];
    let extension = args.out.as_deref().and_then(Path::extension).unwrap_or_default();
    if OTHERS.iter().any(|other| extension.eq_ignore_ascii_case(other)) {
        let (clip, file) = (&args.clip, args.out.as_deref().unwrap_or(Path::new("")));
        return Err(Failure::usage(format!(
            "--out writes a take (MCAP), not {}: {}",
            file.display(),
            match extension.to_string_lossy().to_lowercase().as_str() {
                "csv" => "use --csv for the reached motion".to_owned(),
                "html" => format!("use `robert export {clip} --to html`"),
                _ => format!("use `robert render {clip} -o {}`", file.display()),
            }
        )));
    }
    for out in [&args.out, &args.csv] {
        output::may_write(std::slice::from_ref(&args.clip), out.as_deref())?;
    }
    let mut done = perform(&args.clip, &args.perform, global)?;
    // The reached motion is kept even if the rollout ended early.
    if let Some(path) = &args.csv {
        write_csv(path, &done.rollout)?;
    }
    if let Some(path) = &args.out {
        let take = done.take()?;
        let scene = take.scene(&done.robot)?;
        if let Some(what) = scene.left_out() {
            tracing::warn!("{what}");
        }
        if input::is_standard(path) {
            out::bytes(&take.to_mcap(Some(&scene))?)?;
        } else {
            take.write(path, Some(&scene))?;
        }
    }
    if let Some(e) = done.broke.take() {
        let exit = e.exit();
        let kept = [&args.out, &args.csv].into_iter().flatten().map(|p| p.display().to_string());
        let kept = kept.collect::<Vec<_>>().join(" and ");
        let kept =
            if kept.is_empty() { kept } else { format!("; the frames before that are in {kept}") };
        return Err(Failure::with(exit, format!("{e}{kept}")));
    }
    let precision = done.rollout.precision();
    if args.json {
        let cancel = interrupt::cancel_on_ctrl_c();
        let gap = GapFigures::of(&mut done.rollout, &|| cancel.is_cancelled());
        let mut report = report(args, &done, &precision);
        report["gap"] = json!(gap);
        report["unreachable"] = unreachable(&done)?;
        return out::json(&report);
    }
    let unit = motion::unit(&done.robot);
    let mut text = summary(&done, &precision, unit);
    text.push_str(&tried(&done, unit));
    if precision.precision.is_some_and(|p| p > SEEN) {
        text.push_str(&cannot_hold(&unreachable(&done)?, &done.robot));
    }
    input::say(taken, &text)
}

fn report(args: &Args, done: &Performed, p: &Precision) -> Value {
    let rollout = &done.rollout;
    let joints = rollout.robot().joints().iter().zip(&p.per_joint);
    json!({
        "clip": args.clip,
        "robot": rollout.robot().id(),
        "unit": motion::unit(rollout.robot()),
        "policy": done.policy.label(),
        "chosen": (!done.tried.is_empty()).then(|| done.policy.label()),
        "tried": (!done.tried.is_empty()).then_some(&done.tried),
        "stopped": done.stopped,
        "uses_model": done.uses_model(),
        "seed": done.config.seed,
        "plant": done.config.plant,
        "precision": p.precision,
        "why_none": p.precision.is_none().then_some(NOTHING_ASKED),
        "moving": p.moving,
        "hold_motion": rollout.hold_motion(),
        "masked_mae": p.masked_mae,
        "p95": p.p95,
        "worst": p.worst.map(|(frame, error)| json!({"frame": frame, "error": error})),
        "hold_end": p.hold_end,
        "frames_late": p.frames_late,
        "mean_abs_du": p.mean_abs_du,
        "saturation": p.saturation,
        "frames": rollout.frame() + 1,
        "secs": rollout.frame() as f64 * CTRL_DT,
        "wall_secs": done.wall_secs,
        "ms_per_frame": done.ms_per_frame(),
        "per_joint": joints
            .map(|(j, e)| json!({"joint": j.name, "error": e}))
            .collect::<Vec<_>>(),
        "holds": p.holds,
        "arrivals": arrivals(done),
        "per_frame": p.per_frame,
        "out": args.out,
    })
}

/// The end-effector goals that are out of reach and the poses that the robot cannot hold, with the
/// distance that stays; null if the clip has too many keys to settle each of them.
fn unreachable(done: &Performed) -> Outcome<Value> {
    let (clip, robot) = (&done.clip, done.robot.as_ref());
    if clip.keys.len() + clip.poses.len() > SETTLED {
        return Ok(Value::Null);
    }
    let mut settler = Settler::new(robot)?;
    let lints = lint(clip, &done.command, &robot.joint_table(), Some(&mut settler));
    let poses = lints.iter().filter_map(|l| l.settled.as_ref());
    let said = poses.map(|s| json!({"frames": s.held, "joint": s.joint, "distance": s.distance}));
    let missed = done.command.reached().iter().filter(|r| !r.reached).map(|r| {
        let (point, frames) = (r.instead.point.name(), [[r.frame, r.frame + 1]]);
        json!({"frames": frames, "point": point, "distance": r.distance_m, "angle": r.angle_rad})
    });
    Ok(missed.chain(said).collect())
}

/// The poses among what is [`unreachable`], for people.
fn cannot_hold(found: &Value, robot: &crate::robot::Robot) -> String {
    let all = found.as_array().map(Vec::as_slice).unwrap_or_default();
    let pose = |one: &Value| -> Option<String> {
        let span = one["frames"].as_array()?.first()?;
        let (from, to) = (span[0].as_u64()?, span[1].as_u64()?.saturating_sub(1));
        let (joint, distance) = (one["joint"].as_str()?, one["distance"].as_f64()?);
        let unit = robot.joints().get(robot.joint_index(joint).ok()?)?.unit.symbol();
        let frames =
            if from == to { format!("frame {from}") } else { format!("frames {from} to {to}") };
        Some(format!("{frames} ({joint} stays {distance:.3} {unit} away)"))
    };
    let poses: Vec<String> = all.iter().filter_map(pose).collect();
    if poses.is_empty() {
        return String::new();
    }
    let more = poses.len().saturating_sub(SHOWN);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!(
        "\n  the robot cannot hold its poses at {}{more}; robert clip check --simulate says more",
        poses.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ")
    )
}

fn summary(done: &Performed, p: &Precision, unit: &str) -> String {
    let rollout = &done.rollout;
    // All rows have one unit, so that they can be compared at a glance.
    let (factor, unit) = short_unit(unit, p.precision.unwrap_or(0.0));
    let figure = |v: f64| format!("{} {unit}", significant(v * factor));
    let value = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), figure);
    let late = p.frames_late.map_or_else(|| "-".to_owned(), |v| format!("{v:.1} frames"));
    let what = if p.precision.is_some() {
        "mean |error|, unmasked frames, all joints"
    } else {
        NOTHING_ASKED
    };
    let mut rows = vec![
        ("Precision", value(p.precision), what),
        ("p95", value(p.p95), "95th percentile of |error|"),
    ];
    let worst =
        p.worst.map_or_else(|| "-".to_owned(), |(f, e)| format!("{}, frame {f}", figure(e)));
    rows.push(("worst frame", worst, "the largest mean |error| of a frame"));
    let joints = rollout.robot().joints().iter().zip(&p.per_joint);
    let farthest = joints.filter_map(|(j, e)| Some((j, (*e)?)));
    if let Some((joint, e)) = farthest.max_by(|a, b| a.1.total_cmp(&b.1)) {
        rows.push(("worst joint", format!("{}, {}", figure(e), joint.name), "its mean |error|"));
    }
    if !p.holds.is_empty() {
        rows.push(("end of holds", value(p.hold_end), "mean |error| in their last frame"));
        rows.push(("late", late, "from the start of a hold until within 0.05"));
    }
    let arrived = said(&arrivals(done));
    if let Some((figure, what)) = &arrived {
        rows.push(("end effectors", figure.clone(), what));
    }
    rows.push((
        "mean |du|",
        format!("{:.4}", p.mean_abs_du),
        "mean change of action per frame, of 1",
    ));
    let pinned = format!("{:.1} %", 100.0 * p.saturation);
    rows.push(("saturated", pinned, "actions at their bound"));
    let frames = rollout.frame() + 1;
    let time = format!("{frames} frames in {:.2} s", done.wall_secs);
    let with = if done.tried.is_empty() {
        "with loading the policy"
    } else {
        "with loading and comparing policies"
    };
    rows.push(("time", time, with));
    let wide = rows.iter().map(|r| r.1.chars().count()).max().unwrap_or(0);
    let mut text = format!(
        "{} on {}{}{}",
        done.policy.label(),
        rollout.robot().id(),
        done.ms_per_frame().map_or_else(String::new, |ms| format!(", {ms:.2} ms per frame")),
        if done.uses_model() { "; uses a model of the robot" } else { "" }
    );
    for (name, value, what) in rows {
        text.push_str(format!("\n  {name:<13} {value:<wide$}  {what}").trim_end());
    }
    text
}

/// The policies that auto tried, best first; empty if a policy was named.
fn tried(done: &Performed, unit: &str) -> String {
    let Some(least) = done.tried.iter().filter_map(|t| t.precision).min_by(f64::total_cmp) else {
        return String::new();
    };
    let (factor, unit) = short_unit(unit, least);
    let mut list: Vec<_> = done.tried.iter().collect();
    let error = |t: &Trial| t.precision.unwrap_or(f64::INFINITY);
    list.sort_by(|a, b| error(a).total_cmp(&error(b)));
    let each = list.iter().map(|t| match t.precision {
        Some(p) => format!("{} {} {unit}", t.policy, significant(p * factor)),
        None => format!("{} failed", t.policy),
    });
    let each = each.collect::<Vec<_>>().join(", ");
    let chosen = list.iter().find(|t| t.policy == done.policy.label());
    let close = if chosen.is_some_and(|t| error(list[0]) < error(t)) {
        "; those with less error move less naturally in gaps or holds, miss a frame by more, or leave a tendon farther from its length"
    } else {
        ""
    };
    let plant = if done.config.plant == PlantConfig::default() {
        ""
    } else {
        ", without the changes of --plant"
    };
    format!("\n  chosen by simulating {}{plant}: {each}{close}", list.len())
}

/// Reached states; `mask` is 1 where nothing was commanded.
fn write_csv(path: &Path, rollout: &Rollout) -> Outcome {
    let joints: Vec<String> = rollout.robot().joints().iter().map(|j| j.name.clone()).collect();
    let rows = rollout.frames_reached().map(|frame| {
        let masked = !rollout.goals().any_visible(frame.frame);
        (frame.frame as i64, masked, frame.reached.iter().map(Some))
    });
    input::write(path, motion_to_csv(&joints, rows).as_bytes())
}
