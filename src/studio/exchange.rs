//! Files in and out of the page: exports of the clip as it is performed, models to import.
//!
//! An export is a job of the command line (`robert render`, `robert export`) on the clip as it
//! is now, saved or not: same clip, policy and seed give the same bits, so what is exported is
//! what was seen, and a film of minutes can be watched and cancelled like any job.

use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use serde::Deserialize;

use super::error::Error;
use super::jobs::{Extra, JobKind, JobRequest};
use super::protocol::RolloutSettings;
use crate::clip::Clip;
use crate::limits;
use crate::rollout::Guide;

/// Body of `POST /api/exports`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct ExportRequest {
    /// mp4, gif, apng, png, strip; mcap, csv, json, mjcf, ros, viser, html.
    format: String,
    /// The file to write, relative to the studio's folder; without it the result is fetched
    /// from the job.
    #[serde(default)]
    path: Option<String>,
    /// Pixels, for pictures and films.
    #[serde(default)]
    size: Option<[u32; 2]>,
    /// Frames `[from, to)`, for films; the frame `from`, for a picture.
    #[serde(default)]
    frames: Option<[u32; 2]>,
    /// What is laid over.
    #[serde(default)]
    overlay: Option<String>,
    /// fit, fixed, top, orbit, or a camera of the model.
    #[serde(default)]
    camera: Option<String>,
    /// Moments of a strip.
    #[serde(default)]
    moments: Option<u32>,
    /// What is drawn beside it.
    #[serde(default)]
    pub(super) compare: Option<Beside>,
}

/// What stands beside the clip in a picture or film.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) enum Beside {
    /// A take, performed once more: the same clip, policy and seed give the same bits.
    Take(u64),
    /// Another clip, performed by the same policy, or a take in a file; relative to the
    /// studio's folder.
    File(String),
}

/// What is exported.
#[derive(Debug)]
pub(super) struct Scene<'a> {
    pub(super) clip: &'a Clip,
    /// Where the robot is loaded from.
    pub(super) robot: &'a str,
    pub(super) settings: &'a RolloutSettings,
    pub(super) beside: Option<Second>,
}

/// [`Beside`], looked up.
#[derive(Clone, Debug)]
pub(super) enum Second {
    Take(Arc<Clip>, RolloutSettings),
    File(PathBuf),
}

const FILMS: [&str; 3] = ["mp4", "gif", "apng"];
const PICTURES: [&str; 2] = ["png", "strip"];
const TAKES: [&str; 16] = [
    "mcap", "csv", "json", "mjcf", "ros", "viser", "html", "glb", "bvh", "usda", "lafan", "npz",
    "ur", "bag", "lerobot", "minari",
];

/// The job that makes an export.
///
/// # Errors
/// [`Error::Request`] for options that make no sense, [`Error::Server`].
pub(super) fn job(
    ask: &ExportRequest,
    scene: &Scene<'_>,
    folder: &Path,
) -> Result<(JobRequest, Extra), Error> {
    let Scene { clip, robot, settings, beside } = scene;
    let format = ask.format.as_str();
    let scratch = Arc::new(tempfile::tempdir().map_err(Error::Server)?);
    let stem = super::export::stem(clip);
    let source = scratch.path().join(format!("{stem}.clip.json"));
    std::fs::write(&source, clip.to_text()).map_err(Error::Server)?;
    let ending = match format {
        "strip" => "png",
        "mjcf" => "xml",
        "ros" => "yaml",
        "lafan" => "lafan.csv",
        "ur" => "script",
        other => other,
    };
    let output = match &ask.path {
        Some(path) if path.is_empty() || path.contains('\0') => {
            return Err(Error::request("this is no path"));
        }
        Some(path) => folder.join(path),
        None => scratch.path().join(format!("{stem}.{ending}")),
    };
    let drawn = FILMS.contains(&format) || PICTURES.contains(&format);
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
    } else if TAKES.contains(&format) {
        option("--to", format.to_owned());
        JobKind::Export
    } else {
        let known = [&FILMS[..], &PICTURES, &TAKES].concat().join(", ");
        return Err(Error::request(format!("no format is called {format:?}; there are {known}")));
    };
    let extra = Extra {
        title: format!("{} as {format}", clip.name),
        output: Some(output),
        scratch: Some(scratch),
    };
    Ok((JobRequest { kind, args }, extra))
}

/// The policy as the command line takes it.
fn policy(settings: &RolloutSettings) -> String {
    let mut text = settings.policy.as_str().to_owned();
    if let Some(path) = &settings.model_path {
        text = format!("{text}:{path}");
    }
    if settings.guide == Guide::Linear {
        text.push_str("+guide");
    }
    if settings.refine {
        text.push_str("+refine");
    }
    text
}

/// The files of a robot that a page has sent: one folder, gone with the studio.
#[derive(Debug)]
pub struct Uploads {
    dir: tempfile::TempDir,
    held: Mutex<(u64, usize)>,
}

impl Uploads {
    /// None yet.
    ///
    /// # Errors
    /// When the system gives no folder.
    pub fn new() -> std::io::Result<Uploads> {
        Ok(Uploads { dir: tempfile::tempdir()?, held: Mutex::default() })
    }

    /// Where they are.
    pub(super) fn folder(&self) -> &Path {
        self.dir.path()
    }

    /// Keeps a file; `first` forgets those before.
    ///
    /// # Errors
    /// [`Error::Full`], [`Error::Request`], [`Error::Server`].
    pub(super) fn put(&self, name: &str, first: bool, bytes: &[u8]) -> Result<(), Error> {
        let path = upload_path(self.folder(), name)?;
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        if first {
            *held = (0, 0);
            for entry in std::fs::read_dir(self.folder()).map_err(Error::Server)?.flatten() {
                let old = entry.path();
                let gone = if old.is_dir() {
                    std::fs::remove_dir_all(old)
                } else {
                    std::fs::remove_file(old)
                };
                gone.map_err(Error::Server)?;
            }
        }
        held.0 += bytes.len() as u64;
        held.1 += 1;
        if held.0 > limits::UPLOAD_BYTES {
            return Err(Error::Full {
                what: "bytes in one robot",
                cap: limits::UPLOAD_BYTES as usize,
            });
        }
        if held.1 > limits::PROJECT_FILES {
            return Err(Error::Full { what: "files in one robot", cap: limits::PROJECT_FILES });
        }
        if let Some(dir) = path.parent() {
            std::fs::create_dir_all(dir).map_err(Error::Server)?;
        }
        std::fs::write(&path, bytes).map_err(Error::Server)
    }
}

/// Where an uploaded file of a robot goes: below `root`, whatever it is called.
///
/// # Errors
/// [`Error::Request`] for a name that leaves the folder or is none.
pub(super) fn upload_path(root: &Path, name: &str) -> Result<PathBuf, Error> {
    let path = Path::new(name);
    let plain = path.components().all(|c| matches!(c, Component::Normal(_)));
    let odd = name.is_empty() || name.len() > limits::NAME_BYTES || name.contains(['\0', '\\']);
    if !plain || odd {
        return Err(Error::request(format!("{name:?} is no file name inside a folder")));
    }
    Ok(root.join(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uploads_stay_in_their_folder() {
        let root = Path::new("/r");
        assert_eq!(upload_path(root, "a/b.stl").unwrap(), Path::new("/r/a/b.stl"));
        for bad in ["", "..", "../x", "a/../../x", "/etc/passwd", "a\\b", "a\0", "./.."] {
            assert!(upload_path(root, bad).is_err(), "{bad:?}");
        }
        assert!(upload_path(root, &"x".repeat(300)).is_err());
    }
}
