//! Reads a key and its parts; see [`mod@super::parse`].

use std::collections::BTreeMap;

use super::document::{Fill, Goal, Key, Row};
use super::flaw::hint;
use super::json::{Kind, Read, Reader, show};
use super::reach::{Reach, ReachFields};
use super::tangent::Tangent;
use robert_base::limits;

/// Refuses an unknown key and suggests the nearest known name.
pub(super) fn unknown<T>(
    r: &Reader<'_>,
    at: usize,
    key: &str,
    place: &str,
    known: &[&str],
) -> Read<T> {
    let hint = hint(key, known.iter().copied());
    let known = known.join(", ");
    r.fault(at, format!("unknown key \"{}\" in {place}{hint} (known: {known})", show(key)))
}

pub(super) fn missing<T>(r: &Reader<'_>, at: usize, place: &str, key: &str) -> Read<T> {
    r.fault(at, format!("{place} needs `{key}`"))
}

/// How much more a file may hold.
pub(super) struct Budget {
    pub(super) values: usize,
    pub(super) tangents: usize,
    pub(super) reaches: usize,
}

pub(super) fn read_fill(r: &mut Reader<'_>) -> Read<Fill> {
    let at = r.here();
    let word = r.string("a fill")?;
    let Some(fill) = Fill::from_word(&word) else {
        let word = show(&word);
        return r.fault(at, format!("a fill must be mask, linear, cubic or hold, not \"{word}\""));
    };
    Ok(fill)
}

pub(super) fn read_row(r: &mut Reader<'_>, budget: &mut usize) -> Read<Row> {
    let mut row = Vec::new();
    r.array("an array of numbers and nulls", |r, i| {
        let at = r.here();
        if i >= limits::JOINTS {
            return r.fault(at, format!("more than {} values in a row", limits::JOINTS));
        }
        *budget = match budget.checked_sub(1) {
            Some(left) => left,
            None => return r.fault(at, format!("more than {} values", limits::CLIP_VALUES)),
        };
        row.push(if r.null()? { None } else { Some(r.number("a number or null")?) });
        Ok(())
    })?;
    // Half a million short rows in vectors that grow by doubling would waste the same amount again.
    row.shrink_to_fit();
    Ok(row)
}

pub(super) fn read_key(r: &mut Reader<'_>, budget: &mut Budget) -> Read<Key> {
    let at = r.here();
    let (mut frame, mut pose, mut q) = (None, None, None);
    let (mut hold, mut fill, mut note) = (1, None, String::new());
    let (mut reach, mut tangents) = (Vec::new(), BTreeMap::new());
    r.object("a key (an object)", |r, key, at| {
        match key.as_str() {
            "frame" => frame = Some(r.integer("frame", 0, u32::MAX)?),
            "pose" => pose = Some(r.string("a pose name")?),
            "q" => q = Some(read_row(r, &mut budget.values)?),
            "reach" => reach = read_reaches(r, &mut budget.reaches)?,
            "hold" => hold = r.integer("hold", 1, limits::CLIP_FRAMES)?,
            "fill" => fill = Some(read_fill(r)?),
            "tangents" => tangents = read_tangents(r, &mut budget.tangents)?,
            "note" => note = r.string("a string")?,
            _ => {
                let known = ["frame", "pose", "q", "reach", "hold", "fill", "tangents", "note"];
                return unknown(r, at, &key, "a key", &known);
            }
        }
        Ok(())
    })?;
    let Some(frame) = frame else { return missing(r, at, "a key", "frame") };
    let goal = match (pose, q) {
        (Some(pose), None) => Goal::Pose(pose),
        (None, Some(q)) => Goal::Q(q),
        (None, None) if !reach.is_empty() => Goal::Open,
        (None, None) => return r.fault(at, "a key needs `pose`, `q` or `reach`"),
        _ => return r.fault(at, "a key needs either `pose` or `q`, not both"),
    };
    Ok(Key { frame, goal, reach, hold, fill, tangents, note })
}

fn read_reaches(r: &mut Reader<'_>, budget: &mut usize) -> Read<Vec<Reach>> {
    let at = r.here();
    let mut reaches = Vec::new();
    r.array("an array of end-effector goals", |r, _| {
        let at = r.here();
        *budget = match budget.checked_sub(1) {
            Some(left) => left,
            None => {
                let cap = limits::CLIP_REACHES;
                return r.fault(at, format!("more than {cap} end-effector goals"));
            }
        };
        reaches.push(read_reach(r)?);
        Ok(())
    })?;
    if reaches.is_empty() {
        return r.fault(at, "an empty `reach` says nothing; leave it out");
    }
    Ok(reaches)
}

fn read_reach(r: &mut Reader<'_>) -> Read<Reach> {
    let at = r.here();
    let (mut fields, mut pos) = (ReachFields::default(), false);
    r.object("an end-effector goal (an object)", |r, key, at| {
        match key.as_str() {
            "site" => fields.site = Some(r.string("the name of a site")?),
            "body" => fields.body = Some(r.string("the name of a body")?),
            "offset" => fields.offset = Some(read_numbers(r)?),
            "pos" => {
                pos = true;
                fields.pos = read_numbers(r)?;
            }
            "quat" => fields.quat = Some(read_numbers(r)?),
            _ => {
                let known = ["site", "body", "offset", "pos", "quat"];
                return unknown(r, at, &key, "an end-effector goal", &known);
            }
        }
        Ok(())
    })?;
    if !pos {
        return missing(r, at, "an end-effector goal", "pos");
    }
    match Reach::try_from(fields) {
        Ok(reach) => Ok(reach),
        Err(message) => r.fault(at, message),
    }
}

/// An array of exactly `N` numbers.
fn read_numbers<const N: usize>(r: &mut Reader<'_>) -> Read<[f64; N]> {
    let at = r.here();
    let mut numbers = Vec::new();
    r.array(&format!("an array of {N} numbers"), |r, i| {
        let at = r.here();
        if i >= N {
            return r.fault(at, format!("more than {N} numbers"));
        }
        numbers.push(r.number("a number")?);
        Ok(())
    })?;
    match numbers.try_into() {
        Ok(numbers) => Ok(numbers),
        Err(few) => {
            let few: Vec<f64> = few;
            r.fault(at, format!("{} numbers; {N} are needed", few.len()))
        }
    }
}

fn read_tangents(r: &mut Reader<'_>, budget: &mut usize) -> Read<BTreeMap<String, Tangent>> {
    let mut tangents = BTreeMap::new();
    r.object("an object of slopes by joint", |r, joint, at| {
        *budget = match budget.checked_sub(1) {
            Some(left) => left,
            None => return r.fault(at, format!("more than {} tangents", limits::CLIP_TANGENTS)),
        };
        tangents.insert(joint, read_tangent(r)?);
        Ok(())
    })?;
    Ok(tangents)
}

fn read_tangent(r: &mut Reader<'_>) -> Read<Tangent> {
    const WHAT: &str = "\"flat\", \"linear\", a slope, or an object with the slopes `in` and `out`";
    let at = r.here();
    match r.kind() {
        Kind::String => match r.string(WHAT)?.as_str() {
            "flat" => Ok(Tangent::FLAT),
            "linear" => Ok(Tangent::LINEAR),
            word => r.fault(at, format!("a tangent must be {WHAT}, not \"{}\"", show(word))),
        },
        Kind::Object => {
            let (mut before, mut after) = (None, None);
            r.object(WHAT, |r, key, at| {
                match key.as_str() {
                    "in" => before = Some(r.number("a slope")?),
                    "out" => after = Some(r.number("a slope")?),
                    _ => return unknown(r, at, &key, "a tangent", &["in", "out"]),
                }
                Ok(())
            })?;
            match (before, after) {
                (Some(before), Some(after)) => Ok(Tangent::corner(before, after)),
                (None, _) => missing(r, at, "a tangent", "in"),
                (_, None) => missing(r, at, "a tangent", "out"),
            }
        }
        _ => Ok(Tangent::Slope(r.number(WHAT)?)),
    }
}
