//! Reads a [`Clip`] from text. Every error names its line and column; nothing is skipped silently.

use std::collections::BTreeMap;
use std::path::Path;

use super::document::{Clip, FORMAT, Key, Marker, Mask, RobotRef, Start};
use super::error::ClipError;
use super::flaw::Invalid;
use super::json::{Kind, Read, Reader, show};
use super::offset::{FADE_FRAMES, Offset};
use super::parse_key::{Budget, missing, read_fill, read_key, read_row, unknown};
use super::place::{line_col, line_cols, locate, locate_all};
use robert_base::fsio;
use robert_base::limits;
use robert_base::units::{FPS, Unit};

/// A clip with the places of its values in the text.
#[derive(Clone, Debug)]
pub struct Parsed {
    /// The clip, in canonical order.
    pub clip: Clip,
    /// Position in the file of `clip.keys[i]`, likewise of the other lists.
    keys: Vec<usize>,
    offsets: Vec<usize>,
    masks: Vec<usize>,
    markers: Vec<usize>,
    text: String,
}

impl Parsed {
    /// A clip with its canonical text, as if read from a formatted file.
    pub fn of(clip: &Clip) -> Parsed {
        let mut clip = clip.clone();
        clip.normalize();
        let all = |n: usize| (0..n).collect();
        Parsed {
            keys: all(clip.keys.len()),
            offsets: all(clip.offsets.len()),
            masks: all(clip.masks.len()),
            markers: all(clip.markers.len()),
            text: clip.to_text(),
            clip,
        }
    }

    /// Lines and columns of what JSON pointers into the canonical clip name.
    pub fn places<'p>(&self, pointers: impl IntoIterator<Item = &'p str>) -> Vec<(usize, usize)> {
        let pointers: Vec<String> = pointers.into_iter().map(|p| self.in_file(p)).collect();
        let bytes = locate_all(&self.text, pointers.iter().map(String::as_str));
        line_cols(&self.text, &bytes)
    }

    /// A rule that this clip breaks, with line and column.
    pub fn broken(&self, invalid: Invalid) -> ClipError {
        let Invalid { pointer, flaw } = invalid;
        let (line, col) = self.places([pointer.as_str()]).first().copied().unwrap_or((1, 1));
        ClipError::Invalid { flaw, pointer, line, col, path: None }
    }

    /// The pointer to the same value in the file, whose lists may have another order.
    fn in_file(&self, pointer: &str) -> String {
        let mut steps: Vec<&str> = pointer.split('/').collect();
        let order = match steps.get(1).copied() {
            Some("keys") => &self.keys,
            Some("offsets") => &self.offsets,
            Some("masks") => &self.masks,
            Some("markers") => &self.markers,
            _ => return pointer.to_owned(),
        };
        let index = steps.get(2).and_then(|step| step.parse::<usize>().ok());
        let Some(at) = index.and_then(|i| order.get(i)).map(usize::to_string) else {
            return pointer.to_owned();
        };
        steps[2] = &at;
        steps.join("/")
    }
}

impl Clip {
    /// Reads a clip from its text.
    ///
    /// # Errors
    /// [`ClipError::Syntax`] or [`ClipError::Invalid`], with line and column.
    pub fn parse(text: &str) -> Result<Clip, ClipError> {
        parse(text.to_owned()).map(|p| p.clip)
    }

    /// Reads a clip file.
    ///
    /// # Errors
    /// [`ClipError`], naming the file, line and column.
    pub fn load(path: &Path) -> Result<Clip, ClipError> {
        load(path).map(|p| p.clip)
    }

    /// Writes the canonical text atomically.
    ///
    /// # Errors
    /// [`ClipError::File`].
    pub fn save(&self, path: &Path) -> Result<(), ClipError> {
        Ok(fsio::write_atomic(path, self.to_text().as_bytes())?)
    }
}

/// Reads a clip file and keeps its text for places.
///
/// # Errors
/// [`ClipError`].
pub fn load(path: &Path) -> Result<Parsed, ClipError> {
    let bytes = fsio::read_capped(path, limits::CLIP_BYTES)?;
    parse_bytes(bytes).map_err(|e| e.in_file(path))
}

/// Reads a clip from bytes that may not even be text.
///
/// # Errors
/// [`ClipError`].
pub fn parse_bytes(bytes: Vec<u8>) -> Result<Parsed, ClipError> {
    let text = utf8(bytes)?;
    if text.starts_with('\u{feff}') {
        return Err(ClipError::at(
            "the file begins with a byte order mark; save it as plain UTF-8",
            1,
            1,
        ));
    }
    parse(text)
}

/// Bytes as text, or the place of the first byte that is not text.
pub(crate) fn utf8(bytes: Vec<u8>) -> Result<String, ClipError> {
    String::from_utf8(bytes).map_err(|e| {
        let good = e.utf8_error().valid_up_to();
        let head = String::from_utf8_lossy(e.as_bytes().get(..good).unwrap_or_default());
        let (line, col) = line_col(&head, head.len());
        ClipError::at("this byte is not valid UTF-8", line, col)
    })
}

/// Reads a clip and keeps its text for places.
///
/// # Errors
/// [`ClipError`].
pub fn parse(text: String) -> Result<Parsed, ClipError> {
    let mut clip = match read(&text) {
        Ok(clip) => clip,
        Err(fault) => {
            let (line, col) = line_col(&text, fault.at);
            return Err(ClipError::at(fault.message, line, col));
        }
    };
    if let Err(Invalid { pointer, flaw }) = clip.validate() {
        let (line, col) = line_col(&text, locate(&text, &pointer));
        return Err(ClipError::Invalid { flaw, pointer, line, col, path: None });
    }
    let keys = order(&clip.keys, |k| k.frame);
    let offsets = order(&clip.offsets, |o| o.frame);
    let masks = order(&clip.masks, Clone::clone);
    let markers = order(&clip.markers, |m| m.frame);
    clip.normalize();
    Ok(Parsed { clip, keys, offsets, masks, markers, text })
}

fn order<T, K: Ord>(items: &[T], by: impl Fn(&T) -> K) -> Vec<usize> {
    let mut order: Vec<usize> = (0..items.len()).collect();
    order.sort_by_key(|&i| items.get(i).map(&by));
    order
}

fn read(text: &str) -> Read<Clip> {
    const KNOWN: &[&str] = &[
        "format", "name", "notes", "robot", "fps", "length", "fill", "start", "poses", "keys",
        "offsets", "masks", "markers", "x",
    ];
    check_format(text)?;
    let mut r = Reader::new(text);
    let top = r.here();
    let mut clip = Clip::new(RobotRef::default(), 0);
    let (mut format, mut robot, mut fps, mut length, mut keys) =
        (false, false, false, false, false);
    let mut budget = Budget {
        values: limits::CLIP_VALUES,
        tangents: limits::CLIP_TANGENTS,
        reaches: limits::CLIP_REACHES,
    };
    r.object("a clip (an object)", |r, key, at| {
        match key.as_str() {
            "format" => {
                format = true;
                r.string("a string")?;
            }
            "name" => clip.name = r.string("a string")?,
            "notes" => clip.notes = r.string("a string")?,
            "robot" => {
                robot = true;
                clip.robot = read_robot(r)?;
            }
            "fps" => {
                fps = true;
                r.integer("fps", FPS, FPS)?;
            }
            "length" => {
                length = true;
                clip.length = r.integer("length", 1, limits::CLIP_FRAMES)?;
            }
            "fill" => clip.fill = read_fill(r)?,
            "start" => clip.start = Some(read_start(r)?),
            "poses" => r.object("an object of named poses", |r, name, at| {
                if clip.poses.len() >= limits::CLIP_POSES {
                    let cap = limits::CLIP_POSES;
                    return r.fault(at, format!("more than {cap} poses"));
                }
                clip.poses.insert(name, read_row(r, &mut budget.values)?);
                Ok(())
            })?,
            "keys" => {
                keys = true;
                clip.keys = read_keys(r, &mut budget)?;
            }
            "offsets" => clip.offsets = read_offsets(r)?,
            "masks" => clip.masks = read_masks(r)?,
            "markers" => clip.markers = read_markers(r)?,
            "x" => {
                let mut left = limits::CLIP_EXTRA_VALUES;
                r.object("an object of extensions", |r, name, _| {
                    clip.x.insert(name, r.value(&mut left)?);
                    Ok(())
                })?;
            }
            _ => return unknown(r, at, &key, "the clip", KNOWN),
        }
        Ok(())
    })?;
    r.end()?;
    for (present, key) in
        [(format, "format"), (robot, "robot"), (fps, "fps"), (length, "length"), (keys, "keys")]
    {
        if !present {
            return missing(&r, top, "the clip", key);
        }
    }
    Ok(clip)
}

/// Checked first: a newer format may differ everywhere, so the error must not be about one of its
/// unknown keys.
fn check_format(text: &str) -> Read<()> {
    let mut found = None;
    // Nothing behind it is read here; usually it comes first.
    let to_it = Reader::new(text).object("a clip (an object)", |r, key, at| {
        if key != "format" {
            return r.skip();
        }
        found = Some(r.here());
        r.fault(at, "found")
    });
    let (Some(at), Err(_)) = (found, to_it) else { return Ok(()) };
    let mut r = Reader::new(text.get(at..).unwrap_or_default());
    if r.kind() != Kind::String {
        return Ok(());
    }
    let Ok(format) = r.string("a string") else { return Ok(()) };
    if format == FORMAT {
        return Ok(());
    }
    let major = format.strip_prefix("robert-clip/").and_then(|m| m.parse::<u32>().ok());
    let message = match major {
        Some(m) if m > 1 => {
            format!("format {} is newer than this program, which reads {FORMAT}", show(&format))
        }
        _ => format!("the format is \"{}\", not {FORMAT}", show(&format)),
    };
    r.fault(at, message)
}

fn read_robot(r: &mut Reader<'_>) -> Read<RobotRef> {
    let at = r.here();
    let mut robot = RobotRef::default();
    let (mut id, mut joints) = (false, false);
    r.object("a robot (an object)", |r, key, at| {
        match key.as_str() {
            "id" => {
                id = true;
                robot.id = r.string("a string")?;
            }
            "model" => robot.model = Some(r.string("a string")?),
            "model_sha256" => robot.model_sha256 = Some(r.string("a string")?),
            "joints" => {
                joints = true;
                robot.joints = read_names(r, &mut limits::JOINTS.saturating_add(1))?;
            }
            "units" => r.array("an array of units", |r, i| {
                let at = r.here();
                let word = r.string("\"rad\" or \"m\"")?;
                if i >= limits::JOINTS {
                    return r.fault(at, format!("more than {} units", limits::JOINTS));
                }
                robot.units.push(match word.as_str() {
                    "rad" => Unit::Rad,
                    "m" => Unit::M,
                    _ => {
                        let word = show(&word);
                        return r
                            .fault(at, format!("a unit must be \"rad\" or \"m\", not \"{word}\""));
                    }
                });
                Ok(())
            })?,
            _ => {
                let known = ["id", "model", "model_sha256", "joints", "units"];
                return unknown(r, at, &key, "the robot", &known);
            }
        }
        Ok(())
    })?;
    if !id {
        return missing(r, at, "the robot", "id");
    }
    if !joints {
        return missing(r, at, "the robot", "joints");
    }
    Ok(robot)
}

fn read_names(r: &mut Reader<'_>, budget: &mut usize) -> Read<Vec<String>> {
    let mut names = Vec::new();
    r.array("an array of joint names", |r, _| {
        let at = r.here();
        names.push(r.string("a joint name")?);
        *budget = match budget.checked_sub(1) {
            Some(left) if left > 0 => left,
            _ => return r.fault(at, "too many joint names"),
        };
        Ok(())
    })?;
    Ok(names)
}

fn read_start(r: &mut Reader<'_>) -> Read<Start> {
    let at = r.here();
    let mut start = None;
    r.object("a start (an object)", |r, key, at| {
        if start.is_some() {
            return r.fault(at, "a start needs either `pose` or `q`, not both");
        }
        start = Some(match key.as_str() {
            "pose" => Start::Pose(r.string("a pose name")?),
            "q" => {
                let mut q = Vec::new();
                r.array("an array of numbers", |r, i| {
                    let at = r.here();
                    if i >= limits::JOINTS {
                        return r.fault(at, format!("more than {} values", limits::JOINTS));
                    }
                    q.push(r.number("a number (the start needs every joint)")?);
                    Ok(())
                })?;
                Start::Q(q)
            }
            _ => return unknown(r, at, &key, "the start", &["pose", "q"]),
        });
        Ok(())
    })?;
    match start {
        Some(start) => Ok(start),
        None => missing(r, at, "the start", "pose` or `q"),
    }
}

fn read_keys(r: &mut Reader<'_>, budget: &mut Budget) -> Read<Vec<Key>> {
    let mut keys = Vec::new();
    r.array("an array of keys", |r, i| {
        let at = r.here();
        if i >= limits::CLIP_KEYS {
            return r.fault(at, format!("more than {} keys", limits::CLIP_KEYS));
        }
        keys.push(read_key(r, budget)?);
        Ok(())
    })?;
    Ok(keys)
}

fn read_masks(r: &mut Reader<'_>) -> Read<Vec<Mask>> {
    let mut masks = Vec::new();
    let mut budget = limits::CLIP_MASK_JOINTS + 1;
    r.array("an array of mask spans", |r, i| {
        let at = r.here();
        if i >= limits::CLIP_SPANS {
            return r.fault(at, format!("more than {} mask spans", limits::CLIP_SPANS));
        }
        let (mut from, mut to, mut joints) = (None, None, None);
        r.object("a mask span (an object)", |r, key, at| {
            match key.as_str() {
                "from" => from = Some(r.integer("from", 0, u32::MAX)?),
                "to" => to = Some(r.integer("to", 0, u32::MAX)?),
                "joints" => joints = Some(read_names(r, &mut budget)?),
                _ => return unknown(r, at, &key, "a mask span", &["from", "to", "joints"]),
            }
            Ok(())
        })?;
        let Some(from) = from else { return missing(r, at, "a mask span", "from") };
        let Some(to) = to else { return missing(r, at, "a mask span", "to") };
        masks.push(Mask { from, to, joints });
        Ok(())
    })?;
    Ok(masks)
}

fn read_offsets(r: &mut Reader<'_>) -> Read<Vec<Offset>> {
    let mut offsets = Vec::new();
    let mut budget = limits::CLIP_OFFSETS;
    r.array("an array of offsets", |r, i| {
        let at = r.here();
        if i >= limits::CLIP_SPANS {
            return r.fault(at, format!("more than {} offsets", limits::CLIP_SPANS));
        }
        let (mut frame, mut add) = (None, None);
        let (mut fade_in, mut hold, mut fade_out) = (FADE_FRAMES, 1, FADE_FRAMES);
        r.object("an offset (an object)", |r, key, at| {
            match key.as_str() {
                "frame" => frame = Some(r.integer("frame", 0, u32::MAX)?),
                "add" => add = Some(read_added(r, &mut budget)?),
                "in" => fade_in = r.integer("in", 0, limits::CLIP_FRAMES)?,
                "hold" => hold = r.integer("hold", 1, limits::CLIP_FRAMES)?,
                "out" => fade_out = r.integer("out", 0, limits::CLIP_FRAMES)?,
                _ => {
                    let known = ["frame", "add", "in", "hold", "out"];
                    return unknown(r, at, &key, "an offset", &known);
                }
            }
            Ok(())
        })?;
        let Some(frame) = frame else { return missing(r, at, "an offset", "frame") };
        let Some(add) = add else { return missing(r, at, "an offset", "add") };
        offsets.push(Offset { frame, add, fade_in, hold, fade_out });
        Ok(())
    })?;
    Ok(offsets)
}

fn read_added(r: &mut Reader<'_>, budget: &mut usize) -> Read<BTreeMap<String, f64>> {
    let mut add = BTreeMap::new();
    r.object("an object of values by joint", |r, joint, at| {
        *budget = match budget.checked_sub(1) {
            Some(left) => left,
            None => {
                let cap = limits::CLIP_OFFSETS;
                return r.fault(at, format!("more than {cap} values in offsets"));
            }
        };
        add.insert(joint, r.number("a number")?);
        Ok(())
    })?;
    Ok(add)
}

fn read_markers(r: &mut Reader<'_>) -> Read<Vec<Marker>> {
    let mut markers = Vec::new();
    r.array("an array of markers", |r, i| {
        let at = r.here();
        if i >= limits::CLIP_SPANS {
            return r.fault(at, format!("more than {} markers", limits::CLIP_SPANS));
        }
        let (mut frame, mut to, mut name) = (None, None, None);
        r.object("a marker (an object)", |r, key, at| {
            match key.as_str() {
                "frame" => frame = Some(r.integer("frame", 0, u32::MAX)?),
                "to" => to = Some(r.integer("to", 0, u32::MAX)?),
                "name" => name = Some(r.string("a string")?),
                _ => return unknown(r, at, &key, "a marker", &["frame", "to", "name"]),
            }
            Ok(())
        })?;
        let Some(frame) = frame else { return missing(r, at, "a marker", "frame") };
        let Some(name) = name else { return missing(r, at, "a marker", "name") };
        markers.push(Marker { frame, name, to });
        Ok(())
    })?;
    Ok(markers)
}
