//! An MJCF during an import, with its files and the remarks about it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::words::Words;
use crate::{Assets, Error, mesh, preparse, text};
use robert_base::fsio;
use robert_base::limits;
use robert_base::units;

/// The folder of meshes and textures inside a robot's folder.
pub(super) const ASSET_DIR: &str = "assets";

/// Two sites that are tied, and where the file says so.
#[derive(Clone, Debug)]
pub(super) struct Tie {
    pub(super) sites: [String; 2],
    pub(super) line: u32,
    pub(super) column: u32,
}

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Draft {
    /// Name for people.
    pub(super) title: String,
    /// The model.
    pub(super) xml: String,
    /// Its files by plain, unique, lower-case names.
    pub(super) assets: Assets,
    /// Speed limits that the source gives, rad/s or m/s.
    pub(super) speeds: BTreeMap<String, f64>,
    /// Joints whose source gives no effort; the torque limits of their motors are chosen once the
    /// model is compiled.
    pub(super) effortless: BTreeSet<String>,
    /// Whether the armature of the joints is ours and not the source's.
    pub(super) rotors_assumed: bool,
    /// Attributes that were removed because MuJoCo 2.2.2 does not know them: element/attribute.
    pub(super) unknown: BTreeSet<String>,
    /// Attributes that were removed and are applied after the model is compiled.
    pub(super) words: Words,
    /// Joints that took the place of free and ball joints, which no motor drives.
    pub(super) split: BTreeSet<String>,
    /// Sites that were tied, which must be at one place in the default pose.
    pub(super) ties: Vec<Tie>,
    pub(super) dropped: Vec<String>,
    pub(super) assumed: Vec<String>,
    pub(super) changed: Vec<String>,
    pub(super) warnings: Vec<String>,
    /// The origin of each file, so that one file is copied only once.
    pub(super) sources: BTreeMap<std::path::PathBuf, String>,
    /// Meshes by name that were rewritten, and why.
    pub(super) rewritten: BTreeSet<(String, &'static str)>,
    /// Bytes of the files so far.
    pub(super) bytes: u64,
}

impl Draft {
    /// Adds a file and returns its new name.
    pub(super) fn take(&mut self, path: &Path) -> Result<String, Error> {
        self.take_changed(path, |_, bytes| bytes)
    }

    /// Adds a file whose bytes are changed, and returns its new name.
    pub(super) fn take_changed(
        &mut self,
        path: &Path,
        change: impl FnOnce(&str, Vec<u8>) -> Vec<u8>,
    ) -> Result<String, Error> {
        if let Some(name) = self.sources.get(path) {
            return Ok(name.clone());
        }
        let refused =
            |message: String| Error::Refused { message, line: 0, column: 0, path: path.into() };
        let extension = mesh::extension(path);
        let bytes = fsio::read_capped(path, limits::MESH_BYTES)?;
        let written = path.to_string_lossy();
        let bytes = change(&written, mesh::normalised(&written, bytes).map_err(refused)?);
        let name = self.add(path, &extension, bytes)?;
        self.sources.insert(path.to_owned(), name.clone());
        Ok(name)
    }

    /// Adds content made from a file, under a plain name.
    pub(super) fn add(
        &mut self,
        path: &Path,
        extension: &str,
        bytes: Vec<u8>,
    ) -> Result<String, Error> {
        let stem = path.file_stem().map(|s| s.to_string_lossy().to_lowercase()).unwrap_or_default();
        let stem: String = stem
            .chars()
            .map(|c| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '_' })
            .take(100)
            .collect();
        let mut name = format!("{stem}.{extension}");
        let mut n = 2;
        while self.assets.iter().any(|(a, _)| *a == name) {
            name = format!("{stem}_{n}.{extension}");
            n += 1;
        }
        self.bytes += bytes.len() as u64;
        if self.bytes > limits::UPLOAD_BYTES || self.assets.len() >= limits::PROJECT_FILES {
            let message = format!(
                "with this file the model has more than {} bytes or {} files",
                limits::UPLOAD_BYTES,
                limits::PROJECT_FILES
            );
            return Err(Error::Refused { message, line: 0, column: 0, path: path.into() });
        }
        self.assets.push((name.clone(), bytes));
        Ok(name)
    }

    /// Adds sections at the end of the model, on the line of its closing tag, so that all earlier
    /// lines keep their numbers. In MJCF the last section has precedence.
    pub(super) fn append(&mut self, sections: &str, path: &Path) -> Result<(), Error> {
        let doc = preparse::parse(&self.xml, path)?;
        let mut edits = text::Edits::default();
        let root = doc.root_element();
        if let Some(at) = text::before_close(root) {
            edits.insert(at, sections);
        } else {
            let name = root.tag_name().name();
            edits.replace(root.range(), format!("<{name}>{sections}</{name}>"));
        }
        let xml = edits.apply(&self.xml);
        self.xml = xml;
        Ok(())
    }
}

/// The physics that every robot is simulated with.
pub(super) fn physics() -> String {
    format!("<option timestep=\"{}\" integrator=\"Euler\" cone=\"pyramidal\"/>", units::SIM_DT)
}
