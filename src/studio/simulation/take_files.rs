//! Pinned takes on disk: they outlive the studio until they are removed.
//!
//! There is one file per take in the state folder. It contains the clip, so that it depends on no
//! file that may have been deleted. The format is `robert-pinned-take/1\n`, `u32` CRC-32 of all
//! that follows (little endian), one map in MessagePack. Rejected: an MCAP take. It contains
//! torques and controls, which the studio's process never sees. A file that cannot be read is left
//! where it is and reported.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::takes::{Motion, Quality, Source, Take};
use crate::protocol::{Error, RolloutSettings};
use robert_base::{fsio, limits};
use robert_clip as clip;

const MAGIC: &[u8] = b"robert-pinned-take/1\n";
/// Ends the name of a file.
const SUFFIX: &str = ".take";

/// The content of a file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    id: u64,
    name: String,
    robot: String,
    clip: String,
    settings: RolloutSettings,
    policy: String,
    mae: Option<f64>,
    q: Vec<Vec<f32>>,        // (frames, S)
    error: Vec<Option<f64>>, // (frames)
    bodies: Vec<Vec<f32>>,   // (frames, nbody * 7)
}

/// The folder of pinned takes, and the files that are known to be written.
#[derive(Debug)]
pub(super) struct TakeFiles {
    dir: PathBuf,
    /// Files and names by number of the take.
    written: BTreeMap<u64, (PathBuf, String)>,
}

/// The takes found in the folder.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// The oldest first.
    pub(super) takes: Vec<Take>,
    /// Sentences about files that could not be read as takes.
    pub(super) skipped: Vec<String>,
}

impl TakeFiles {
    /// Reads what earlier studios have kept.
    pub(super) fn open(dir: PathBuf) -> (TakeFiles, Found) {
        let (mut found, mut bytes) = (Found::default(), 0);
        let mut written = BTreeMap::new();
        fsio::sweep(&dir);
        let entries = std::fs::read_dir(&dir).into_iter().flatten().flatten();
        let mut paths: Vec<PathBuf> = entries.map(|e| e.path()).filter(|p| is_take(p)).collect();
        // Names begin with the number of the take.
        paths.sort();
        for path in paths {
            if found.takes.len() + 1 >= limits::TAKES {
                found.skipped.push(format!("one take too many is kept: {}", path.display()));
                continue;
            }
            match read(&path) {
                Ok(take) if bytes + take.bytes() > limits::TAKES_PINNED_BYTES => {
                    found.skipped.push(format!(
                        "the pinned takes are too large together; this one is left out: {}",
                        path.display()
                    ));
                }
                Ok(mut take) => {
                    bytes += take.bytes();
                    if written.contains_key(&take.id) {
                        take.id = written.keys().last().map_or(1, |last| last + 1);
                    }
                    written.insert(take.id, (path, take.name.clone()));
                    found.takes.push(take);
                }
                Err(why) => found.skipped.push(format!(
                    "a pinned take cannot be read and is left out: {why}: {}",
                    path.display()
                )),
            }
        }
        (TakeFiles { dir, written }, found)
    }

    /// Writes the pinned takes to the folder under their current names, and removes all others.
    ///
    /// # Errors
    /// [`Error::File`]; what could be done is done.
    pub(super) fn keep(&mut self, pinned: &[Take]) -> Result<(), Error> {
        let mut problem = None;
        for take in pinned {
            if self.written.get(&take.id).is_some_and(|(_, name)| *name == take.name) {
                continue;
            }
            match write(&self.dir, take) {
                Ok(path) => {
                    let known = self.written.insert(take.id, (path.clone(), take.name.clone()));
                    if let Some((old, _)) = known.filter(|(old, _)| *old != path) {
                        std::fs::remove_file(old).ok();
                    }
                }
                Err(e) => problem = Some(e),
            }
        }
        let gone = |id: &u64| !pinned.iter().any(|t| t.id == *id);
        for id in self.written.keys().copied().filter(gone).collect::<Vec<_>>() {
            let Some((path, _)) = self.written.remove(&id) else { continue };
            match std::fs::remove_file(&path) {
                // Another studio on the same folder may have removed it.
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                    problem = Some(fsio::Error::Write { source: e, path });
                }
                _ => {}
            }
        }
        problem.map_or(Ok(()), |e| Err(e.into()))
    }
}

fn is_take(path: &Path) -> bool {
    path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.ends_with(SUFFIX))
}

fn write(dir: &Path, take: &Take) -> Result<PathBuf, fsio::Error> {
    let kept = Kept {
        id: take.id,
        name: take.name.clone(),
        robot: take.source.robot.clone(),
        clip: take.source.clip.to_text(),
        settings: take.source.settings.clone(),
        policy: take.policy.clone(),
        mae: take.mae,
        q: take.motion.q.clone(),
        error: take.motion.error.clone(),
        bodies: take.motion.bodies.iter().map(|row| row.to_vec()).collect(),
    };
    let failed = |source: std::io::Error| fsio::Error::Write { source, path: dir.to_owned() };
    let body = rmp_serde::to_vec_named(&kept).map_err(|e| failed(std::io::Error::other(e)))?;
    std::fs::create_dir_all(dir).map_err(failed)?;
    let mut bytes = MAGIC.to_vec();
    bytes.extend(crc32fast::hash(&body).to_le_bytes());
    bytes.extend(body);
    // Studios that share the folder count independently: the content distinguishes their takes.
    let hash = fsio::sha256_hex(&bytes);
    let short = hash.get(..12).unwrap_or(&hash);
    let path = dir.join(format!("{:06}-{short}{SUFFIX}", take.id));
    fsio::write_atomic(&path, &bytes)?;
    Ok(path)
}

fn read(path: &Path) -> Result<Take, String> {
    let bytes = fsio::read_capped(path, 2 * limits::TAKES_PINNED_BYTES as u64)
        .map_err(|e| e.to_string())?;
    let rest = bytes.strip_prefix(MAGIC).ok_or("it is no pinned take")?;
    let (sum, body) = rest.split_first_chunk::<4>().ok_or("it is cut off")?;
    if crc32fast::hash(body) != u32::from_le_bytes(*sum) {
        return Err("its checksum is another one".into());
    }
    let kept: Kept = rmp_serde::from_slice(body).map_err(|e| e.to_string())?;
    let clip = clip::Clip::parse(&kept.clip).map_err(|e| e.to_string())?;
    let command = clip::compile(&clip).map_err(|e| e.to_string())?;
    let (frames, width) = (kept.q.len(), kept.bodies.first().map_or(0, Vec::len));
    let whole = frames == command.frames() as usize
        && kept.error.len() == frames
        && kept.bodies.len() == frames
        && kept.q.iter().all(|row| row.len() == command.dim())
        && width > 0
        && width.is_multiple_of(7)
        && kept.bodies.iter().all(|row| row.len() == width);
    if !whole {
        return Err("its motion does not fit its clip".into());
    }
    let quality = Quality::of(&command, &kept.q);
    Ok(Take {
        id: kept.id,
        name: kept.name,
        source: Source { robot: kept.robot, clip: Arc::new(clip), settings: kept.settings },
        command: Arc::new(command),
        policy: kept.policy,
        // The document of this take is no longer open, so its version says nothing about the open
        // one.
        rev: 0,
        mae: kept.mae,
        motion: Arc::new(Motion {
            q: kept.q,
            error: kept.error,
            bodies: kept.bodies.into_iter().map(Into::into).collect(),
        }),
        pinned: true,
        quality,
    })
}

#[cfg(test)]
mod tests {
    use super::super::takes::{Takes, tests::take};
    use super::*;

    #[test]
    fn what_is_pinned_comes_back_bit_for_bit_and_goes_when_it_is_removed() {
        let dir = tempfile::tempdir().unwrap();
        let (mut files, found) = TakeFiles::open(dir.path().join("takes"));
        assert!(found.takes.is_empty() && found.skipped.is_empty());
        let mut takes = Takes::default();
        let [one, two] = [0.1, 0.2].map(|v| takes.keep(take(v, 14)));
        takes.name(one, "good").unwrap();
        takes.pin(two, true).unwrap();
        files.keep(&takes.pinned()).unwrap();
        let (mut files, found) = TakeFiles::open(dir.path().join("takes"));
        assert!(found.skipped.is_empty(), "{:?}", found.skipped);
        let back = &found.takes[0];
        let known = takes.get(one).unwrap();
        assert_eq!((back.id, back.name.as_str(), back.pinned), (one, "good", true));
        assert_eq!(back.motion.q, known.motion.q);
        assert_eq!(back.motion.bodies, known.motion.bodies);
        assert_eq!(back.command, known.command);
        assert_eq!(back.mae, known.mae);
        let mut next = Takes::of(found.takes);
        assert_eq!(next.keep(take(0.3, 14)), two + 1, "numbers go on");
        next.name(one, "better").unwrap();
        next.remove(two).unwrap();
        files.keep(&next.pinned()).unwrap();
        let (_, found) = TakeFiles::open(dir.path().join("takes"));
        let names: Vec<&str> = found.takes.iter().map(|t| t.name.as_str()).collect();
        assert_eq!(names, ["better"]);
    }

    #[test]
    fn a_damaged_file_is_named_and_left_where_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let (mut files, _) = TakeFiles::open(dir.path().to_owned());
        let mut takes = Takes::default();
        for v in [0.1, 0.2, 0.3] {
            let id = takes.keep(take(v, 7));
            takes.pin(id, true).unwrap();
        }
        files.keep(&takes.pinned()).unwrap();
        let mut paths: Vec<_> =
            std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().path()).collect();
        paths.sort();
        let mut flipped = std::fs::read(&paths[0]).unwrap();
        let middle = flipped.len() / 2;
        flipped[middle] ^= 4;
        std::fs::write(&paths[0], flipped).unwrap();
        std::fs::write(&paths[2], b"robert").unwrap();
        let (_, found) = TakeFiles::open(dir.path().to_owned());
        assert_eq!(found.takes.len(), 1);
        assert_eq!(found.skipped.len(), 2);
        assert!(found.skipped[0].contains("checksum"), "{}", found.skipped[0]);
        assert!(paths.iter().all(|p| p.exists()));
    }
}
