//! Exports the clip and its rollout to formats of other programs, by the functions of the command
//! line.

use crate::protocol::Error;
use crate::simulation::RolloutStore;
use robert_clip::{Clip, Command, formats};

/// A file to download.
#[derive(Debug)]
pub(crate) struct Download {
    /// Its name.
    pub(crate) name: String,
    /// Its media type.
    pub(crate) media_type: &'static str,
    /// Its content.
    pub(crate) bytes: Vec<u8>,
}

const FORMATS: &str = "json, csv, mjcf, ros, command, achieved-csv";

/// Writes the content of an exported file.
///
/// # Errors
/// [`Error::Request`] for an unknown format, [`Error::NotFound`] when nothing is simulated.
pub(crate) fn file(
    format: &str,
    clip: &Clip,
    command: &Command,
    rollout: &RolloutStore,
) -> Result<Download, Error> {
    let stem = stem(clip);
    let made =
        |end: &str, media_type, bytes| Download { name: format!("{stem}{end}"), media_type, bytes };
    match format {
        "json" => Ok(made(".clip.json", "application/json", clip.to_text().into_bytes())),
        "csv" => Ok(made(".csv", "text/csv", formats::to_csv(command).into_bytes())),
        "mjcf" => Ok(made(".xml", "application/xml", formats::to_mjcf(command)?.into_bytes())),
        "ros" => Ok(made(".yaml", "application/yaml", formats::to_ros(command)?.into_bytes())),
        "command" => {
            let text = formats::to_command_json(command, &clip.robot.id);
            Ok(made(".command.json", "application/json", text.into_bytes()))
        }
        "achieved-csv" => Ok(made("-achieved.csv", "text/csv", achieved(command, rollout)?)),
        other => Err(Error::request(format!("no format is called {other:?}; there are {FORMATS}"))),
    }
}

/// The media type of a file, by its suffix.
pub(crate) fn media_type(name: &str) -> &'static str {
    match name.rsplit('.').next().unwrap_or_default() {
        "mp4" => "video/mp4",
        "gif" => "image/gif",
        "png" | "apng" => "image/png",
        "csv" => "text/csv",
        "json" => "application/json",
        "xml" => "application/xml",
        "yaml" => "application/yaml",
        "html" => "text/html; charset=utf-8",
        _ => "application/octet-stream",
    }
}

/// The clip's title as a file name.
pub(crate) fn stem(clip: &Clip) -> String {
    let stem: String = clip
        .name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' })
        .take(60)
        .collect();
    if stem.trim_matches('_').is_empty() { "untitled".to_owned() } else { stem }
}

/// `frame,time,mask,<joint>...` of the achieved motion.
fn achieved(command: &Command, rollout: &RolloutStore) -> Result<Vec<u8>, Error> {
    let view = rollout.view();
    if view.q.is_empty() {
        return Err(Error::NotFound { what: "rollout to export yet".into() });
    }
    let joints = rollout.robot().map_or_else(|| command.joints().to_vec(), |f| f.table.names());
    let rows = view.q.iter().enumerate().map(|(frame, row)| {
        let masked = command.sight(frame as u32) == robert_clip::Sight::Masked;
        (frame as i64, masked, row.iter().map(Some))
    });
    Ok(formats::motion_to_csv(&joints, rows).into_bytes())
}
