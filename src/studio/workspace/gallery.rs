//! The examples in the binary: the task clips, the best known ones first.

use crate::protocol::{Error, GalleryItem};
use robert_clip::Clip;
use robert_rollout::tasks;

/// The examples that stand first in the gallery, in this order; the other tasks follow.
const FIRST: [&str; 6] = [
    "shadow_hand/fire",
    "shadow_hand/rsp",
    "shadow_hand/six",
    "ur5e/hang",
    "ur5e/front_back",
    "pointmass/star",
];

/// All examples.
pub(crate) fn list() -> Vec<GalleryItem> {
    let Ok(manifest) = tasks::manifest() else { return Vec::new() };
    let mut ids: Vec<String> = FIRST.iter().map(|s| (*s).to_owned()).collect();
    for (robot, of_robot) in &manifest {
        let own = if of_robot.like.is_some() { 0 } else { usize::MAX };
        for task in of_robot.manual.iter().chain(&of_robot.extra).take(own) {
            let id = format!("{robot}/{task}");
            if !ids.contains(&id) {
                ids.push(id);
            }
        }
    }
    ids.into_iter()
        .filter_map(|id| {
            let clip = open(&id).ok()?;
            let (length, keys) = (clip.length, clip.keys.len());
            let featured = FIRST.contains(&id.as_str());
            Some(GalleryItem { id, name: clip.name, robot: clip.robot.id, length, keys, featured })
        })
        .collect()
}

/// One example.
///
/// # Errors
/// [`Error::NotFound`].
pub(crate) fn open(id: &str) -> Result<Clip, Error> {
    tasks::find(id, None).map_err(|_unknown| Error::NotFound { what: format!("example \"{id}\"") })
}
