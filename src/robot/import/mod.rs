//! Makes a robot's folder out of a foreign URDF or MJCF.
//!
//! The order is: read the file under limits ([`super::preparse`]), draft an MJCF with plain file
//! names, and compile it in a child process. Then add what a torque-driven simulation needs
//! (motors, contact excludes, our time step), compile again, derive the profile, and only then
//! publish the folder. Every figure that was not in the source is in the report.
//!
//! Rejected: `MuJoCo`'s own URDF loader, which drops effort, velocity and mimic, cuts
//! `package://` paths to the base name and makes no actuators.

mod attach;
mod bearable;
mod classes;
mod config;
mod contacts;
mod degrees;
mod description;
mod draft;
mod drives;
mod effort;
mod fix;
mod frame;
mod loose;
mod mjcf;
mod modern;
mod packages;
mod plausible;
mod sites;
mod sound;
mod split;
mod unknown;
mod urdf;
mod words;

use std::path::{Path, PathBuf};
use std::sync::Arc;

pub use config::{Drives, ImportConfig, Report, Servos};

use super::origin::Origin;
use super::pace::{self, Pace};
use super::{Assets, Error, MODEL_FILE, PROFILE_FILE, Robot, check, derive, preparse, profile};
use draft::Draft;
use robert_base::{fsio, limits};
use robert_mujoco::Model;

/// Speed limit of a joint that its motors do not move, rad/s or m/s.
const SLOW: f64 = 0.1;
/// The share of the speed in the source below which a motor counts as too weak.
const HARDLY: f64 = 0.1;
/// The report of an import, in the robot's folder.
const REPORT_FILE: &str = "import.json";

/// Imports a model.
///
/// # Errors
/// Every variant of [`Error`] that speaks of a file.
pub fn import(config: &ImportConfig) -> Result<Report, Error> {
    let out = &config.out;
    let unfit = |message: String, path: &Path| Error::Unfit { message, path: path.to_owned() };
    if out.is_file() {
        return Err(unfit("this is a file; name a folder for the robot".into(), out));
    }
    if out.read_dir().is_ok_and(|mut d| d.next().is_some()) {
        return Err(unfit("the folder exists and is not empty; name another one".into(), out));
    }
    let effort_is_wrong = config.effort.is_some_and(|e| !(e.is_finite() && e > 0.0));
    if effort_is_wrong || !config.base_height_m.is_finite() {
        return Err(unfit(
            "effort must be positive and the base height finite".into(),
            &config.source,
        ));
    }
    let id = config.id.clone().unwrap_or_else(|| super::folder::id_of(&absolute(out)));
    if !profile::valid_id(&id) {
        return Err(unfit(
            format!("\"{id}\" cannot be a robot's id: lower-case letters, digits, '_' and '-'"),
            out,
        ));
    }
    let (project, mut draft) = drafted(config)?;
    let source_sha256 = mark_of(&project, &draft, config);
    let parent = absolute(out).parent().map_or_else(|| PathBuf::from("."), Path::to_owned);
    let write =
        |e: std::io::Error| Error::File(fsio::Error::Write { source: e, path: out.clone() });
    std::fs::create_dir_all(&parent).map_err(write)?;
    fsio::sweep(&parent);
    let temp = tempfile::Builder::new()
        .prefix(&format!("{}import-", fsio::TEMPORARY))
        .tempdir_in(&parent)
        .map_err(write)?;
    let (model, xml) = settle_draft(&mut draft, &project, config, temp.path())?;
    plausible::check(&mut draft, &model)?;
    if let Some(left) = derive::poses_left_out(&model) {
        draft.warnings.push(left);
    }
    degrees::check(&mut draft, &model, project.format);
    let profile = describe(&mut draft, &model, &id, config)?;
    write_files(temp.path(), &xml, &draft.assets, &profile)?;
    // The way every later command will take.
    let robot = Robot::from_folder(temp.path())?;
    let report = Report {
        id,
        folder: out.clone(),
        format: if project.format == preparse::Format::Urdf { "urdf" } else { "mjcf" }.into(),
        source_sha256,
        state_dim: robot.state_dim(),
        action_dim: robot.action_dim(),
        bodies: model.nbody() - 1,
        files: draft.assets.len(),
        mass_kg: model.body_mass().iter().sum(),
        moving_kg: model.moving_mass(),
        dropped: draft.dropped,
        assumed: draft.assumed,
        changed: draft.changed,
        warnings: draft.warnings,
    };
    let json = serde_json::to_vec_pretty(&report)
        .map_err(|e| unfit(format!("the report cannot be written: {e}"), out))?;
    fsio::write_atomic(&temp.path().join(REPORT_FILE), &json)?;
    publish(temp, out).map_err(|e| match e.kind() {
        std::io::ErrorKind::DirectoryNotEmpty => unfit(
            "another command has written into this folder meanwhile; name another one".into(),
            out,
        ),
        _ => write(e),
    })?;
    Ok(report)
}

/// Sha-256 of everything that the result of an import depends on, but for the robot's id: the source
/// with its includes, its meshes, and the options.
///
/// # Errors
/// As [`import`], unless they come from the simulator.
pub fn mark(config: &ImportConfig) -> Result<String, Error> {
    let (project, draft) = drafted(config)?;
    Ok(mark_of(&project, &draft, config))
}

fn mark_of(project: &preparse::Project, draft: &Draft, config: &ImportConfig) -> String {
    let servos = match config.servos {
        Servos::Keep => "keep",
        Servos::Torque => "torque",
    };
    let drives = match config.drives {
        Drives::Modelled => "modelled",
        Drives::File => "file",
    };
    let mut parts = vec![
        format!("text {}", fsio::sha256_hex(project.xml.as_bytes())),
        format!("fixed base {}", config.fixed_base),
        format!("base height {}", config.base_height_m),
        format!("effort {}", config.effort.map_or_else(|| "sized".to_owned(), |e| e.to_string())),
        format!("servos {servos}, drives {drives}"),
    ];
    parts.extend(config.weld.iter().map(|joint| format!("weld {joint}")));
    parts.extend(config.without.iter().map(|body| format!("without {body}")));
    if config.without_meshes {
        parts.push("without missing meshes".to_owned());
    }
    for (name, bytes) in &draft.assets {
        parts.push(format!("file {name} {}", fsio::sha256_hex(bytes)));
    }
    fsio::sha256_hex(parts.join("\n").as_bytes())
}

/// What [`mark_in`] reads of a report, whatever version wrote it.
#[derive(serde::Deserialize)]
struct Marked {
    #[serde(default)]
    source_sha256: Option<String>,
}

/// The [`mark`] of the import that made a robot's folder; `None` if an older version made it, or
/// no import did.
///
/// # Errors
/// [`Error::File`] for a report that cannot be read.
pub fn mark_in(folder: &Path) -> Result<Option<String>, Error> {
    let path = folder.join(REPORT_FILE);
    if !path.is_file() {
        return Ok(None);
    }
    let bytes = fsio::read_capped(&path, limits::MODEL_BYTES)?;
    let report: Marked = serde_json::from_slice(&bytes).map_err(|e| Error::Unfit {
        message: format!("not a report of robert import: {e}"),
        path,
    })?;
    Ok(report.source_sha256)
}

/// The first step of an import: the model as an MJCF with plain file names, before it is compiled.
///
/// # Errors
/// As [`import`], unless they come from the simulator.
pub fn draft(config: &ImportConfig) -> Result<String, Error> {
    Ok(drafted(config)?.1.xml)
}

fn drafted(config: &ImportConfig) -> Result<(preparse::Project, Draft), Error> {
    let missing = if config.without_meshes {
        preparse::MissingFiles::LeaveOut
    } else {
        preparse::MissingFiles::Refuse
    };
    let (project, remarks) =
        attach::read(&config.source, config.root.as_deref(), missing).map_err(with_way_out)?;
    let mut draft = match project.format {
        preparse::Format::Mjcf => mjcf::draft(&project, config)?,
        preparse::Format::Urdf => urdf::draft(&project, config)?,
    };
    if !project.foreign.is_empty() {
        let names: Vec<&str> = project.foreign.iter().take(5).map(String::as_str).collect();
        let more = project.foreign.len() - names.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        draft.dropped.push(format!("parts for other programs: {}{more}", names.join(", ")));
    }
    draft.dropped.extend(project.without.dropped.iter().cloned());
    draft.warnings.extend(project.without.warnings.iter().cloned());
    draft.changed.extend(remarks.changed);
    draft.warnings.extend(remarks.warnings);
    Ok((project, draft))
}

/// The refusal of a missing mesh with the option that leaves it out.
fn with_way_out(e: Error) -> Error {
    const MISSING: [&str; 2] = ["does not exist", "pointer of Git LFS"];
    const ASSETS: [&str; 4] = ["mesh file ", "hfield file ", "texture file ", "skin file "];
    match e {
        Error::Refused { message, line, column, path }
            if MISSING.iter().any(|m| message.contains(m))
                && (ASSETS.iter().any(|a| message.starts_with(a)) || message.contains("LFS")) =>
        {
            let way = "find or mend the file, or leave out what is missing: --without-meshes";
            Error::Refused { message: format!("{message}; {way}"), line, column, path }
        }
        other => other,
    }
}

/// Compiles the draft, fixes it, and compiles until nothing is left to fix.
fn settle_draft(
    draft: &mut Draft,
    project: &preparse::Project,
    config: &ImportConfig,
    dir: &Path,
) -> Result<(Arc<Model>, String), Error> {
    // Errors of the draft contain its own path, but the user knows the source's.
    let say = |e: Error, text: &str| named(e, &dir.join(MODEL_FILE), text, project);
    compile_healed(draft, project, config, dir)?;
    unknown::tell(draft);
    let mut first = Arc::new(compile(&draft.xml, &draft.assets).map_err(|e| say(e, &draft.xml))?);
    sites::check(draft, &first, &project.path)?;
    if fix::joints(draft, &first, project, config)? {
        first = Arc::new(compile(&draft.xml, &draft.assets).map_err(|e| say(e, &draft.xml))?);
        fix::joints(draft, &first, project, config)?;
    }
    fix::actuators(draft, &first, config)?;
    let mut second = compile(&draft.xml, &draft.assets).map_err(|e| say(e, &draft.xml))?;
    if drives::model(draft, &second, config)? {
        second = compile(&draft.xml, &draft.assets).map_err(|e| say(e, &draft.xml))?;
    }
    contacts::exclude(draft, &second, project)?;
    let last = Arc::new(compile(&draft.xml, &draft.assets).map_err(|e| say(e, &draft.xml))?);
    write_model(dir, &draft.xml, &draft.assets)?;
    check::compile(&dir.join(MODEL_FILE), &config.checker, check::STEPS)
        .map_err(|e| say(e, &draft.xml))?;
    Ok((last, draft.xml.clone()))
}

/// Compiles the draft in a child process, with repairs that lose nothing.
fn compile_healed(
    draft: &mut Draft,
    project: &preparse::Project,
    config: &ImportConfig,
    dir: &Path,
) -> Result<(), Error> {
    let path = dir.join(MODEL_FILE);
    loop {
        write_model(dir, &draft.xml, &draft.assets)?;
        let Err(error) = check::compile(&path, &config.checker, 0) else { return Ok(()) };
        if !unknown::heal(draft, &error, &project.path)? {
            return Err(hinted(named(error, &path, &draft.xml, project)));
        }
        // Files of another name or content may have taken the place of some.
        let assets = dir.join(draft::ASSET_DIR);
        if assets.is_dir() {
            let write = |e| Error::File(fsio::Error::Write { source: e, path: assets.clone() });
            std::fs::remove_dir_all(&assets).map_err(write)?;
        }
    }
}

/// The error with a way to solve it, if one is known.
fn hinted(e: Error) -> Error {
    match e {
        Error::Checked { message, class, path } => {
            let message = match unknown::hint(&message) {
                Some(hint) => message + hint,
                None => message,
            };
            Error::Checked { message, class, path }
        }
        other => other,
    }
}

fn compile(xml: &str, assets: &Assets) -> Result<Model, Error> {
    super::compile(xml, assets)
}

/// Errors of the draft with this text, reported for the source file, with a line of it where one is known.
fn named(e: Error, drafted: &Path, text: &str, project: &preparse::Project) -> Error {
    let source = &project.path;
    let (from, to) = (drafted.display().to_string(), source.display().to_string());
    match e {
        Error::Checked { message, class, .. } => {
            let rest = message.strip_prefix(&from).unwrap_or(&message);
            let (place, what) = rest.split_once(": ").unwrap_or(("", rest));
            let line = place.trim_start_matches(':').split(':').next().and_then(|l| l.parse().ok());
            let message = match line.filter(|_| project.format == preparse::Format::Mjcf) {
                None => format!("{to}: {what}"),
                Some(line) => {
                    // The simulator's own number is that of the draft.
                    let what = what
                        .replace(&format!(", line {line}"), "")
                        .replace(&format!(", line = {line}, column = -1"), "");
                    match Origin::of(text, line, 1, source) {
                        Origin::Line { path, line } => {
                            format!("{}:{line}:1: {what}", path.display())
                        }
                        Origin::Excerpt(tag) => format!("{to}: {what}; the line is {tag}"),
                    }
                }
            };
            Error::Checked { message, class, path: source.clone() }
        }
        Error::Exhausted { what, .. } => Error::Exhausted { what, path: source.clone() },
        Error::Simulator(e) => Error::Simulator(e.at(source)),
        other => other,
    }
}

/// The complete profile, in which derived values can be read and changed.
fn describe(
    draft: &mut Draft,
    model: &Arc<Model>,
    id: &str,
    config: &ImportConfig,
) -> Result<String, Error> {
    let mut p = derive::derive(model, id, &config.source)?;
    p.title.clone_from(&draft.title);
    let name = || config.source.file_name().map(|n| n.to_string_lossy().into_owned());
    let name = config.source_name.clone().or_else(name).unwrap_or_default();
    p.about = format!("Imported from {name}.");
    "see the source".clone_into(&mut p.licence);
    speeds(&mut p.joints, draft, model)?;
    p.physics.discard_visual = fix::weightless_visuals(&draft.xml, &draft.assets, model);
    let text = p.to_toml()?;
    Ok(format!(
        "# Made by robert import. Whatever the model implies may be left out again.\n{text}"
    ))
}

/// Speeds and accelerations that the motors reach in simulation, no speed above what the source
/// allows.
fn speeds(
    joints: &mut [profile::JointSpec],
    draft: &mut Draft,
    model: &Arc<Model>,
) -> Result<(), Error> {
    let (mut stuck, mut slow) = (Vec::new(), Vec::new());
    let paces = pace::measure(model)?;
    if let Some(secs) = paces.cut_secs {
        draft.warnings.push(format!(
            "the model is so large that its joints were driven for {secs:.2} s only: speed limits may be too low"
        ));
    }
    for (j, pace) in joints.iter_mut().zip(paces.joints) {
        let named = draft.speeds.get(&j.name).copied();
        match pace {
            Pace::Moves { speed, top, acceleration } => {
                let at_most = |v: f64| derive::digits(named.map_or(v, |n| n.min(v)), 3);
                j.speed_limit = at_most(speed);
                // Within a short range no motor reaches its speed.
                let wide = |n: f64| j.range.is_none_or(|[a, b]| b - a > drives::CROSSING_SECS * n);
                let hardly = |n: &f64| speed < HARDLY * n && *n <= drives::PLACEHOLDER && wide(*n);
                if let Some(n) = named.filter(hardly) {
                    let (speed, n) = (j.speed_limit, derive::digits(n, 3));
                    slow.push(format!("\"{}\" {speed} of {n}", j.name));
                }
                j.top_speed = Some(at_most(top)).filter(|top| *top > j.speed_limit);
                j.acceleration_limit = Some(derive::digits(acceleration, 3)).filter(|a| *a > 0.0);
            }
            Pace::Stuck => {
                stuck.push(format!("\"{}\"", j.name));
                j.speed_limit = named.map_or(SLOW, |n| n.min(SLOW));
            }
            Pace::Unknown => j.speed_limit = named.unwrap_or(j.speed_limit),
        }
    }
    if !stuck.is_empty() {
        draft.warnings.push(format!(
            "the motors do not move {} in most poses: too weak for what they carry, or blocked",
            stuck.join(", ")
        ));
    }
    if !slow.is_empty() {
        draft.warnings.push(format!(
            "motors give a small part of the speed that the file names, from rest in most poses (rad/s or m/s): {}; too weak \
             for what they carry, or blocked: check masses and the motors' limits in the file",
            slow.join(", ")
        ));
    }
    Ok(())
}

fn write_model(dir: &Path, xml: &str, assets: &Assets) -> Result<(), Error> {
    fsio::write_atomic(&dir.join(MODEL_FILE), xml.as_bytes())?;
    for (name, bytes) in assets {
        let path = dir.join(draft::ASSET_DIR).join(name);
        if !path.is_file() {
            fsio::write_atomic(&path, bytes)?;
        }
    }
    Ok(())
}

fn write_files(dir: &Path, xml: &str, assets: &Assets, profile: &str) -> Result<(), Error> {
    write_model(dir, xml, assets)?;
    fsio::write_atomic(&dir.join(PROFILE_FILE), profile.as_bytes())?;
    Ok(())
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// The finished folder gets its name in one step.
fn publish(temp: tempfile::TempDir, out: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    std::fs::set_permissions(temp.path(), std::fs::Permissions::from_mode(0o755))?;
    if out.is_dir() {
        std::fs::remove_dir(out)?;
    }
    std::fs::rename(temp.path(), out)?;
    // The folder has moved; nothing is left to remove.
    let _moved = temp.keep();
    Ok(())
}
