//! Mesh and picture files of foreign models. Sizes are checked from the headers before the files
//! are read, and ASCII STL is converted into binary STL for the simulator.

use std::fmt::Write as _;
use std::io::Read;
use std::path::Path;

use robert_base::fsio;
use robert_base::limits;
use robert_base::rng::{Rng, Stream};

/// Bytes of a binary STL before its first triangle.
const STL_HEAD: u64 = 84;
/// Bytes of a triangle in a binary STL.
const STL_FACE: u64 = 50;

/// How the small text begins that Git LFS leaves in place of a file.
const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// Checks a file that a model refers to, and returns its size in bytes.
///
/// # Errors
/// What is wrong with it, as a sentence.
pub(super) fn check_file(path: &Path) -> Result<u64, String> {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let bytes = path.metadata().map_err(|e| format!("\"{name}\": {e}"))?.len();
    if bytes == 0 {
        return Err(format!("\"{name}\" is empty"));
    }
    if bytes > limits::MESH_BYTES {
        return Err(format!(
            "\"{name}\" has {bytes} bytes; at most {} are read",
            limits::MESH_BYTES
        ));
    }
    let mut head = [0_u8; 84];
    let read = fsio::open_regular(path).and_then(|f| f.take(84).read(&mut head));
    let read = read.map_err(|e| format!("\"{name}\": {e}"))?;
    let head = head.get(..read).unwrap_or_default();
    if head.starts_with(LFS_POINTER) {
        return Err(format!(
            "\"{name}\" is a pointer of Git LFS and not the file itself: run `git lfs pull` in its repository"
        ));
    }
    match extension(path).as_str() {
        "stl" => check_stl(&name, head, bytes),
        "png" => check_png(&name, head),
        _ => Ok(()),
    }?;
    Ok(bytes)
}

/// Extension in lower case.
pub(super) fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

fn check_stl(name: &str, head: &[u8], bytes: u64) -> Result<(), String> {
    if is_ascii_stl(head) && stl_faces(head).is_none_or(|n| STL_HEAD + STL_FACE * n != bytes) {
        return Ok(());
    }
    let Some(faces) = stl_faces(head) else {
        return Err(format!("\"{name}\" is too short for an STL file"));
    };
    if faces > limits::MESH_FACES as u64 {
        return Err(format!(
            "\"{name}\" claims {faces} faces; at most {} are supported",
            limits::MESH_FACES
        ));
    }
    if STL_HEAD + STL_FACE * faces > bytes {
        return Err(format!("\"{name}\" claims {faces} faces but has only {bytes} bytes"));
    }
    Ok(())
}

fn stl_faces(head: &[u8]) -> Option<u64> {
    let count: [u8; 4] = head.get(80..84)?.try_into().ok()?;
    Some(u64::from(u32::from_le_bytes(count)))
}

fn is_ascii_stl(head: &[u8]) -> bool {
    head.starts_with(b"solid")
}

/// Width and height of a PNG file, pixels, from its header; `None` if it is not a PNG file.
pub(super) fn png_size(path: &Path) -> Option<(u64, u64)> {
    let mut head = [0_u8; 24];
    fsio::open_regular(path).and_then(|mut f| f.read_exact(&mut head)).ok()?;
    png_edges(&head)
}

fn png_edges(head: &[u8]) -> Option<(u64, u64)> {
    let edge = |at: usize| -> Option<u64> {
        let b: [u8; 4] = head.get(at..at + 4)?.try_into().ok()?;
        Some(u64::from(u32::from_be_bytes(b)))
    };
    Some((edge(16)?, edge(20)?))
}

fn check_png(name: &str, head: &[u8]) -> Result<(), String> {
    let Some((w, h)) = png_edges(head) else {
        return Err(format!("\"{name}\" is too short for a PNG file"));
    };
    if !head.starts_with(b"\x89PNG\r\n\x1a\n") {
        return Err(format!("\"{name}\" is not a PNG file"));
    }
    if w == 0 || h == 0 || w > limits::TEXTURE_PX || h > limits::TEXTURE_PX {
        return Err(format!(
            "\"{name}\" has {w} x {h} pixels; an edge may have at most {}",
            limits::TEXTURE_PX
        ));
    }
    Ok(())
}

/// The mesh for the simulator: ASCII STL becomes binary, other formats stay.
///
/// # Errors
/// What is wrong with it, as a sentence.
pub(super) fn normalised(name: &str, bytes: Vec<u8>) -> Result<Vec<u8>, String> {
    let is_stl = extension(Path::new(name)) == "stl";
    let binary = stl_faces(&bytes).is_some_and(|n| STL_HEAD + STL_FACE * n <= bytes.len() as u64);
    if !is_stl || !is_ascii_stl(&bytes) || binary {
        return Ok(bytes);
    }
    let text = String::from_utf8_lossy(&bytes);
    let mut numbers: Vec<f32> = Vec::new();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        if words.next() != Some("vertex") {
            continue;
        }
        let before = numbers.len();
        numbers.extend(words.filter_map(|w| w.parse::<f32>().ok()).filter(|v| v.is_finite()));
        if numbers.len() != before + 3 {
            return Err(format!("\"{name}\" contains a vertex that is not three numbers: {line}"));
        }
    }
    let faces = numbers.len() / 9;
    if faces == 0 || !numbers.len().is_multiple_of(9) || faces > limits::MESH_FACES {
        return Err(format!("\"{name}\" has {} vertices, not three per face", numbers.len() / 3));
    }
    let mut out = vec![0_u8; 80];
    out.extend((faces as u32).to_le_bytes());
    for face in numbers.chunks_exact(9) {
        out.extend([0_u8; 12]);
        for v in face {
            out.extend(v.to_le_bytes());
        }
        out.extend([0_u8; 2]);
    }
    Ok(out)
}

/// An OBJ in which all faces belong to one group; other files as they are. The simulator reads only the
/// first group.
pub(super) fn in_one_group(name: &str, bytes: Vec<u8>) -> Vec<u8> {
    let begins_group = |line: &[u8]| {
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        matches!(words.next(), Some(b"g" | b"o"))
    };
    if extension(Path::new(name)) != "obj" {
        return bytes;
    }
    let lines = bytes.split_inclusive(|b| *b == b'\n');
    let mut out = Vec::with_capacity(bytes.len());
    lines.filter(|line| !begins_group(line)).for_each(|line| out.extend_from_slice(line));
    out
}

/// An OBJ with the same faces, each with its own corners. The simulator refuses an OBJ in which two
/// neighbouring faces run along their common edge in the same direction; afterwards no face has a
/// neighbour. Textures and normals stay with the corners. `None` for other files and damaged ones.
pub(super) fn separate_faces(name: &str, bytes: &[u8]) -> Option<Vec<u8>> {
    let text = std::str::from_utf8(bytes).ok()?;
    if extension(Path::new(name)) != "obj" {
        return None;
    }
    let (mut corners, mut written, mut out) = (Vec::new(), 0_usize, String::new());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => corners.push(line),
            Some("f") => {
                let mut face = "f".to_owned();
                for word in words {
                    let (index, rest) = word.split_at(word.find('/').unwrap_or(word.len()));
                    // Below zero an index counts from the last corner so far.
                    let at = match index.parse::<i64>().ok()? {
                        i if i < 0 => corners.len().checked_add_signed(i as isize)?,
                        i => usize::try_from(i).ok()?.checked_sub(1)?,
                    };
                    writeln!(out, "{}", corners.get(at)?).ok()?;
                    written += 1;
                    write!(face, " {written}{rest}").ok()?;
                }
                writeln!(out, "{face}").ok()?;
            }
            _ => writeln!(out, "{line}").ok()?,
        }
        if out.len() as u64 > limits::MESH_BYTES {
            return None;
        }
    }
    Some(out.into_bytes())
}

/// A mesh whose points are moved by up to a millionth of its size, each always in the same way, so
/// that faces that shared a corner still do. `None` for other files than OBJ and binary STL, and for
/// damaged ones.
pub(super) fn nudged(name: &str, bytes: &[u8]) -> Option<Vec<u8>> {
    match extension(Path::new(name)).as_str() {
        "obj" => nudged_obj(std::str::from_utf8(bytes).ok()?),
        "stl" => nudged_stl(bytes),
        _ => None,
    }
}

fn nudged_obj(text: &str) -> Option<Vec<u8>> {
    let corner = |line: &str| -> Option<[f32; 3]> {
        let mut words = line.strip_prefix("v ")?.split_whitespace();
        let mut next = || words.next()?.parse::<f32>().ok().filter(|x| x.is_finite());
        Some([next()?, next()?, next()?])
    };
    let step = step(text.lines().filter_map(corner));
    let mut out = String::new();
    for line in text.lines() {
        match corner(line) {
            Some(at) => {
                let [x, y, z] = moved(at, step);
                writeln!(out, "v {x:.9} {y:.9} {z:.9}").ok()?;
            }
            None => writeln!(out, "{line}").ok()?,
        }
    }
    Some(out.into_bytes())
}

fn nudged_stl(bytes: &[u8]) -> Option<Vec<u8>> {
    let faces = usize::try_from(stl_faces(bytes)?).ok()?;
    let corners = |face: usize| {
        (0..3).map(move |k| STL_HEAD as usize + face * STL_FACE as usize + 12 * (k + 1))
    };
    let corner = |at: usize| -> Option<[f32; 3]> {
        let number = |i: usize| {
            let four = bytes.get(at + 4 * i..at + 4 * i + 4)?.try_into().ok()?;
            Some(f32::from_le_bytes(four)).filter(|x| x.is_finite())
        };
        Some([number(0)?, number(1)?, number(2)?])
    };
    let all: Option<Vec<[f32; 3]>> = (0..faces).flat_map(corners).map(corner).collect();
    let step = step(all?.into_iter());
    let mut out = bytes.to_vec();
    for at in (0..faces).flat_map(corners) {
        for (i, x) in moved(corner(at)?, step).into_iter().enumerate() {
            out[at + 4 * i..at + 4 * i + 4].copy_from_slice(&x.to_le_bytes());
        }
    }
    Some(out)
}

/// A millionth of the size of a set of points.
fn step(points: impl Iterator<Item = [f32; 3]>) -> f32 {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for p in points {
        for i in 0..3 {
            (low[i], high[i]) = (low[i].min(p[i]), high[i].max(p[i]));
        }
    }
    let sides = (0..3).map(|i| high[i] - low[i]);
    1e-6 * sides.fold(0.0, f32::max)
}

/// A point that is moved by up to `step` along each axis, as its own place decides.
fn moved(at: [f32; 3], step: f32) -> [f32; 3] {
    let [x, y, z] = at.map(|x| u64::from(x.to_bits()));
    let mut rng = Rng::new(x << 32 | y, Stream::Mesh, z);
    at.map(|x| x + step * rng.range(-1.0, 1.0) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRA: &str = "solid t\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid t\n";

    #[test]
    fn ascii_stl_becomes_binary() {
        let out = normalised("t.STL", TETRA.into()).unwrap();
        assert_eq!(out.len(), 84 + 50);
        assert_eq!(stl_faces(&out), Some(1));
        assert_eq!(normalised("t.stl", out.clone()).unwrap(), out, "binary stays");
        assert!(normalised("t.stl", b"solid x\nvertex 1 2\n".to_vec()).is_err());
        assert_eq!(normalised("t.obj", b"v 1".to_vec()).unwrap(), b"v 1");
    }

    #[test]
    fn an_obj_becomes_one_group() {
        let text = b"o a\nv 0 0 0\r\n g left\nf 1 2 3\ng\r\nusemtl g\ng right\nf 3 2 1";
        let one = in_one_group("m.obj", text.to_vec());
        assert_eq!(one, b"v 0 0 0\r\nf 1 2 3\nusemtl g\nf 3 2 1");
        assert_eq!(in_one_group("m.stl", text.to_vec()), text);
    }

    #[test]
    fn nudged_points_stay_together_and_near() {
        let text = "v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 0 .5 .5 .5\nf 1 2 3\n";
        let obj = String::from_utf8(nudged("a.OBJ", text.as_bytes()).unwrap()).unwrap();
        let lines: Vec<&str> = obj.lines().collect();
        assert_eq!((lines[0], lines[4]), (lines[3], "f 1 2 3"));
        let stl = normalised("a.stl", TETRA.as_bytes().to_vec()).unwrap();
        let new = nudged("a.stl", &stl).unwrap();
        let numbers = |bytes: &[u8]| -> Vec<f32> {
            let face = &bytes[STL_HEAD as usize + 12..STL_HEAD as usize + 48];
            face.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
        };
        assert_eq!(new.len(), stl.len());
        for (old, new) in numbers(&stl).iter().zip(numbers(&new)) {
            assert!(*old != new && (old - new).abs() <= 1.1e-6, "{old} {new}");
        }
        assert!(nudged("a.msh", &stl).is_none() && nudged("a.stl", &stl[..90]).is_none());
    }

    #[test]
    fn separate_faces_share_no_corner() {
        let text = "v 0 0 0\nv 1 0 0\nvt 0 1\nv 0 1 0\nf 1/1 2/1 3/1\nf -1/-1 2/1 1/1\n";
        let out = String::from_utf8(separate_faces("a.obj", text.as_bytes()).unwrap()).unwrap();
        assert_eq!(out.matches("v ").count(), 6);
        assert!(out.contains("f 1/1 2/1 3/1\n") && out.contains("f 4/-1 5/1 6/1\n"), "{out}");
        assert!(out.contains("v 0 1 0\nv 1 0 0\nv 0 0 0\nf 4"), "{out}");
        for bad in ["v 0 0 0\nf 1 2 3\n", "f 0 0 0\n", "v 0 0 0\nf -2 1 1\n", "f x\n"] {
            assert_eq!(separate_faces("a.obj", bad.as_bytes()), None, "{bad}");
        }
        assert_eq!(separate_faces("a.stl", b""), None);
    }

    #[test]
    fn meshes_have_a_limit_of_bytes_and_of_faces() {
        let dir = tempfile::tempdir().unwrap();
        let sized = |name: &str, head: &[u8], bytes: u64| {
            let path = dir.path().join(name);
            std::fs::write(&path, head).unwrap();
            // Sparse: it takes no room.
            std::fs::File::options().write(true).open(&path).unwrap().set_len(bytes).unwrap();
            check_file(&path)
        };
        let most = limits::MESH_BYTES;
        assert_eq!(sized("a.msh", b"x", most), Ok(most));
        assert!(sized("a.msh", b"x", most + 1).unwrap_err().contains("at most 268435456"));
        let faces = |n: usize| {
            let head = [&[b'x'; 80][..], &(n as u32).to_le_bytes()].concat();
            sized("b.stl", &head, STL_HEAD + STL_FACE * n as u64)
        };
        assert!(faces(limits::MESH_FACES).is_ok());
        assert!(faces(limits::MESH_FACES + 1).unwrap_err().contains("claims 2000001 faces"));
    }

    #[test]
    fn headers_that_lie_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let file = |name: &str, bytes: &[u8]| {
            let p = dir.path().join(name);
            std::fs::write(&p, bytes).unwrap();
            check_file(&p)
        };
        let mut stl = vec![0_u8; 84];
        stl[80..84].copy_from_slice(&(1_u32 << 31).to_le_bytes());
        assert!(file("a.stl", &stl).unwrap_err().contains("faces"));
        stl[80..84].copy_from_slice(&7_u32.to_le_bytes());
        assert!(file("b.stl", &stl).unwrap_err().contains("only"));
        assert!(file("c.stl", b"short").is_err());
        assert!(file("d.stl", TETRA.as_bytes()).is_ok());
        let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR".to_vec();
        png.extend(30_000_u32.to_be_bytes());
        png.extend(30_000_u32.to_be_bytes());
        assert!(file("e.png", &png).unwrap_err().contains("30000 x 30000"));
        assert!(file("f.obj", b"").unwrap_err().contains("empty"));
    }
}
