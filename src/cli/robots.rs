//! `robert robots ls|show|settle`: information about robots.

use serde_json::{Value, json};

use super::failure::{Failure, Outcome};
use super::out;
use crate::kinematics::{Place, Point};
use crate::mujoco::{Data, Kind, Model};
use crate::rng::{Rng, Stream};
use crate::robot::{Drive, Robot, Settled};
use crate::units::{CTRL_DT, SUBSTEPS, Unit, fixed};

#[derive(clap::Subcommand, Debug)]
#[command(
    after_help = "Examples:\n  robert robots ls\n  robert robots show shadow_hand\n  robert robots settle shadow_hand --pose rock\n  robert robots settle ur5e --set elbow=0.7 --set wrist_1=-1"
)]
pub(super) enum Args {
    /// List the built-in robots.
    #[command(
        after_help = "Examples:\n  robert robots ls\n  robert robots ls --json | jq '.[].id'"
    )]
    Ls {
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Show a robot: joints, motors, groups, poses.
    #[command(
        after_help = "Examples:\n  robert robots show shadow_hand\n  robert robots show my_arm --toml > new.toml   (edit it, then mv new.toml my_arm/profile.toml)"
    )]
    Show {
        /// Id, or a folder with robot.xml.
        robot: String,
        /// Print JSON.
        #[arg(long)]
        json: bool,
        /// Print the complete profile as TOML, including derived values.
        #[arg(long, conflicts_with = "json")]
        toml: bool,
    },
    /// Drive to a pose in simulation, and report the reached pose and its error.
    #[command(
        after_help = "Examples:\n  robert robots settle shadow_hand --pose rock\n  robert robots settle ur5e --set elbow=0.7 --set wrist_1=-1"
    )]
    Settle {
        /// Id, or a folder with robot.xml.
        robot: String,
        /// A named pose [default: the home pose].
        #[arg(long)]
        pose: Option<String>,
        /// Set a joint, rad or m: JOINT=VALUE. May be repeated.
        #[arg(long = "set", value_name = "JOINT=VALUE")]
        set: Vec<String>,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Print masses and forward kinematics at random poses, for comparison with other programs.
    #[command(hide = true)]
    Kinematics {
        /// Id, or a folder with robot.xml.
        robot: String,
        /// Number of poses.
        #[arg(long, default_value_t = 5)]
        poses: u64,
        /// Also simulate for so long without control, and report whether that went well.
        #[arg(long, default_value_t = 5.0)]
        secs: f64,
    },
}

pub(super) fn run(args: &Args) -> Outcome {
    match args {
        Args::Ls { json } => ls(*json),
        Args::Show { robot, json, toml } => show(robot, *json, *toml),
        Args::Settle { robot, pose, set, json } => settle(robot, pose.as_deref(), set, *json),
        Args::Kinematics { robot, poses, secs } => kinematics(robot, *poses, *secs),
    }
}

fn ls(json: bool) -> Outcome {
    let robots = Robot::builtin_ids().map(Robot::builtin).collect::<Result<Vec<_>, _>>()?;
    if json {
        let list: Vec<Value> = robots
            .iter()
            .map(|r| {
                json!({
                    "id": r.id(),
                    "title": r.profile().title,
                    "about": r.profile().about,
                    "state_dim": r.state_dim(),
                    "action_dim": r.action_dim(),
                    "poses": r.pose_names().collect::<Vec<_>>(),
                    "model_sha256": r.model_sha256(),
                })
            })
            .collect();
        return out::json(&list);
    }
    let mut t = out::table(&["robot", "state", "action", "poses", "description"]);
    for r in &robots {
        t.add_row([
            r.id().to_owned(),
            r.state_dim().to_string(),
            r.action_dim().to_string(),
            r.pose_names().count().to_string(),
            r.profile().about.clone(),
        ]);
    }
    out::line(&t.to_string())
}

fn show(robot: &str, json: bool, toml: bool) -> Outcome {
    let robot = Robot::load(robot)?;
    if toml {
        return out::line(robot.profile().to_toml()?.trim_end());
    }
    let model = robot.model();
    let (mass, moving) = (model.body_mass().iter().sum::<f64>(), model.moving_mass());
    if json {
        let mut value = serde_json::to_value(robot.profile()).map_err(std::io::Error::other)?;
        if let Some(map) = value.as_object_mut() {
            map.insert("state_dim".into(), json!(robot.state_dim()));
            map.insert("action_dim".into(), json!(robot.action_dim()));
            map.insert("model_sha256".into(), json!(robot.model_sha256()));
            map.insert("folder".into(), json!(robot.folder()));
            map.insert("sites".into(), sites(&robot)?);
            map.insert(
                "facts".into(),
                json!({
                    "nq": model.nq(), "nv": model.nv(), "nu": model.nu(),
                    "bodies": model.nbody(), "geoms": robot.scene_model()?.ngeom(),
                    "mass_kg": mass, "moving_kg": moving, "timestep_secs": model.timestep(),
                    "substeps": SUBSTEPS, "ctrl_dt_secs": CTRL_DT,
                    "gravity": model.gravity(), "contacts": model.contacts(),
                    "integrator": (["Euler", "RK4", "implicit"]).get(model.integrator() as usize),
                    "cone": (["pyramidal", "elliptic"]).get(model.cone() as usize),
                }),
            );
        }
        return out::json(&value);
    }
    let p = robot.profile();
    let still = super::import::still(mass, moving);
    out::line(&format!("{} ({})\n{}\n", p.title, robot.id(), p.about))?;
    out::line(&format!(
        "state {}, action {}, mass {mass:.3} kg{still}, step {} s x {SUBSTEPS}, contacts {}\n",
        robot.state_dim(),
        robot.action_dim(),
        model.timestep(),
        if model.contacts() { "on" } else { "off" }
    ))?;
    let mut t = out::table(&["joint", "unit", "from", "to", "speed", "top speed", "home"]);
    for (j, home) in robot.joints().iter().zip(robot.home()) {
        // Rounded inwards, so that what is shown can be typed.
        let [low, high] = j.range;
        let (from, to) = ((low * 1e3 - 1e-6).ceil() / 1e3, (high * 1e3 + 1e-6).floor() / 1e3);
        let end = |v: f64| if v.is_finite() { fixed(v, 3) } else { "-".to_owned() };
        t.add_row([
            j.name.clone(),
            j.unit.symbol().to_owned(),
            end(from),
            end(to),
            format!("{:.3}", j.speed_limit),
            format!("{:.3}", j.top_speed),
            fixed(((home * 1e3).round() / 1e3).max(from).min(to), 3),
        ]);
    }
    out::line(&t.to_string())?;
    let mut t = out::table(&["motor", "drives", "from", "to"]);
    for a in robot.actuators() {
        let drives = match &a.drive {
            Drive::Tendon(n) => format!("tendon {n}"),
            Drive::Joint(n) | Drive::Other(n) => n.clone(),
        };
        t.add_row([a.name.clone(), drives, short(a.ctrlrange[0]), short(a.ctrlrange[1])]);
    }
    out::line(&t.to_string())?;
    let groups: Vec<String> =
        p.groups.iter().map(|g| format!("{} ({})", g.name, g.joints.len())).collect();
    out::line(&format!("groups   {}", groups.join(", ")))?;
    out::line(&format!("poses    {}", robot.pose_names().collect::<Vec<_>>().join(", ")))?;
    let home: Vec<f64> = robot.home();
    let sites = p.ik_sites.iter().map(|name| {
        let place = site(&robot, &home, name)?;
        Some(format!("{name} ({})", place.pos.map(|x| fixed(x, 3)).join(" ")))
    });
    let sites = sites.flatten();
    let sites: Vec<String> = sites.collect();
    if !sites.is_empty() {
        out::line(&format!("ik sites {}; m, at home", sites.join(", ")))?;
    }
    out::line(&format!("mirror   {}", robot.mirror_reason().unwrap_or("yes")))?;
    out::line(&format!("licence  {}", p.licence))
}

/// A range as it was written, up to six decimals.
fn short(range: f64) -> String {
    ((range * 1e6).round() / 1e6).to_string()
}

/// The place of a site in a pose.
fn site(robot: &Robot, state: &[f64], name: &str) -> Option<Place> {
    let tree = robot.kinematics();
    Some(tree.place(state, &tree.point(&Point::Site(name.to_owned())).ok()?))
}

/// The places of the sites for inverse kinematics in each named pose, as goals of keys have them: m,
/// and w x y z.
fn sites(robot: &Robot) -> Outcome<Value> {
    let mut all = serde_json::Map::new();
    for name in &robot.profile().ik_sites {
        let mut places = serde_json::Map::new();
        for pose in robot.pose_names() {
            let place = site(robot, &robot.pose(pose)?, name);
            let round = |x: f64| (1e6 * x).round() / 1e6;
            let goal = place.map(|p| json!({"pos": p.pos.map(round), "quat": p.quat.map(round)}));
            places.insert(pose.to_owned(), goal.into());
        }
        all.insert(name.clone(), places.into());
    }
    Ok(all.into())
}

fn settle(robot: &str, pose: Option<&str>, set: &[String], json: bool) -> Outcome {
    let robot = Robot::load(robot)?;
    let mut target = match pose {
        Some(name) => robot.pose(name)?,
        None => robot.home(),
    };
    for word in set {
        let (name, value) = word
            .split_once('=')
            .ok_or_else(|| Failure::usage(format!("--set {word}: write JOINT=VALUE")))?;
        let value: f64 =
            value.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
                Failure::usage(format!("--set {word}: \"{value}\" is not a number"))
            })?;
        let i = robot.joint_index(name)?;
        let joint = robot.joints().get(i);
        if let Some(j) = joint.filter(|j| value < j.range[0] || value > j.range[1]) {
            return Err(Failure::invalid(format!(
                "--set {word}: {name} ranges from {} to {} {}",
                j.range[0],
                j.range[1],
                j.unit.symbol()
            )));
        }
        if let Some(t) = target.get_mut(i) {
            *t = value;
        }
    }
    let s = robot.settle(&target)?;
    let tolerance = robot.profile().settle.tolerance;
    if json {
        return out::json(&settled_json(&robot, &s, tolerance));
    }
    let mut t = out::table(&["joint", "asked", "reached", "residual"]);
    for (i, j) in robot.joints().iter().enumerate() {
        let residual = s.residual[i];
        let mark = if residual > tolerance { "  not reached" } else { "" };
        t.add_row([
            j.name.clone(),
            fixed(s.target[i], 4),
            fixed(s.reached[i], 4),
            format!("{}{mark}", fixed(residual, 4)),
        ]);
    }
    out::line(&t.to_string())?;
    let worst = robot.joints().get(s.worst_joint);
    let (name, unit) = worst.map_or(("", Unit::Rad), |j| (j.name.as_str(), j.unit));
    out::line(&format!(
        "{}: worst {} {} at {name} (tolerance {tolerance})",
        match (s.within, s.rests) {
            (true, _) => "reached",
            (false, true) => "not reached",
            (false, false) => "not reached, and still moving",
        },
        fixed(s.worst, 4),
        unit.symbol()
    ))
}

fn settled_json(robot: &Robot, s: &Settled, tolerance: f64) -> Value {
    let rows: Vec<Value> = robot
        .joints()
        .iter()
        .enumerate()
        .map(|(i, j)| {
            json!({"joint": j.name, "target": s.target.get(i), "reached": s.reached.get(i), "residual": s.residual.get(i)})
        })
        .collect();
    json!({
        "robot": robot.id(), "within": s.within, "worst": s.worst,
        "worst_joint": robot.joints().get(s.worst_joint).map(|j| &j.name),
        "tolerance": tolerance, "final_speed": s.speed, "joints": rows,
    })
}

fn kinematics(robot: &str, poses: u64, secs: f64) -> Outcome {
    let robot = Robot::load(robot)?;
    let model = robot.model();
    let body = |b: usize| model.name(Kind::Body, b).unwrap_or_default().to_owned();
    let row = |v: &[f64], b: usize, n: usize| v[n * b..n * b + n].to_vec();
    let bodies: Vec<Value> = (1..model.nbody())
        .map(|b| {
            json!({
                "name": body(b), "mass": model.body_mass().get(b),
                "ipos": row(model.body_ipos(), b, 3), "inertia": row(model.body_inertia(), b, 3),
            })
        })
        .collect();
    let mut data = Data::new(model)?;
    let mut drawn = Vec::new();
    for k in 0..poses {
        let mut rng = Rng::new(0, Stream::Test, k);
        let state: Vec<f64> = robot
            .joints()
            .iter()
            .map(|j| rng.range(j.range[0].max(-3.0), j.range[1].min(3.0)))
            .collect();
        data.reset()?;
        robot.write_state(&mut data, &state)?;
        data.kinematics()?;
        let frames: Vec<Value> = (1..model.nbody())
            .map(|b| json!({"xpos": row(data.xpos(), b, 3), "xquat": row(data.xquat(), b, 4)}))
            .collect();
        drawn.push(json!({"qpos": data.qpos(), "bodies": frames}));
    }
    let stepped = step(&robot, model, secs);
    out::json(&json!({
        "nq": model.nq(), "nv": model.nv(), "nu": model.nu(),
        "joints": robot.joints().iter().map(|j| &j.name).collect::<Vec<_>>(),
        "mass": model.body_mass().iter().sum::<f64>(),
        "bodies": bodies, "poses": drawn,
        "stepped_secs": secs, "step_error": stepped.err().map(|e| e.to_string()),
    }))
}

fn step(
    robot: &Robot,
    model: &std::sync::Arc<Model>,
    secs: f64,
) -> Result<(), crate::robot::Error> {
    let mut data = Data::new(model)?;
    robot.write_state(&mut data, &robot.home())?;
    robot.apply_action(&mut data, &robot.action_of(&vec![0.0; robot.action_dim()])?)?;
    for _ in 0..(secs / CTRL_DT).round() as u64 {
        data.step(SUBSTEPS)?;
    }
    Ok(())
}
