//! The examples in the binary: every clip under `assets/clips`.

use rust_embed::RustEmbed;

use super::error::Error;
use super::protocol::GalleryItem;
use crate::clip::Clip;

#[derive(RustEmbed)]
#[folder = "assets/clips"]
#[allow_missing = true]
struct Clips;

/// All examples, by name of file.
pub(super) fn list() -> Vec<GalleryItem> {
    let mut items: Vec<GalleryItem> = Clips::iter()
        .filter_map(|file| {
            let id = file.strip_suffix(".clip.json")?.to_owned();
            let clip = open(&id).ok()?;
            let (length, keys) = (clip.length, clip.keys.len());
            Some(GalleryItem { id, name: clip.name, robot: clip.robot.id, length, keys })
        })
        .collect();
    items.sort_by(|a, b| a.id.cmp(&b.id));
    items
}

/// One example.
///
/// # Errors
/// [`Error::NotFound`], [`Error::Clip`].
pub(super) fn open(id: &str) -> Result<Clip, Error> {
    let file = Clips::get(&format!("{id}.clip.json"))
        .ok_or_else(|| Error::NotFound { what: format!("example \"{id}\"") })?;
    Ok(Clip::parse(&String::from_utf8_lossy(&file.data))?)
}
