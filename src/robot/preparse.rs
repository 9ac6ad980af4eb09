//! Reads a foreign model before the simulator does, and checks limits, paths and simple mistakes.
//!
//! The compiler of `MuJoCo` 2.2.2 needs minutes or all memory for some numbers (a composite of
//! 1000^3, a height field of 1e5 x 1e5, `nuser_body` of 2e9), opens any path that an include names,
//! and accepts NaN. All of that is refused here, with line and column. The result is one text
//! without includes and a list of files, all inside the project folder.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use roxmltree::{Document, Node};

pub(super) use super::asset_dirs::{AssetDirs, names_file, stem};
use super::bounds::{check, texture_bytes};
use super::error::{Error, line_column};
pub use super::missing::Without;
pub(super) use super::origin::{parse, place, refuse, refuse_at};
pub(super) use super::reference::{Unresolved, in_other_case, resolve};
use super::text::Edits;
use super::{foreign, lenient, missing};
use super::{mesh, text};
use robert_base::fsio;
use robert_base::limits;

/// The format of a model file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `MuJoCo`'s own.
    Mjcf,
    /// The robot description of ROS.
    Urdf,
}

/// A file that the model refers to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AssetRef {
    /// As written.
    pub written: String,
    /// Its path inside the project, with links resolved.
    pub path: PathBuf,
}

/// A foreign model that was accepted.
#[derive(Clone, Debug)]
pub struct Project {
    /// MJCF or URDF.
    pub format: Format,
    /// The text, includes replaced by their content.
    pub xml: String,
    /// The main file.
    pub path: PathBuf,
    /// The folder that contains everything, with links resolved.
    pub root: PathBuf,
    /// Meshes, textures and height fields in order of appearance (MJCF only; those of a URDF
    /// need package folders).
    pub assets: Vec<AssetRef>,
    /// Number of files that were read for the text.
    pub parts: usize,
    /// Names of elements and attributes of other programs (`drake:joint`), which are left out.
    pub foreign: BTreeSet<String>,
    /// What was left out because its file is missing.
    pub without: Without,
}

/// What happens to an MJCF's meshes, height fields, skins and textures whose files are missing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MissingFiles {
    /// The model is refused.
    #[default]
    Refuse,
    /// They are left out with all that consists of them.
    LeaveOut,
}

/// Reads and checks a model file. `root` is the folder that must contain its includes and meshes;
/// the default is the file's own folder.
///
/// # Errors
/// [`Error::Refused`], [`Error::File`].
pub fn read(path: &Path, root: Option<&Path>, missing: MissingFiles) -> Result<Project, Error> {
    let whole = |message: String| Error::Refused { message, line: 0, column: 0, path: path.into() };
    let xml = read_text(path)?;
    let dir = folder(path);
    let root = root.unwrap_or(dir);
    let root = root
        .canonicalize()
        .map_err(|e| whole(format!("cannot open the folder {}: {e}", root.display())))?;
    if !xml.trim_start_matches('\u{feff}').trim_start().starts_with('<') {
        let message = "this is not XML; a model is a URDF or an MJCF".to_owned();
        return Err(Error::Refused { message, line: 1, column: 1, path: path.to_owned() });
    }
    let (xml, foreign) = foreign::without(xml, path)?;
    let doc = parse(&xml, path)?;
    let name = doc.root_element().tag_name().name();
    let format = match name {
        "mujoco" => Format::Mjcf,
        "robot" => Format::Urdf,
        other => {
            let (line, column) = place(doc.root_element());
            let message = format!(
                "the root element is <{other}>; a model must start with <mujoco> (MJCF) or <robot> (URDF)"
            );
            return Err(Error::Refused { message, line, column, path: path.to_owned() });
        }
    };
    if format == Format::Urdf {
        check(&doc, path)?;
        drop(doc);
        let (assets, without) = (Vec::new(), Without::default());
        let path = path.into();
        return Ok(Project { format, xml, path, root, assets, parts: 1, foreign, without });
    }
    let seen = BTreeSet::new();
    let mut splice = Splice { dir: dir.into(), root: &root, seen, foreign, elements: 0, bytes: 0 };
    let mut xml = splice.expand(&xml, path, 0)?;
    let (parts, foreign) = (splice.seen.len() + 1, std::mem::take(&mut splice.foreign));
    let mut without = Without::default();
    if missing == MissingFiles::LeaveOut {
        (xml, without) = missing::without(&xml, path, dir, &root)?;
    }
    // Places in the assembled text are those of the file unless something was included.
    let doc = parse(&xml, path)?;
    let assets = assets(&doc, path, dir, &root)?;
    drop(doc);
    Ok(Project { format, xml, path: path.into(), root, assets, parts, foreign, without })
}

/// The files of a text that was changed after it was read, with all checks made again.
///
/// # Errors
/// As [`read`].
pub(super) fn again(xml: &str, path: &Path, root: &Path) -> Result<Vec<AssetRef>, Error> {
    let doc = parse(xml, path)?;
    check(&doc, path)?;
    assets(&doc, path, folder(path), root)
}

/// Reads a text file within the size limit, as UTF-8 without NUL.
fn read_text(path: &Path) -> Result<String, Error> {
    let refused = |message: String, text: &str, at: usize| {
        let (line, column) = line_column(text, at);
        Error::Refused { message, line, column, path: path.to_owned() }
    };
    let mut bytes = fsio::read_capped(path, limits::MODEL_BYTES)?;
    // Some tools end their files with NUL bytes.
    while bytes.last() == Some(&0) {
        bytes.pop();
    }
    let text = String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        let lossy =
            String::from_utf8_lossy(e.as_bytes().get(..at).unwrap_or_default()).into_owned();
        refused("this is not UTF-8 text; save the file as UTF-8".into(), &lossy, at)
    })?;
    if let Some(at) = text.find('\0') {
        return Err(refused(
            "the file contains a NUL byte, so it is not a text file".into(),
            &text,
            at,
        ));
    }
    if text.trim().is_empty() {
        return Err(refused("the file is empty".into(), &text, 0));
    }
    let text = lenient::mended(text.trim_start_matches('\u{feff}'));
    Ok(without_late_declaration(&text))
}

/// The text with an XML declaration that comes after blank lines blanked out: other programs
/// read such files.
fn without_late_declaration(text: &str) -> String {
    let trimmed = text.trim_start();
    let blank = text.len() - trimmed.len();
    match trimmed.find("?>") {
        Some(end) if blank > 0 && trimmed.starts_with("<?xml") => {
            let (head, rest) = text.split_at(blank + end + 2);
            let lines = "\n".repeat(head.matches('\n').count());
            lines + rest
        }
        _ => text.to_owned(),
    }
}

/// The folder of a file.
pub(super) fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    }
}

/// Replaces includes by their content.
struct Splice<'a> {
    /// Includes are relative to the main file, as in `MuJoCo`.
    dir: PathBuf,
    root: &'a Path,
    seen: BTreeSet<PathBuf>,
    foreign: BTreeSet<String>,
    elements: usize,
    bytes: u64,
}

impl Splice<'_> {
    fn expand(&mut self, xml: &str, path: &Path, deep: usize) -> Result<String, Error> {
        let doc = parse(xml, path)?;
        check(&doc, path)?;
        self.elements += doc.descendants().filter(Node::is_element).count();
        self.bytes += xml.len() as u64;
        if self.elements > limits::MODEL_ELEMENTS || self.bytes > limits::MODEL_BYTES {
            let message = format!(
                "the model and its includes have {} elements in {} bytes; at most {} and {} are read",
                self.elements,
                self.bytes,
                limits::MODEL_ELEMENTS,
                limits::MODEL_BYTES
            );
            return Err(refuse(doc.root_element(), path, message));
        }
        let mut edits = Edits::default();
        for attribute in doc.descendants().flat_map(|node| node.attributes()) {
            // The place of a value after a very long name is not known.
            let Some(written) = xml.get(attribute.range_value()) else { continue };
            let numbers = written.trim();
            if !numbers.is_empty() && numbers.len() < written.len() && is_numbers(numbers) {
                // This version takes a space at the end for one number more. Lines stay where they
                // are, for the messages.
                let lines = |text: &str| text.matches('\n').count();
                edits.replace(attribute.range_value(), numbers);
                edits.insert(attribute.range().end, "\n".repeat(lines(written) - lines(numbers)));
            }
        }
        for node in doc.descendants().filter(|n| n.has_tag_name("include")) {
            let file = node
                .attribute("file")
                .ok_or_else(|| refuse(node, path, "<include> has no file"))?;
            if deep >= limits::INCLUDE_DEPTH {
                let message =
                    format!("includes are nested more than {} deep", limits::INCLUDE_DEPTH);
                return Err(refuse(node, path, message));
            }
            let found = resolve(&self.dir, file, self.root).map_err(|m| refuse(node, path, m))?;
            let main = path.canonicalize().unwrap_or_else(|_| path.to_owned());
            if found == main || !self.seen.insert(found.clone()) {
                return Err(refuse(
                    node,
                    path,
                    format!("\"{file}\" is included twice or by itself"),
                ));
            }
            let (text, foreign) = foreign::without(read_text(&found)?, &found)?;
            self.foreign.extend(foreign);
            let inner = self.expand(&text, &found, deep + 1)?;
            let part = parse(&inner, &found)?;
            edits.replace(node.range(), text::inner(part.root_element(), &inner));
        }
        Ok(edits.apply(xml))
    }
}

/// Whether a value is a list of numbers.
fn is_numbers(value: &str) -> bool {
    value.split_ascii_whitespace().all(|number| number.parse::<f64>().is_ok())
}

fn assets(
    doc: &Document<'_>,
    path: &Path,
    dir: &Path,
    root: &Path,
) -> Result<Vec<AssetRef>, Error> {
    let mut found: Vec<AssetRef> = Vec::new();
    let mut known: BTreeMap<String, PathBuf> = BTreeMap::new();
    let (mut total, mut textures) = (0_u64, 0_u64);
    let dirs = AssetDirs::of(doc);
    for node in doc.descendants().filter(Node::is_element) {
        let tag = node.tag_name().name();
        let mut pictures = Vec::new();
        for a in node.attributes().filter(|a| names_file(tag, a.name())) {
            let below = dirs.path(tag, a.value());
            let seen = known.get(&below).cloned();
            let real = match &seen {
                Some(real) => real.clone(),
                None => resolve(dir, &below, root)
                    .map_err(|m| refuse(node, path, format!("{tag} file {}", String::from(m))))?,
            };
            if tag == "texture" {
                pictures.extend(mesh::png_size(&real));
            }
            if seen.is_some() {
                continue;
            }
            known.insert(below.clone(), real.clone());
            total += mesh::check_file(&real).map_err(|m| refuse(node, path, m))?;
            if total > limits::UPLOAD_BYTES || found.len() >= limits::PROJECT_FILES {
                let message = format!(
                    "the model refers to more than {} files or {} bytes",
                    limits::PROJECT_FILES,
                    limits::UPLOAD_BYTES
                );
                return Err(refuse(node, path, message));
            }
            found.push(AssetRef { written: below, path: real });
        }
        if tag == "texture" {
            textures = textures.saturating_add(texture_bytes(node, &pictures));
            if textures > limits::TEXTURE_BYTES {
                let message = format!(
                    "the textures need {textures} bytes unpacked; at most {} are supported",
                    limits::TEXTURE_BYTES
                );
                return Err(refuse(node, path, message));
            }
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bounds::SIZES;

    fn project(files: &[(&str, &str)]) -> (tempfile::TempDir, Result<Project, Error>) {
        let dir = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let p = dir.path().join(name);
            std::fs::create_dir_all(p.parent().unwrap()).unwrap();
            std::fs::write(p, text).unwrap();
        }
        let r = read(&dir.path().join(files[0].0), None, MissingFiles::Refuse);
        (dir, r)
    }

    #[test]
    fn includes_are_spliced_in_place() {
        let (_d, r) = project(&[
            ("a.xml", "<mujoco>\n<include file=\"sub/b.xml\"/>\n<worldbody/></mujoco>"),
            ("sub/b.xml", "<mujocoinclude><asset/><include file=\"c.xml\"/></mujocoinclude>"),
            ("c.xml", "<mujoco><size nstack=\"5\"/></mujoco>"),
        ]);
        let p = r.unwrap();
        assert_eq!(p.xml, "<mujoco>\n<asset/><size nstack=\"5\"/>\n<worldbody/></mujoco>");
        assert_eq!(p.parts, 3);
    }

    #[test]
    fn numbers_lose_their_outer_spaces() {
        let key = |qpos: &str| {
            format!("<mujoco><keyframe><key name='a ' qpos='{qpos}'/></keyframe></mujoco>")
        };
        let (_dir, read) = project(&[("main.xml", &key(" 0 1.5\n 2\n "))]);
        let xml = read.unwrap().xml;
        assert_eq!(xml, key("0 1.5\n 2").replace("2'/>", "2'\n/>"));
        // Of a longer name, the parser does not know where the value is.
        let long = format!("<mujoco {}=' 1 '/>", "é".repeat(33_000));
        let (_dir, read) = project(&[("main.xml", &long)]);
        assert!(read.is_ok(), "{read:?}");
    }

    #[test]
    fn nothing_leaves_the_folder() {
        for file in ["/etc/passwd", "../x.xml", "sub/../../x.xml", "..\\x.xml"] {
            let text = format!("<mujoco>\n  <include file=\"{file}\"/></mujoco>");
            let (_d, r) = project(&[("a.xml", &text)]);
            let e = r.unwrap_err();
            assert!(matches!(e, Error::Refused { line: 2, column: 3, .. }), "{e}");
            assert!(e.to_string().contains("outside the project folder"), "{e}");
        }
        let dir = tempfile::tempdir().unwrap();
        std::os::unix::fs::symlink("/etc/passwd", dir.path().join("link.xml")).unwrap();
        std::fs::write(dir.path().join("a.xml"), "<mujoco><include file=\"link.xml\"/></mujoco>")
            .unwrap();
        let e = read(&dir.path().join("a.xml"), None, MissingFiles::Refuse).unwrap_err();
        assert!(e.to_string().contains("outside the project folder"), "{e}");
    }

    #[test]
    fn textures_and_length_ranges_have_a_budget() {
        let texture = |kind: &str, n: usize, px: usize| {
            let one = format!(
                "<texture name=\"t\" type=\"{kind}\" builtin=\"flat\" width=\"{px}\" height=\"{px}\"/>"
            );
            format!("<mujoco><asset>{}</asset></mujoco>", one.repeat(n))
        };
        let range = |steps: usize, motors: usize| {
            format!(
                "<mujoco><compiler><lengthrange mode=\"all\" inttotal=\"{steps}\" timestep=\"1\"/>\
                 </compiler><actuator>{}</actuator></mujoco>",
                "<motor/>".repeat(motors)
            )
        };
        let steps = limits::LENGTH_RANGE_STEPS as usize / 2;
        for good in [texture("2d", 5, 4096), texture("cube", 3, 2048), range(steps, 1)] {
            project(&[("a.xml", &good)]).1.unwrap();
        }
        for (bad, why) in [
            (texture("2d", 6, 4096), "the textures need"),
            (texture("cube", 4, 2048), "the textures need"),
            (texture("skybox", 1, 4096), "the textures need"),
            (range(steps + 1, 1), "length ranges of 1 actuators"),
            (range(steps, 2), "length ranges of 2 actuators"),
            (range(10, 1).replace("timestep=\"1\"", "timestep=\"0\""), "length ranges"),
        ] {
            let e = project(&[("a.xml", &bad)]).1.unwrap_err();
            assert!(e.to_string().contains(why), "{e}");
        }
    }

    #[test]
    fn elements_are_counted_over_all_files() {
        let some = |n: usize| "<geom size=\"1\"/>".repeat(n);
        let main = |n: usize| {
            format!("<mujoco><worldbody>{}<include file=\"b.xml\"/></worldbody></mujoco>", some(n))
        };
        let other = format!("<mujocoinclude>{}</mujocoinclude>", some(limits::MODEL_ELEMENTS / 2));
        // Beside the geoms: the two roots, the world and the include.
        let half = limits::MODEL_ELEMENTS - limits::MODEL_ELEMENTS / 2 - 4;
        project(&[("a.xml", &main(half)), ("b.xml", &other)]).1.unwrap();
        let e = project(&[("a.xml", &main(half + 1)), ("b.xml", &other)]).1.unwrap_err();
        assert!(e.to_string().contains("have 8001 elements"), "{e}");
        assert!(matches!(e, Error::Refused { line: 1, .. }));
        let e = project(&[("a.xml", &main(limits::MODEL_ELEMENTS))]).1.unwrap_err();
        assert!(e.to_string().contains("more than 8000 elements"), "{e}");
    }

    #[test]
    fn depths_composites_and_textures_bind_at_the_cap() {
        let deep = |n: usize| {
            let inner = n - 2;
            let (open, shut) = ("<body>".repeat(inner), "</body>".repeat(inner));
            format!("<mujoco><worldbody>{open}{shut}</worldbody></mujoco>")
        };
        let composite = |n: usize| {
            format!(
                "<mujoco><worldbody><body><composite type=\"particle\" count=\"{n} 1 1\"/></body></worldbody></mujoco>"
            )
        };
        let texture = |px: u64| {
            format!(
                "<mujoco><asset><texture name=\"t\" type=\"2d\" builtin=\"flat\" width=\"1\" height=\"{px}\"/></asset></mujoco>"
            )
        };
        for (good, bad) in [
            (deep(limits::XML_DEPTH), deep(limits::XML_DEPTH + 1)),
            (composite(limits::COMPOSITE_ELEMENTS), composite(limits::COMPOSITE_ELEMENTS + 1)),
            (texture(limits::TEXTURE_PX), texture(limits::TEXTURE_PX + 1)),
        ] {
            project(&[("a.xml", &good)]).1.unwrap();
            let refused = project(&[("a.xml", &bad)]).1;
            assert!(matches!(refused, Err(Error::Refused { .. })), "{refused:?}");
        }
        let includes = |n: usize| {
            let file = |i: usize| match i {
                0 => ("a.xml".to_owned(), "mujoco"),
                i => (format!("{i}.xml"), "mujocoinclude"),
            };
            let dir = tempfile::tempdir().unwrap();
            for i in 0..=n {
                let (name, tag) = file(i);
                let next = if i < n {
                    format!("<include file=\"{}\"/>", file(i + 1).0)
                } else {
                    String::new()
                };
                std::fs::write(dir.path().join(name), format!("<{tag}>{next}</{tag}>")).unwrap();
            }
            read(&dir.path().join("a.xml"), None, MissingFiles::Refuse)
        };
        includes(limits::INCLUDE_DEPTH).unwrap();
        let refused = includes(limits::INCLUDE_DEPTH + 1).unwrap_err().to_string();
        assert!(refused.contains("includes are nested more than 8 deep"), "{refused}");
    }

    #[test]
    fn sizes_bind_at_the_cap() {
        for (tag, name, cap) in SIZES {
            let text = |v: u64| format!("<mujoco><{tag} {name}=\"{v}\"/></mujoco>");
            let (_d, ok) = project(&[("a.xml", &text(*cap))]);
            assert!(ok.is_ok(), "{tag} {name}: {ok:?}");
            let (_d, r) = project(&[("a.xml", &text(*cap + 1))]);
            assert!(matches!(r, Err(Error::Refused { .. })), "{tag} {name}");
        }
    }
}
