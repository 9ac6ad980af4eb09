//! Puts attached models (`<attach>` of `MuJoCo` 3) into the text of the model that attaches them.
//!
//! An attached model keeps its own default classes, angles and folders, and its names get a prefix. What
//! does not depend on the attached body stays away, as in `MuJoCo` 3.

mod angles;
mod piece;
mod submodel;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use roxmltree::{Document, Node};

pub(super) use angles::Angles;
use piece::{Piece, Which, is_joint};
use submodel::{Terms, has_defaults, in_terms};

use super::modern;
use crate::Error;
use crate::preparse::{self, Format, MissingFiles, Project};
use crate::text::{Edits, before_close, compiler, escape};
use robert_base::limits;

/// Settings of `<compiler>` that change inertias and cannot be written out.
const INERTIA: &[&str] = &["balanceinertia", "boundinertia", "boundmass"];

/// What there is to say about the attached models.
#[derive(Debug, Default)]
pub(super) struct Remarks {
    pub(super) changed: Vec<String>,
    pub(super) warnings: Vec<String>,
    missing: MissingFiles,
    /// Files read so far.
    read: usize,
    /// Places filled so far.
    placed: usize,
    /// Bytes of text read and rewritten so far.
    bytes: u64,
}

impl Remarks {
    /// Whether so much more text is still read or rewritten.
    fn affords(&mut self, text: &str) -> bool {
        self.bytes += text.len() as u64;
        self.bytes <= WORK * limits::MODEL_BYTES
    }

    fn warn(&mut self, line: String) {
        if !self.warnings.contains(&line) {
            self.warnings.push(line);
        }
    }
}

/// Text that is read and rewritten in all, as a multiple of the largest model.
const WORK: u64 = 4;

/// Reads a model with everything that it attaches.
///
/// # Errors
/// As [`preparse::read`]; [`Error::Refused`] for what cannot be attached.
pub(super) fn read(
    source: &Path,
    root: Option<&Path>,
    missing: MissingFiles,
) -> Result<(Project, Remarks), Error> {
    let mut remarks = Remarks { missing, ..Remarks::default() };
    let project = whole(source, root, 0, &mut remarks)?;
    Ok((project, remarks))
}

fn whole(
    source: &Path,
    root: Option<&Path>,
    deep: usize,
    remarks: &mut Remarks,
) -> Result<Project, Error> {
    let mut project = preparse::read(source, root, remarks.missing)?;
    if project.format != Format::Mjcf {
        return Ok(project);
    }
    let doc = preparse::parse(&project.xml, source)?;
    let models = Models::of(&doc, &project, deep, remarks)?;
    if places(&doc).next().is_none() && models.by_name.is_empty() {
        return Ok(project);
    }
    let text = joined(&project, &models, remarks)?;
    drop(doc);
    project.parts += models.by_name.values().map(|m| m.project.parts).sum::<usize>();
    for Submodel { project: part, .. } in models.by_name.values() {
        project.foreign.extend(part.foreign.iter().cloned());
        project.without.dropped.extend(part.without.dropped.iter().cloned());
        project.without.warnings.extend(part.without.warnings.iter().cloned());
    }
    project.assets = preparse::again(&text, source, &project.root)?;
    project.xml = text;
    Ok(project)
}

/// The places where something is attached.
fn places<'a, 'd>(doc: &'a Document<'d>) -> impl Iterator<Item = Node<'a, 'd>> {
    let in_world = |n: &Node<'_, '_>| n.ancestors().any(|a| a.has_tag_name("worldbody"));
    doc.descendants().filter(move |n| n.has_tag_name("attach") && in_world(n))
}

/// The models that one of them can attach, by name.
struct Models {
    by_name: BTreeMap<String, Submodel>,
}

struct Submodel {
    project: Project,
    /// Its folder, seen from the model that attaches it.
    folder: PathBuf,
}

impl Models {
    fn of(
        doc: &Document<'_>,
        project: &Project,
        deep: usize,
        remarks: &mut Remarks,
    ) -> Result<Models, Error> {
        let path = &project.path;
        let dir = preparse::folder(path);
        let mut by_name = BTreeMap::new();
        let sections = doc.root_element().children().filter(|n| n.has_tag_name("asset"));
        for node in sections.flat_map(|s| s.children()).filter(|n| n.has_tag_name("model")) {
            let refuse = |message: String| preparse::refuse(node, path, message);
            let file =
                node.attribute("file").ok_or_else(|| refuse("<model> has no file".into()))?;
            remarks.read += 1;
            if deep >= limits::INCLUDE_DEPTH || remarks.read > limits::ATTACHED_MODELS {
                return Err(refuse(format!(
                    "models that attach models are read {} deep, and {} in all",
                    limits::INCLUDE_DEPTH,
                    limits::ATTACHED_MODELS
                )));
            }
            let found = preparse::resolve(dir, file, &project.root)
                .map_err(|m| refuse(format!("model file {}", String::from(m))))?;
            let read = whole(&found, Some(&project.root), deep + 1, remarks)?;
            if read.format == Format::Urdf {
                let message = "a URDF cannot be attached; import it alone, or save it as an MJCF";
                return Err(refuse(message.into()));
            }
            if !remarks.affords(&read.xml) {
                return Err(refuse("the attached models are too large in all".into()));
            }
            let read = without_replicas(read, remarks.read)?;
            let own = preparse::parse(&read.xml, &found)?;
            let own = own.root_element().attribute("model").unwrap_or("MuJoCo Model").to_owned();
            let name = node.attribute("name").map_or(own, str::to_owned);
            let plain = file.replace('\\', "/");
            let folder = Path::new(&plain).parent().unwrap_or(Path::new("")).to_owned();
            if by_name.contains_key(&name) {
                return Err(refuse(format!(
                    "two models are called {name:?}; give one another name"
                )));
            }
            by_name.insert(name, Submodel { project: read, folder });
        }
        Ok(Models { by_name })
    }

    fn names(&self) -> String {
        self.by_name.keys().map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ")
    }
}

/// The text of a model in which every `<attach>` is replaced by what it attaches.
fn joined(project: &Project, models: &Models, remarks: &mut Remarks) -> Result<String, Error> {
    let path = &project.path;
    let base = host(project, models, remarks)?;
    let doc = preparse::parse(&base, path)?;
    let angles = Angles::of(&doc);
    let (mut edits, mut sections, mut bytes) = (Edits::default(), String::new(), base.len());
    let all: Vec<Node<'_, '_>> = places(&doc).collect();
    let alone = all.len() == 1 && !doc.descendants().any(|n| is_joint(&n));
    for node in &all {
        let refuse = |message: String| preparse::refuse(*node, path, message);
        let prefix = node.attribute("prefix").unwrap_or_default();
        let which = Which::of(*node);
        let (xml, from, folder) = match node.attribute("model") {
            Some(name) => {
                let Some(model) = models.by_name.get(name) else {
                    let known = models.names();
                    let message = format!(
                        "<attach> names the model {name:?}, which no <model> in <asset> has; there are: {known}"
                    );
                    return Err(refuse(message));
                };
                (model.project.xml.clone(), model.project.path.as_path(), model.folder.clone())
            }
            None if which == Which::World => {
                return Err(refuse("<attach> names neither a model nor a body".into()));
            }
            None if prefix.is_empty() => {
                return Err(refuse("<attach> of a part of this model needs a prefix".into()));
            }
            None => (without_places(&base, path)?, path.as_path(), PathBuf::new()),
        };
        if !remarks.affords(&xml) {
            return Err(refuse("the attached models are too large in all".into()));
        }
        remarks.placed += 1;
        let main = format!("{prefix}attached_{}", remarks.placed);
        let terms = Terms { prefix, main: Some(&main), angles: &angles, folder };
        let piece = Piece::cut(&in_terms(&xml, from, &terms)?, from, &which, prefix, &main)
            .map_err(|e| e.at(*node, path))?;
        let copied = node.ancestors().any(|a| a.has_tag_name("replicate"));
        if copied && piece.has_dependents {
            let message = "<attach> of a model with motors, tendons or constraints inside of a <replicate>; \
                           write out the <replicate>";
            return Err(refuse(message.into()));
        }
        bytes += piece.body.len() + piece.sections.len();
        if bytes as u64 > limits::MODEL_BYTES {
            return Err(refuse("with its attached models the model is too large".into()));
        }
        edits.replace(node.range(), piece.body);
        sections += &piece.sections;
        if let Some(keys) = piece.keys.filter(|_| alone) {
            sections += &keys;
        }
        settings(&xml, from, (&doc, all.len()), &mut sections, remarks)?;
    }
    let models_read = doc
        .descendants()
        .filter(|n| n.has_tag_name("model") && n.parent().is_some_and(|p| p.has_tag_name("asset")));
    models_read.for_each(|n| edits.replace(n.range(), ""));
    if let Some(at) = before_close(doc.root_element()) {
        edits.insert(at, sections);
    }
    if !all.is_empty() {
        let files = models.by_name.values().map(|m| {
            m.project.path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
        });
        let files: Vec<String> = files.collect();
        remarks.changed.push(format!(
            "{} <attach> of MuJoCo 3 were replaced by what they attach{}{}",
            all.len(),
            if files.is_empty() { "" } else { ": " },
            files.join(", ")
        ));
    }
    Ok(edits.apply(&base))
}

/// The model that attaches: files are written without `meshdir`, and its outermost default class, from which
/// the attached parts must not inherit, gets a name.
fn host(project: &Project, models: &Models, remarks: &mut Remarks) -> Result<String, Error> {
    let doc = preparse::parse(&project.xml, &project.path)?;
    remarks.placed += 1;
    let main = format!("attaching_{}", remarks.placed);
    let main = (has_defaults(&doc) && !models.by_name.is_empty()).then_some(main.as_str());
    let terms = Terms { prefix: "", main, angles: &Angles::of(&doc), folder: PathBuf::new() };
    in_terms(&project.xml, &project.path, &terms)
}

fn without_places(xml: &str, path: &Path) -> Result<String, Error> {
    let doc = preparse::parse(xml, path)?;
    let mut edits = Edits::default();
    places(&doc).for_each(|n| edits.replace(n.range(), ""));
    Ok(edits.apply(xml))
}

/// Takes over the settings of an attached model that its inertias depend on, if the model that attaches it
/// has no bodies of its own and no other attached one says otherwise; warns of the others. Here a setting
/// counts for every body.
fn settings(
    xml: &str,
    path: &Path,
    (host, all_here): (&Document<'_>, usize),
    sections: &mut String,
    remarks: &mut Remarks,
) -> Result<(), Error> {
    let doc = preparse::parse(xml, path)?;
    let has_bodies = host.descendants().any(|n| {
        ["geom", "inertial"].contains(&n.tag_name().name())
            && n.ancestors().skip(1).any(|p| p.has_tag_name("body"))
    });
    for name in INERTIA {
        let mine = compiler(&doc, name);
        if mine == compiler(host, name) {
            continue;
        }
        let line = mine.map(|v| format!("<compiler {name}=\"{}\"/>", escape(v)));
        let known = sections.contains(&format!("<compiler {name}=\""));
        let first = all_here == 1;
        match line {
            Some(line) if sections.contains(&line) => {}
            Some(line) if first && !has_bodies && compiler(host, name).is_none() => {
                sections.push_str(&line);
            }
            None if !known && compiler(host, name).is_none() => {}
            _ => remarks.warn(format!(
                "{name} of {} does not count: the models that are put together do not agree on it; masses and \
                 inertias may differ",
                path.display()
            )),
        }
    }
    let limits = |doc: &Document<'_>| compiler(doc, "autolimits") == Some("false");
    if limits(&doc) != limits(host) {
        remarks.warn(format!(
            "autolimits of {} does not count: the model that attaches it decides whether ranges are limits",
            path.display()
        ));
    }
    Ok(())
}

/// The model with its replicas written out, because what belongs to one of them is found by its name.
fn without_replicas(mut project: Project, number: usize) -> Result<Project, Error> {
    if project.xml.contains("<replicate") {
        let stem = format!("model_{number}_");
        project.xml = modern::flatten(project.xml, &project.path, &stem)?.0;
    }
    Ok(project)
}

#[cfg(test)]
mod tests;
