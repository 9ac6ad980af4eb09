//! Compiles a foreign model in a child process first, so that a crash, an endless loop or excessive
//! memory in the library costs an error message and not the program.
//!
//! The child is the same binary (`robert __compile-check FILE`). It limits its own address space
//! and processor time before it opens anything, so no shell or wrapper is needed. The parent adds a
//! wall-clock limit. Rejected: `fork` without `exec` (undefined with threads) and catching signals
//! in-process (after a segmentation fault the state of the library is undefined).

use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::default_pose::default_pose;
use super::{Error, pairs};
use robert_base::child::{self, OnParentExit, Rights};
use robert_base::limits;
use robert_mujoco::{self as mujoco, Data, Model};

/// The hidden subcommand.
pub const SUBCOMMAND: &str = "__compile-check";
/// Simulator steps that a model must survive at rest: a tenth of a second.
pub const STEPS: usize = 20;
/// Pairs of geoms that are tested in these steps at most; a model with many pairs makes fewer steps.
const STEP_PAIRS: usize = 5_000_000;

/// The result of the child.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verdict {
    /// `ok`, `parse`, `compile`, `invalid`, `engine`, `memory`, `diverged` or `other`.
    pub class: String,
    /// The problem; empty if the model is fine.
    pub message: String,
    /// Line in the model, if known.
    pub line: Option<u32>,
    /// Greatest resident size of the child, bytes.
    pub peak_bytes: u64,
}

/// Compiles the model in a child process and tries `steps` simulator steps.
///
/// # Errors
/// [`Error::Checked`], [`Error::Exhausted`], [`Error::NoChecker`].
pub fn compile(model: &Path, exe: &Path, steps: usize) -> Result<Verdict, Error> {
    let verdict = ask(model, exe, steps)?;
    if verdict.class == "ok" {
        return Ok(verdict);
    }
    let place = match verdict.line {
        Some(line) => format!("{}:{line}:1", model.display()),
        None => model.display().to_string(),
    };
    Err(Error::Checked {
        message: format!("{place}: {}", verdict.message),
        class: verdict.class,
        path: model.to_owned(),
    })
}

/// The path that [`set_executable`] was given.
static EXECUTABLE: OnceLock<PathBuf> = OnceLock::new();

/// Sets the binary that checks start, for programs of another name that use this library, such as
/// Python. The first call decides.
pub fn set_executable(robert: PathBuf) {
    EXECUTABLE.get_or_init(|| robert);
}

/// The binary to start for a check: the one that was named, this program, or the one built beside
/// a test.
///
/// # Errors
/// [`Error::NoChecker`].
pub fn executable() -> Result<PathBuf, Error> {
    if let Some(named) = EXECUTABLE.get() {
        return Ok(named.clone());
    }
    let own = std::env::current_exe().map_err(|e| Error::NoChecker { message: e.to_string() })?;
    // Test binaries (robert-HASH too) are in target/PROFILE/deps, examples in
    // target/PROFILE/examples. The program may have a version in its name. A binary with another
    // name is someone else's program, which cannot check models.
    let folder = own.parent().and_then(Path::file_name);
    let named = own.file_stem().and_then(|s| s.to_str()).is_some_and(|s| s.starts_with("robert"));
    if named && folder.is_none_or(|f| f != "deps" && f != "examples") {
        return Ok(own);
    }
    let beside = own.parent().and_then(Path::parent).map(|d| d.join("robert"));
    match beside.filter(|p| p.is_file()) {
        Some(p) => Ok(p),
        None => Err(Error::NoChecker {
            message: format!("the robert program is not beside {}; build it first", own.display()),
        }),
    }
}

fn ask(model: &Path, exe: &Path, steps: usize) -> Result<Verdict, Error> {
    let no_checker =
        |e: std::io::Error| Error::NoChecker { message: format!("{}: {e}", exe.display()) };
    let args: [OsString; 4] =
        [SUBCOMMAND.into(), "--steps".into(), steps.to_string().into(), model.into()];
    let mut child = child::command(exe)
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(no_checker)?;
    let most = Duration::from_secs(limits::CHECK_WALL_SECS);
    let status = wait(&mut child, most).map_err(no_checker)?;
    let exhausted = |what: String| Error::Exhausted { what, path: model.to_owned() };
    let Some(status) = status else {
        return Err(exhausted(format!("took more than {} s", limits::CHECK_WALL_SECS)));
    };
    let mut said = String::new();
    if let Some(out) = child.stdout.take() {
        out.take(1 << 16).read_to_string(&mut said).map_err(no_checker)?;
    }
    match serde_json::from_str(&said) {
        Ok(verdict) if status.success() => Ok(verdict),
        _ => Err(exhausted(death(status))),
    }
}

/// Waits with a time limit; `None` if the child had to be killed.
fn wait(child: &mut Child, most: Duration) -> std::io::Result<Option<ExitStatus>> {
    let end = Instant::now() + most;
    let mut pause = Duration::from_millis(1);
    // The result fits into the pipe's buffer, so the child never blocks.
    while Instant::now() < end {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        std::thread::sleep(pause);
        pause = (pause * 2).min(Duration::from_millis(20));
    }
    child.kill()?;
    child.wait()?;
    Ok(None)
}

fn death(status: ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt;
    const SIGKILL: i32 = 9;
    const SIGXCPU: i32 = 24;
    match status.signal() {
        Some(SIGXCPU | SIGKILL) => format!("took more than {} s", limits::CHECK_CPU_SECS),
        Some(n) => format!("crashed the physics library (signal {n})"),
        None => format!("ended without a result ({status})"),
    }
}

/// The child's side: limits itself, compiles, tries a few steps.
pub fn serve(model: &Path, steps: usize) -> Verdict {
    let confined =
        child::follow_parent(OnParentExit::Now).and_then(|()| child::confine(&rights(model)));
    if let Err(e) = confined {
        let message = format!("the check cannot be confined: {e}");
        return Verdict { class: "other".into(), message, ..Verdict::default() };
    }
    let verdict = match attempt(model, steps) {
        Ok(()) => Verdict { class: "ok".into(), ..Verdict::default() },
        Err(e) => judge(&e),
    };
    Verdict { peak_bytes: peak_bytes(), ..verdict }
}

/// The child may read the model's folder and its own status, and write nothing.
fn rights(model: &Path) -> Rights {
    let folder = model.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Rights {
        memory_bytes: Some(limits::CHECK_MEMORY_BYTES),
        cpu_secs: Some(limits::CHECK_CPU_SECS),
        file_bytes: Some(0),
        reads: Some(vec![folder.to_owned(), "/proc/self".into()]),
        writes: Some(Vec::new()),
    }
}

fn attempt(path: &Path, steps: usize) -> Result<(), mujoco::Error> {
    let model = Arc::new(Model::from_path(path)?);
    let pairs = pairs::count(&model);
    if pairs > limits::MODEL_PAIRS {
        let message = format!(
            "{pairs} pairs of geoms may collide, and at most {} are simulated; give geoms that need not collide contype=\"0\" and conaffinity=\"0\"",
            limits::MODEL_PAIRS
        );
        return Err(mujoco::Error::Invalid { message, path: None });
    }
    let mut data = Data::new(&model)?;
    data.set_qpos(&default_pose(&model))?;
    data.forward()?;
    match steps.min(STEP_PAIRS / pairs.max(1)) {
        0 => Ok(()),
        steps => data.step(steps),
    }
}

fn judge(e: &mujoco::Error) -> Verdict {
    use mujoco::Error as E;
    let (class, message, line) = match e {
        E::Parse { message, line, .. } => ("parse", message.clone(), *line),
        E::Compile { message, line, .. } => ("compile", message.clone(), *line),
        E::Invalid { message, .. } => ("invalid", message.clone(), None),
        E::Engine { .. } => ("engine", e.to_string(), None),
        E::Memory { .. } => ("memory", "compiling it takes too much memory".to_owned(), None),
        E::Diverged { .. } => (
            "diverged",
            format!("{e} within its first 0.1 s at rest; parts may overlap or be too light"),
            None,
        ),
        _ => ("other", e.to_string(), None),
    };
    Verdict { class: class.to_owned(), message, line, peak_bytes: 0 }
}

/// `VmHWM` of this process.
fn peak_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or_default();
    let kb = line.split_whitespace().next().and_then(|n| n.parse::<u64>().ok());
    kb.unwrap_or(0) * 1024
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_check_that_only_waits_is_ended() {
        let mut idle = std::process::Command::new("sleep").arg("600").spawn().unwrap();
        let begin = Instant::now();
        assert!(wait(&mut idle, Duration::from_millis(50)).unwrap().is_none());
        assert!(begin.elapsed() < Duration::from_secs(60));
        assert!(idle.try_wait().unwrap().is_some(), "it has been killed");
        let mut short = std::process::Command::new("true").spawn().unwrap();
        assert!(wait(&mut short, Duration::from_secs(60)).unwrap().unwrap().success());
    }

    #[test]
    fn pairs_that_may_collide_are_capped() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("robot.xml");
        let tried = |n: usize| {
            let body = |n: usize, x: usize| {
                format!("<body pos='{x} 0 0'><joint/>{}</body>", "<geom size='.1'/>".repeat(n))
            };
            let xml = format!(
                "<mujoco><worldbody>{}{}</worldbody></mujoco>",
                body(limits::MODEL_PAIRS / 1000, 0),
                body(n, 9)
            );
            std::fs::write(&path, xml).unwrap();
            attempt(&path, 1)
        };
        tried(1000).unwrap();
        let refused = tried(1001).unwrap_err().to_string();
        assert!(refused.contains("1001000 pairs of geoms may collide"), "{refused}");
    }
}
