//! Where an MJCF keeps the files that it names.

use std::path::PathBuf;

use roxmltree::Document;

/// Attributes with which an MJCF refers to files.
const FILES: &[(&str, &str)] = &[
    ("mesh", "file"),
    ("hfield", "file"),
    ("skin", "file"),
    ("texture", "file"),
    ("texture", "fileright"),
    ("texture", "fileleft"),
    ("texture", "fileup"),
    ("texture", "filedown"),
    ("texture", "filefront"),
    ("texture", "fileback"),
];

/// Whether this attribute of this MJCF element is a file name.
pub(super) fn names_file(tag: &str, attribute: &str) -> bool {
    FILES.contains(&(tag, attribute))
}

/// The name of a file without folder and extension: that of a mesh without a name.
pub(super) fn stem(written: &str) -> String {
    let file = written.rsplit(['/', '\\']).next().unwrap_or(written);
    file.rsplit_once('.').map_or(file, |(s, _)| s).to_owned()
}

/// Folders of meshes and textures from the compiler elements (the last one counts).
pub(super) struct AssetDirs {
    mesh: PathBuf,
    texture: PathBuf,
    strip: bool,
}

impl AssetDirs {
    /// Those of this document.
    pub(super) fn of(doc: &Document<'_>) -> AssetDirs {
        let (mut mesh, mut texture, mut strip) = (PathBuf::new(), PathBuf::new(), false);
        for c in doc.root_element().children().filter(|n| n.has_tag_name("compiler")) {
            if let Some(d) = c.attribute("assetdir") {
                (mesh, texture) = (PathBuf::from(d), PathBuf::from(d));
            }
            if let Some(d) = c.attribute("meshdir") {
                mesh = PathBuf::from(d);
            }
            if let Some(d) = c.attribute("texturedir") {
                texture = PathBuf::from(d);
            }
            if let Some(s) = c.attribute("strippath") {
                strip = s == "true";
            }
        }
        AssetDirs { mesh, texture, strip }
    }

    /// The path of a reference below the main file's folder.
    pub(super) fn path(&self, tag: &str, written: &str) -> String {
        let base = || written.rsplit(['/', '\\']).next().unwrap_or(written);
        let name = if self.strip { base() } else { written };
        let dir = if tag == "texture" { &self.texture } else { &self.mesh };
        dir.join(name).to_string_lossy().into_owned()
    }
}
