//! Exports of the clip, and imports of models, for the page.
//!
//! An export is a job of the command line (`robert render`, `robert export`) on the clip as it is
//! now, saved or not. The same clip, policy and seed give the same bits, so the export shows
//! exactly the motion of the studio. A film of minutes can be watched and cancelled like any job.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{export, formats};
use crate::jobs::Extra;
use crate::protocol::{Error, ExportKind, ExportRequest, JobKind, JobRequest, RolloutSettings};
use robert_base::scratch::Scratch;
use robert_clip::Clip;

/// The content of an export.
#[derive(Debug)]
pub(crate) struct Scene<'a> {
    pub(crate) clip: &'a Clip,
    /// The source from which the robot is loaded.
    pub(crate) robot: &'a str,
    pub(crate) settings: &'a RolloutSettings,
    pub(crate) beside: Option<Second>,
}

/// [`Beside`], looked up.
#[derive(Clone, Debug)]
pub(crate) enum Second {
    Take(Arc<Clip>, RolloutSettings),
    File(PathBuf),
}

/// The file that an export is to write; `None` if the result is fetched from the job.
///
/// # Errors
/// [`Error::Request`] for what is no path.
pub(crate) fn target(ask: &ExportRequest, folder: &Path) -> Result<Option<PathBuf>, Error> {
    match &ask.path {
        Some(path) if path.is_empty() || path.contains('\0') => {
            Err(Error::request("this is no path"))
        }
        Some(path) => Ok(Some(folder.join(path))),
        None => Ok(None),
    }
}

/// The job that makes an export, into the target or a file of its own.
///
/// # Errors
/// [`Error::Request`] for options that make no sense, [`Error::Server`].
pub(crate) fn job(
    ask: &ExportRequest,
    scene: &Scene<'_>,
    target: Option<PathBuf>,
) -> Result<(JobRequest, Extra), Error> {
    let Scene { clip, robot, settings, beside } = scene;
    let format = ask.format.as_str();
    let scratch = Arc::new(Scratch::new().map_err(Error::Server)?);
    let stem = export::stem(clip);
    let source = scratch.path().join(format!("{stem}.clip.json"));
    std::fs::write(&source, clip.to_text()).map_err(Error::Server)?;
    let known = formats::named(format).filter(|f| f.kind != ExportKind::Clip || format == "json");
    let Some(known) = known else {
        let all: Vec<&str> = formats::FORMATS.iter().map(|f| f.format).collect();
        let all = all.join(", ");
        return Err(Error::request(format!("no format is called {format:?}; there are {all}")));
    };
    let ending = if format == "json" { "json" } else { known.ending };
    let output = target.unwrap_or_else(|| scratch.path().join(format!("{stem}.{ending}")));
    let drawn = matches!(known.kind, ExportKind::Film | ExportKind::Picture);
    let mut args: Vec<String> = vec![source.display().to_string()];
    let mut option = |name: &str, value: String| args.extend([name.to_owned(), value]);
    option("--policy", policy(settings));
    option("--seed", settings.seed.to_string());
    option("--robot", (*robot).to_owned());
    option("-o", output.display().to_string());
    let kind = if drawn {
        if let Some([w, h]) = ask.size {
            option("--size", format!("{w}x{h}"));
        }
        if let Some(overlay) = &ask.overlay {
            option("--overlay", overlay.clone());
        }
        if let Some(camera) = &ask.camera {
            option("--camera", camera.clone());
        }
        match beside {
            None => {}
            Some(Second::File(path)) => option("--compare", path.display().to_string()),
            Some(Second::Take(_, with)) if with.seed != settings.seed => {
                return Err(Error::request(format!(
                    "that take has seed {}, the clip seed {}: side by side both have one",
                    with.seed, settings.seed
                )));
            }
            Some(Second::Take(clip, with)) => {
                let second = scratch.path().join("beside.clip.json");
                std::fs::write(&second, clip.to_text()).map_err(Error::Server)?;
                option("--compare", second.display().to_string());
                option("--compare-policy", policy(with));
            }
        }
        match (format, ask.frames) {
            ("strip", _) => option("--strip", ask.moments.unwrap_or(6).to_string()),
            ("png", Some([frame, _])) => option("--frames", frame.to_string()),
            (_, Some([from, to])) => option("--frames", format!("{from}..{to}")),
            (_, None) => {}
        }
        JobKind::Render
    } else {
        option("--to", format.to_owned());
        JobKind::Export
    };
    let extra = Extra {
        title: format!("{} as {format}", clip.name),
        output: Some(output),
        scratch: Some(scratch),
    };
    Ok((JobRequest { kind, args }, extra))
}

/// The policy as an argument of the command line.
fn policy(settings: &RolloutSettings) -> String {
    let mut text = settings.policy.as_str().to_owned();
    if let Some(path) = &settings.model_path {
        text = format!("{text}:{path}");
    }
    text.push_str(settings.guide.suffix());
    if settings.refine {
        text.push_str("+refine");
    }
    text
}
