//! `robert studio`: the web app on this machine.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use super::failure::{Failure, Outcome};
use crate::robot::check;
use crate::studio::{self, StudioConfig};

/// Options of `robert studio`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert studio                       the examples\n  robert studio fire                  one of them\n  robert studio wave.clip.json        a file\n  robert studio --robot my_arm        an empty clip for your own robot\n  robert studio --no-open --port 8080   on a machine that you reach through a tunnel"
)]
pub(super) struct Args {
    /// Clip to open: a file, or the name of a built-in task (`fire`) [default: show the examples].
    clip: Option<PathBuf>,
    /// Robot of CLIP, or of a new, empty clip: an id, or a folder.
    #[arg(long, value_name = "ID|DIR")]
    robot: Option<String>,
    /// Model of the policy.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Port on 127.0.0.1; 0 chooses a free one.
    #[arg(long, default_value_t = 0)]
    port: u16,
    /// Print the address without opening a browser.
    #[arg(long)]
    no_open: bool,
    /// Open in its own window (needs a browser of the Chromium family).
    #[arg(long, conflicts_with = "no_open")]
    app: bool,
}

/// Browsers that know `--app=URL`.
const APP_BROWSERS: [&str; 6] = [
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "microsoft-edge",
    "brave-browser",
];

pub(super) fn run(args: Args) -> Outcome {
    // In Python the running program is no `robert`; the command that was installed with it is.
    let binary = check::executable().or_else(|_other_name| std::env::current_exe())?;
    let folder = std::env::current_dir()?;
    let model_path = args.model.map(std::path::absolute).transpose()?;
    let config = StudioConfig {
        clip_path: args.clip,
        robot: args.robot.map(absolute_robot).transpose()?,
        model_path,
        port: args.port,
        binary,
        state_dir: studio::state_dir(),
        folder,
    };
    let (no_open, app) = (args.no_open, args.app);
    studio::run(config, |url, once| {
        // Scripts wait for this line. A closed stdout must not end the studio.
        super::out::line(url).ok();
        if !no_open && !open(once, app) {
            tracing::info!("no browser could be started; open the address above yourself");
        }
    })
    .map_err(Failure::from)
}

/// The simulation runs in its own folder, so a robot's folder must be an absolute path.
fn absolute_robot(robot: String) -> std::io::Result<String> {
    if std::path::Path::new(&robot).is_dir() {
        return Ok(std::path::absolute(&robot)?.display().to_string());
    }
    Ok(robot)
}

/// Starts a browser. Everybody on this machine can read its arguments, so `url` contains a code
/// that can be used only once.
fn open(url: &str, app: bool) -> bool {
    let start = |program: &str, argument: &str| {
        Command::new(program)
            .arg(argument)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .is_ok()
    };
    let window = format!("--app={url}");
    (app && APP_BROWSERS.iter().any(|b| start(b, &window))) || start("xdg-open", url)
}
