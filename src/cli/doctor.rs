//! `robert doctor`: checks what the program needs on this machine, and names the fixes.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Serialize;

use super::failure::{Failure, Outcome};
use super::out;
use crate::exit::Exit;
use crate::gpu::{Card, cards};
use crate::mujoco;
use crate::render::{RenderConfig, Renderer};
use crate::robot::Robot;
use crate::rollout::shipped;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert doctor\n  robert doctor --json | jq '.checks[] | select(.state != \"ok\")'"
)]
pub(super) struct Args {
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

/// The outcome of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum State {
    /// It is there.
    Ok,
    /// It is missing, and the program works without it.
    Warning,
    /// It is missing, and something does not work without it.
    Missing,
}

#[derive(Debug, Serialize)]
struct Check {
    name: &'static str,
    state: State,
    found: String,
    // Scripts use the old name.
    #[serde(rename = "mend", skip_serializing_if = "Option::is_none")]
    fix: Option<String>,
}

#[derive(Debug, Serialize)]
struct Report {
    version: &'static str,
    checks: Vec<Check>,
}

impl Check {
    fn ok(name: &'static str, found: impl Into<String>) -> Check {
        Check { name, state: State::Ok, found: found.into(), fix: None }
    }

    fn bad(name: &'static str, state: State, found: impl Into<String>, fix: &str) -> Check {
        Check { name, state, found: found.into(), fix: Some(fix.to_owned()) }
    }
}

pub(super) fn run(args: &Args) -> Outcome {
    let checks = vec![
        simulator(),
        robots(),
        graphics(),
        training(),
        processor(),
        memory(),
        models(),
        page(),
        viser(),
        browser(),
        cache(),
    ];
    let missing = checks.iter().any(|c| c.state == State::Missing);
    let report = Report { version: env!("CARGO_PKG_VERSION"), checks };
    if args.json {
        out::json(&report)?;
    } else {
        let mut table = out::table(&["", "check", "found"]);
        for c in &report.checks {
            let mark = match c.state {
                State::Ok => "ok",
                State::Warning => "--",
                State::Missing => "!!",
            };
            let fix = c.fix.as_ref().map(|m| format!("\nmend: {m}")).unwrap_or_default();
            table.add_row([mark.to_owned(), c.name.to_owned(), format!("{}{fix}", c.found)]);
        }
        out::line(&table.to_string())?;
    }
    if missing {
        return Err(Failure::with(
            Exit::Missing,
            "something is missing; each line above names its fix",
        ));
    }
    Ok(())
}

fn simulator() -> Check {
    match mujoco::check_library() {
        Ok(()) => {
            let v = mujoco::VERSION;
            Check::ok("MuJoCo", format!("libmujoco {}.{}.{}", v / 100, v / 10 % 10, v % 10))
        }
        Err(e) => Check::bad(
            "MuJoCo",
            State::Missing,
            e.to_string(),
            "sudo apt-get install libmujoco2.2.2",
        ),
    }
}

fn robots() -> Check {
    let mut found = Vec::new();
    for id in Robot::builtin_ids() {
        match Robot::builtin(id) {
            Ok(r) => found.push(format!("{id} ({}/{})", r.state_dim(), r.action_dim())),
            Err(e) => {
                return Check::bad(
                    "robots",
                    State::Missing,
                    format!("{id}: {e}"),
                    "rebuild the program",
                );
            }
        }
    }
    Check::ok("robots", found.join(", "))
}

fn graphics() -> Check {
    match Renderer::new(RenderConfig::default()) {
        Ok(renderer) => {
            let (name, software) = renderer.adapter();
            Check::ok("graphics", if software { format!("{name}, software") } else { name })
        }
        Err(e) => Check::bad(
            "graphics",
            State::Missing,
            e.to_string(),
            "sudo apt-get install mesa-vulkan-drivers (software) or your graphics card's driver",
        ),
    }
}

/// The cards that `robert train --device` can choose.
fn training() -> Check {
    const NAME: &str = "training device";
    let describe = |cards: &[Card]| -> Vec<String> {
        let one = |(i, c): (usize, &Card)| {
            let half = if c.half() { ", --half" } else { "" };
            format!("gpu:{i} {} ({} MiB in one piece{half})", c.name, c.binding_bytes >> 20)
        };
        cards.iter().enumerate().map(one).collect()
    };
    let real = describe(&cards(false));
    if !real.is_empty() {
        return Check::ok(NAME, format!("cpu (default), {}", real.join(", ")));
    }
    let software = describe(&cards(true));
    let found = if software.is_empty() {
        "cpu; no graphics card answers through Vulkan".to_owned()
    } else {
        let software = software.join(", ");
        format!("cpu; no graphics card answers through Vulkan (software: {software})")
    };
    let fix = if Path::new("/proc/driver/nvidia/version").exists() {
        "the NVIDIA driver runs without its Vulkan part: libvulkan1, and the driver's package with \
         nvidia_icd.json in /usr/share/vulkan/icd.d"
    } else if Path::new("/dev/dri").exists() {
        "sudo apt-get install libvulkan1 mesa-vulkan-drivers, or your graphics card's driver"
    } else {
        "nothing to do on a machine without a graphics card"
    };
    Check::bad(NAME, State::Warning, found, fix)
}

fn processor() -> Check {
    let cores = super::global::cores();
    let name = field("/proc/cpuinfo", "model name").unwrap_or_else(|| "unknown processor".into());
    #[cfg(target_arch = "x86_64")]
    let features: Vec<&str> = [
        ("amx", crate::linalg::tiled()),
        ("avx512f", std::arch::is_x86_feature_detected!("avx512f")),
        ("avx2", std::arch::is_x86_feature_detected!("avx2")),
        ("fma", std::arch::is_x86_feature_detected!("fma")),
    ]
    .into_iter()
    .filter_map(|(n, on)| on.then_some(n))
    .collect();
    #[cfg(not(target_arch = "x86_64"))]
    let features: Vec<&str> = Vec::new();
    let found = format!("{cores} cores, {name}, {}", features.join(" "));
    if cfg!(target_arch = "x86_64") && !features.contains(&"avx2") {
        let fix =
            "training works, but is several times slower than on a processor of the last ten years";
        return Check::bad("processor", State::Warning, found, fix);
    }
    Check::ok("processor", found)
}

fn memory() -> Check {
    let kib = |name| field("/proc/meminfo", name)?.split_whitespace().next()?.parse::<f64>().ok();
    let (Some(total), Some(free)) = (kib("MemTotal"), kib("MemAvailable")) else {
        return Check::bad("memory", State::Warning, "unknown", "nothing to do");
    };
    let gib = |k: f64| k / f64::from(1 << 20);
    let found = format!("{:.1} GiB, {:.1} GiB available", gib(total), gib(free));
    if gib(free) < 1.0 {
        return Check::bad(
            "memory",
            State::Warning,
            found,
            "close other programs; training needs about 1 GiB",
        );
    }
    Check::ok("memory", found)
}

fn models() -> Check {
    const NAME: &str = "trained policies";
    match shipped::all() {
        Err(e) => Check::bad(NAME, State::Missing, e.to_string(), "rebuild the program"),
        Ok(found) if found.is_empty() => Check::bad(
            NAME,
            State::Warning,
            "none in this build",
            "robert train makes one for your robot",
        ),
        Ok(found) => {
            let names: Vec<String> =
                found.iter().map(|m| format!("{}/{}", m.robot, m.name)).collect();
            Check::ok(NAME, names.join(", "))
        }
    }
}

fn page() -> Check {
    const MEND: &str =
        "script/bootstrap, then cargo build --release (the first needs Node and npm)";
    if crate::studio::has_page() {
        Check::ok("studio page", "in this build")
    } else {
        Check::bad("studio page", State::Missing, "not in this build", MEND)
    }
}

fn viser() -> Check {
    const MEND: &str = "script/bootstrap, then cargo build --release; until then the studio's \
        viewport is made of stills";
    if crate::studio::has_viser() {
        Check::ok("3D client", "viser, in this build")
    } else {
        Check::bad("3D client", State::Warning, "not in this build", MEND)
    }
}

fn browser() -> Check {
    let names = ["chromium", "google-chrome", "chromium-browser", "microsoft-edge", "firefox"];
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&path)
        .flat_map(|dir| names.iter().map(move |n| dir.join(n)))
        .find(|p| p.is_file());
    match found {
        Some(p) => Check::ok("browser", version_of(&p)),
        None => {
            Check::bad("browser", State::Warning, "none on PATH", "sudo apt-get install chromium")
        }
    }
}

fn version_of(program: &Path) -> String {
    let out = Command::new(program).arg("--version").output().ok();
    let text =
        out.map(|o| String::from_utf8_lossy(&o.stdout).trim().to_owned()).unwrap_or_default();
    if text.is_empty() { program.display().to_string() } else { text }
}

fn cache() -> Check {
    let dir = crate::fsio::cache_dir();
    let probe = dir.join(".doctor");
    let tried = crate::fsio::write_atomic(&probe, b"ok").map(|()| std::fs::remove_file(&probe));
    match tried {
        Ok(_) => Check::ok("cache", dir.display().to_string()),
        Err(e) => Check::bad(
            "cache",
            State::Missing,
            e.to_string(),
            "set XDG_CACHE_HOME to a folder that you may write",
        ),
    }
}

/// The value after `name:` in a file of the kernel's.
fn field(path: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(PathBuf::from(path)).ok()?;
    let line = text.lines().find(|l| l.starts_with(name))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}
