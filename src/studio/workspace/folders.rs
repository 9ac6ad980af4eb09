//! Folders of clips, for the Open dialog.
//!
//! The dialog shows the studio's folder, or another one that the user has typed, and what lies
//! below it. Links are followed only as far as they stay inside. Hidden and odd names are counted,
//! not shown. Only folders and files that could be clips are listed, and of those at most
//! [`limits::FOLDER_ENTRIES`].

use std::fs;
use std::path::{Component, Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::Deserialize;

use crate::protocol::{Error, FileCard, FileKind, Listing, Peek};
use robert_base::fsio;
use robert_base::limits;

impl FileKind {
    /// By the name, as `robert clip convert` does it.
    pub(crate) fn of(name: &str) -> Option<FileKind> {
        let name = name.to_lowercase();
        let ends = |end: &str| name.len() > end.len() && name.ends_with(end);
        match () {
            () if ends(".clip.json") || ends(".json") => Some(FileKind::Clip),
            () if ends(".lafan.csv") => Some(FileKind::Lafan),
            () if ends(".csv") => Some(FileKind::Csv),
            () if ends(".mcap") => Some(FileKind::Take),
            () if ends(".xml") || ends(".mjcf") => Some(FileKind::Mjcf),
            () if ends(".yaml") || ends(".yml") => Some(FileKind::Ros),
            () => None,
        }
    }
}

/// The entries of a folder.
///
/// # Errors
/// [`Error::NotFound`] when it is no folder, [`Error::Request`] when it would leave `root`.
pub(crate) fn list(root: &Path, dir: &str) -> Result<Listing, Error> {
    let root = root
        .canonicalize()
        .ok()
        .filter(|r| r.is_dir())
        .ok_or_else(|| Error::NotFound { what: format!("folder {}", root.display()) })?;
    let at = inside(&root, dir)?;
    let entries =
        fs::read_dir(&at).map_err(|source| fsio::Error::Read { source, path: at.clone() })?;
    let mut listing = Listing {
        root: root.display().to_string(),
        dir: at.strip_prefix(&root).unwrap_or(&at).display().to_string(),
        folders: Vec::new(),
        files: Vec::new(),
        left_out: 0,
        more: false,
    };
    for (n, entry) in entries.enumerate() {
        if n >= limits::FOLDER_LOOKED_AT {
            listing.more = true;
            break;
        }
        let Ok(entry) = entry else { continue };
        let seen = entry.file_name().to_str().filter(|n| plain(n)).map(str::to_owned);
        // A link counts as its target, if that is inside.
        let found = seen.and_then(|name| {
            let path = entry.path().canonicalize().ok().filter(|p| p.starts_with(&root))?;
            Some((name, path.metadata().ok()?))
        });
        match found {
            Some((name, about)) if about.is_dir() => listing.folders.push(name),
            Some((name, about)) if about.is_file() => match FileKind::of(&name) {
                Some(kind) => listing.files.push(card(name, kind, &about)),
                None => listing.left_out += 1,
            },
            _ => listing.left_out += 1,
        }
    }
    listing.folders.sort_by_key(|n| n.to_lowercase());
    listing.files.sort_by_key(|f| f.name.to_lowercase());
    let cap = limits::FOLDER_ENTRIES;
    listing.more |= listing.folders.len() > cap || listing.files.len() > cap;
    listing.folders.truncate(cap);
    listing.files.truncate(cap);
    peek(&at, &mut listing.files);
    Ok(listing)
}

/// The folder `dir` below `root`, links resolved, if it exists.
fn inside(root: &Path, dir: &str) -> Result<PathBuf, Error> {
    let named = Path::new(dir);
    let down = named.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    if !down || dir.contains('\0') {
        return Err(Error::request(format!("{dir:?} is no folder below the one that was named")));
    }
    let missing = || Error::NotFound { what: format!("folder {dir:?}") };
    let at = root.join(named).canonicalize().map_err(|_gone| missing())?;
    if !at.starts_with(root) {
        return Err(Error::request(format!("{dir:?} leads out of {}", root.display())));
    }
    if at.is_dir() { Ok(at) } else { Err(missing()) }
}

/// A name that a page can show as it is: no dot files, no control characters, no characters that
/// change the writing direction.
fn plain(name: &str) -> bool {
    let turns = |c| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{200e}' | '\u{200f}');
    !name.starts_with('.') && !name.chars().any(|c| c.is_control() || turns(c))
}

fn card(name: String, kind: FileKind, about: &fs::Metadata) -> FileCard {
    let changed = about.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
    let bytes = about.len();
    let why = (bytes > limits::CLIP_BYTES)
        .then(|| format!("larger than the {} MB that are read", limits::CLIP_BYTES >> 20));
    FileCard {
        name,
        kind,
        bytes,
        changed_secs: changed.map_or(0, |d| d.as_secs()),
        clip: None,
        why,
    }
}

/// Reads the summaries of clips until the limit of bytes is reached.
fn peek(dir: &Path, files: &mut [FileCard]) {
    let mut left = limits::FOLDER_PEEK_BYTES;
    for file in files.iter_mut().filter(|f| f.kind == FileKind::Clip && f.why.is_none()) {
        if file.bytes > left {
            continue;
        }
        left -= file.bytes;
        let Ok(bytes) = fsio::read_capped(&dir.join(&file.name), file.bytes) else { continue };
        file.clip = heading(&bytes);
        if file.clip.is_none() {
            file.why = Some("no clip".to_owned());
        }
    }
}

fn heading(bytes: &[u8]) -> Option<Peek> {
    #[derive(Deserialize)]
    struct Robot {
        id: String,
    }
    #[derive(Deserialize)]
    struct Heading {
        format: String,
        #[serde(default)]
        name: String,
        robot: Robot,
        length: u32,
        keys: Vec<serde::de::IgnoredAny>,
    }
    let h: Heading = serde_json::from_slice(bytes).ok()?;
    let clip = h.format.starts_with("robert-clip/");
    clip.then_some(Peek { name: h.name, robot: h.robot.id, length: h.length, keys: h.keys.len() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    const CLIP: &str = r#"{"format": "robert-clip/1", "name": "wave", "robot": {"id": "r", "joints": ["a"]},
        "fps": 20, "length": 9, "keys": [{"frame": 0, "q": [0]}]}"#;

    #[test]
    fn lists_what_could_be_opened_and_nothing_outside() {
        let dir = tempfile::tempdir().unwrap();
        let (root, outside) = (dir.path().join("mine"), dir.path().join("outside"));
        fs::create_dir_all(root.join("sub/deep")).unwrap();
        fs::create_dir_all(&outside).unwrap();
        fs::write(outside.join("secret.clip.json"), CLIP).unwrap();
        fs::write(root.join("a.clip.json"), CLIP).unwrap();
        fs::write(root.join("bad.clip.json"), "{").unwrap();
        fs::write(root.join("log.csv"), "frame,a\n0,1\n").unwrap();
        for odd in [".hidden.csv", "notes.txt", "a\nb.csv", "\u{202e}gpj.csv", ".csv"] {
            fs::write(root.join(odd), "x").unwrap();
        }
        symlink(&outside, root.join("leak")).unwrap();
        symlink(outside.join("secret.clip.json"), root.join("leak.clip.json")).unwrap();
        symlink("/dev/zero", root.join("zero.csv")).unwrap();
        symlink(root.join("sub"), root.join("near")).unwrap();
        let large = fs::File::create(root.join("large.clip.json")).unwrap();
        large.set_len(limits::CLIP_BYTES + 1).unwrap();
        let seen = list(&root, "").unwrap();
        assert_eq!(seen.folders, ["near", "sub"]);
        let names: Vec<&str> = seen.files.iter().map(|f| f.name.as_str()).collect();
        assert_eq!(names, ["a.clip.json", "bad.clip.json", "large.clip.json", "log.csv"]);
        let peek = seen.files[0].clip.as_ref().unwrap();
        assert_eq!((peek.name.as_str(), peek.robot.as_str(), peek.length), ("wave", "r", 9));
        assert!(seen.files[1].why.is_some() && seen.files[2].why.is_some());
        assert_eq!(seen.files[3].why, None);
        assert_eq!((seen.left_out, seen.more), (8, false), "{seen:?}");
        assert_eq!(list(&root, "sub").unwrap().folders, ["deep"]);
        assert_eq!(list(&root, "near/deep").unwrap().dir, "sub/deep");
        for bad in
            ["..", "sub/../..", "/etc", "leak", "a.clip.json", "none", "a\0", "sub/../../mine"]
        {
            assert!(list(&root, bad).is_err(), "{bad:?}");
        }
        assert!(list(&root.join("none"), "").is_err());
    }

    #[test]
    fn long_folders_are_cut() {
        let dir = tempfile::tempdir().unwrap();
        for n in 0..=limits::FOLDER_ENTRIES {
            fs::write(dir.path().join(format!("{n}.csv")), "").unwrap();
        }
        let seen = list(dir.path(), "").unwrap();
        assert!(seen.more && seen.files.len() == limits::FOLDER_ENTRIES);
        fs::remove_file(dir.path().join("0.csv")).unwrap();
        let seen = list(dir.path(), "").unwrap();
        assert!(!seen.more && seen.files.len() == limits::FOLDER_ENTRIES);
    }

    #[test]
    fn as_many_entries_are_looked_at_as_the_limit_says() {
        let dir = tempfile::tempdir().unwrap();
        for n in 0..limits::FOLDER_LOOKED_AT {
            fs::File::create(dir.path().join(format!("{n}.txt"))).unwrap();
        }
        let seen = list(dir.path(), "").unwrap();
        assert_eq!((seen.left_out, seen.more), (limits::FOLDER_LOOKED_AT, false));
        fs::File::create(dir.path().join("one more.txt")).unwrap();
        let seen = list(dir.path(), "").unwrap();
        assert_eq!((seen.left_out, seen.more), (limits::FOLDER_LOOKED_AT, true));
    }

    #[test]
    fn summaries_are_read_up_to_the_limit_of_bytes() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: u64| {
            let rest = bytes as usize - CLIP.len();
            fs::write(dir.path().join(name), [CLIP, &" ".repeat(rest)].concat()).unwrap();
        };
        write("a.clip.json", limits::FOLDER_PEEK_BYTES - 1000);
        write("b.clip.json", 1000);
        let peeked = || {
            let files = list(dir.path(), "").unwrap().files;
            files.iter().map(|f| f.clip.is_some()).collect::<Vec<bool>>()
        };
        assert_eq!(peeked(), [true, true]);
        write("b.clip.json", 1001);
        assert_eq!(peeked(), [true, false]);
    }
}
