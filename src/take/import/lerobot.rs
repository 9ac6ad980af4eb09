//! Episodes of LeRobot datasets, versions 2.1 and 3.0.

use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use parquet::basic::Type;
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::metadata::RowGroupMetaData;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::schema::types::{ColumnDescPtr, SchemaDescriptor};
use serde::Deserialize;

use super::super::error::Error;
use super::pages::{self, Pages};
use super::samples::{Samples, foreign, rate};
use robert_base::fsio;
use robert_base::limits;

/// Rows that are decoded at once.
const ROWS_AT_ONCE: usize = 1024;

/// The part of a dataset that is read.
#[derive(Clone, Debug, PartialEq)]
pub struct LeRobotSource {
    /// The episode.
    pub episode: i64,
    /// The column: `observation.state`, or `action`.
    pub column: String,
    /// Its angles are degrees.
    pub degrees: bool,
}

#[derive(Deserialize)]
struct Info {
    codebase_version: String,
    fps: f64,
    features: std::collections::BTreeMap<String, Feature>,
}

#[derive(Deserialize)]
struct Feature {
    shape: Vec<usize>,
    names: Option<serde_json::Value>,
}

/// Reads one episode of the dataset in a folder. Joints are named by the feature's names,
/// without the ending `.pos`.
///
/// # Errors
/// [`Error::Foreign`] with the file, [`Error::File`].
pub fn from_lerobot(dir: &Path, source: &LeRobotSource) -> Result<Samples, Error> {
    let path = dir.join("meta/info.json");
    let of = |problem: String| Error::Foreign { problem, path: Some(path.clone()) };
    let text = fsio::read_capped(&path, limits::CLIP_BYTES)?;
    let info: Info = serde_json::from_slice(&text).map_err(|e| of(e.to_string()))?;
    if !["v2.1", "v3.0"].contains(&info.codebase_version.as_str()) {
        return Err(of(format!("version {}; v2.1 and v3.0 are read", info.codebase_version)));
    }
    let feature = info.features.get(&source.column).ok_or_else(|| {
        let known: Vec<&str> = info.features.keys().map(String::as_str).collect();
        of(format!("no feature {}; there are {}", source.column, known.join(", ")))
    })?;
    let width = feature.shape.first().copied().unwrap_or(0);
    if feature.shape.len() != 1 || width == 0 || width > limits::JOINTS {
        return Err(of(format!("{} has the shape {:?}", source.column, feature.shape)));
    }
    let joints = names(feature.names.as_ref(), width).map_err(of)?;
    let fps = rate(info.fps).map_err(|e| e.in_file(&path))?;
    let mut frames: Vec<(i64, Vec<f64>)> = Vec::new();
    for file in files(dir, &info, source.episode)? {
        episode(&file, source, width, &mut frames).map_err(|e| e.in_file(&file))?;
    }
    if frames.is_empty() {
        return Err(of(format!("there is no episode {}", source.episode)));
    }
    frames.sort_by_key(|f| f.0);
    if let Some(gap) = frames.iter().zip(0_i64..).find(|(f, i)| f.0 != *i) {
        return Err(of(format!("episode {}: frame {} is missing", source.episode, gap.1)));
    }
    let rows = frames.into_iter().map(|(_, row)| row).collect();
    Ok(Samples { degrees: source.degrees, ..Samples::steady(joints, fps, rows) })
}

/// Names of the numbers: a list, or a list inside a mapping (`{"motors": [..]}`).
fn names(value: Option<&serde_json::Value>, width: usize) -> Result<Vec<String>, String> {
    let list = match value {
        Some(serde_json::Value::Object(map)) if map.len() == 1 => map.values().next(),
        other => other,
    };
    let list: Option<Vec<String>> = list.and_then(|v| serde_json::from_value(v.clone()).ok());
    let list = list.filter(|l| l.len() == width).ok_or("the feature does not name its numbers")?;
    let plain = |n: &String| n.strip_suffix(".pos").unwrap_or(n).to_owned();
    Ok(list.iter().map(plain).collect())
}

/// Files that may hold the episode.
fn files(dir: &Path, info: &Info, episode: i64) -> Result<Vec<PathBuf>, Error> {
    let data = dir.join("data");
    if info.codebase_version == "v2.1" {
        let chunk = episode / 1000;
        return Ok(vec![data.join(format!("chunk-{chunk:03}/episode_{episode:06}.parquet"))]);
    }
    let failed =
        |source, path: &Path| Error::File(fsio::Error::Read { source, path: path.to_owned() });
    let list = |dir: &Path| -> Result<Vec<PathBuf>, Error> {
        let mut found = Vec::new();
        for entry in dir.read_dir().map_err(|e| failed(e, dir))? {
            found.push(entry.map_err(|e| failed(e, dir))?.path());
            if found.len() > limits::PROJECT_FILES {
                return Err(foreign("too many files").in_file(dir));
            }
        }
        found.sort();
        Ok(found)
    };
    let mut files = Vec::new();
    for chunk in list(&data)?.iter().filter(|p| p.is_dir()) {
        let parquet = |p: &PathBuf| p.extension().is_some_and(|e| e == "parquet");
        files.extend(list(chunk)?.into_iter().filter(parquet));
    }
    Ok(files)
}

/// Appends frame index and values of the episode's rows in one file.
fn episode(
    path: &Path,
    source: &LeRobotSource,
    width: usize,
    frames: &mut Vec<(i64, Vec<f64>)>,
) -> Result<(), Error> {
    let failed = |source| Error::File(fsio::Error::Read { source, path: path.to_owned() });
    let file: File = fsio::open_regular(path).map_err(failed)?;
    let cap = limits::DATASET_FILE_BYTES;
    if file.metadata().map_err(failed)?.len() > cap {
        return Err(foreign(format!("more than {cap} bytes")));
    }
    // The reader panics for some damaged files; its results are dropped then.
    let read = catch_unwind(AssertUnwindSafe(|| rows(&file, source, width, frames)));
    read.unwrap_or_else(|_panic| Err(foreign("a damaged parquet file")))
}

fn rows(
    file: &File,
    source: &LeRobotSource,
    width: usize,
    frames: &mut Vec<(i64, Vec<f64>)>,
) -> Result<(), Error> {
    pages::footer(file)?;
    let reader = SerializedFileReader::new(file.try_clone().map_err(|e| foreign(e.to_string()))?);
    let reader = reader.map_err(broken)?;
    allowed(reader.metadata().row_groups().iter().map(RowGroupMetaData::num_rows), width)?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let episodes = leaf(&schema, "episode_index", 0)?;
    let indices = leaf(&schema, "frame_index", 0)?;
    let values = leaf(&schema, &source.column, 1)?;
    let mut pages = Pages::new();
    for group in 0..reader.num_row_groups() {
        let group = reader.get_row_group(group).map_err(broken)?;
        let rows = group.metadata().num_rows().max(0);
        let mut read = |column: usize, width: usize, row: &mut Visit<'_>| {
            let place = group.metadata().column(column).byte_range();
            pages.check(file, place, rows.saturating_mul(width as i64))?;
            visit(group.get_column_reader(column).map_err(broken)?, width, row)
        };
        let mut wanted = Vec::new(); // whether each row is of the episode
        read(episodes, 1, &mut |row| {
            wanted.push(row.first() == Some(&(source.episode as f64)));
            Ok(())
        })?;
        if !wanted.contains(&true) {
            continue;
        }
        let mut index = Vec::new();
        read(indices, 1, &mut |row| {
            index.extend(row.iter().map(|v| *v as i64));
            Ok(())
        })?;
        let mut each = wanted.iter().zip(&index);
        read(values, width, &mut |row| {
            let (wanted, index) =
                each.next().ok_or_else(|| foreign("columns of unequal length"))?;
            if !wanted {
                return Ok(());
            }
            if !row.iter().all(|v| v.is_finite()) {
                return Err(foreign(format!("frame {index}: {} is not finite", source.column)));
            }
            if frames.len() >= limits::CLIP_FRAMES as usize {
                return Err(foreign("more frames than a clip can hold"));
            }
            frames.push((*index, row.to_vec()));
            Ok(())
        })?;
        if each.next().is_some() {
            return Err(foreign("columns of unequal length"));
        }
    }
    Ok(())
}

/// Refuses more rows than are read, where each has this many values.
fn allowed(rows: impl Iterator<Item = i64>, width: usize) -> Result<(), Error> {
    let claimed = rows.map(|n| n.max(0)).fold(0_i64, i64::saturating_add);
    let most = limits::DATASET_ROWS.min(limits::DATASET_VALUES / width as i64);
    if claimed > most {
        return Err(foreign(format!("the file claims {claimed} rows; at most {most} are read")));
    }
    Ok(())
}

#[allow(clippy::needless_pass_by_value)] // for map_err
fn broken(e: ParquetError) -> Error {
    foreign(e.to_string())
}

/// The place of a column that holds whole numbers, or lists of any numbers if the depth is 1.
fn leaf(schema: &SchemaDescriptor, name: &str, depth: i16) -> Result<usize, Error> {
    let named = |c: &ColumnDescPtr| c.path().parts().first().is_some_and(|p| p == name);
    let mut found = schema.columns().iter().enumerate().filter(|(_, c)| named(c));
    let (place, column) = found.next().ok_or_else(|| foreign(format!("no column {name}")))?;
    let kind = column.physical_type();
    let whole = matches!(kind, Type::INT32 | Type::INT64);
    if found.next().is_some() || column.max_rep_level() > depth || (depth == 0 && !whole) {
        return Err(foreign(format!("{name} is not what it should be, but {kind}")));
    }
    Ok(place)
}

/// Gets the numbers of each row.
type Visit<'a> = dyn FnMut(&[f64]) -> Result<(), Error> + 'a;

fn visit(column: ColumnReader, width: usize, row: &mut Visit<'_>) -> Result<(), Error> {
    match column {
        ColumnReader::FloatColumnReader(c) => each_row(c, width, |v| f64::from(*v), row),
        ColumnReader::DoubleColumnReader(c) => each_row(c, width, |v| *v, row),
        ColumnReader::Int64ColumnReader(c) => each_row(c, width, |v| *v as f64, row),
        ColumnReader::Int32ColumnReader(c) => each_row(c, width, |v| f64::from(*v), row),
        _ => Err(foreign("a column that should hold numbers holds none")),
    }
}

/// Rows are read as typed values: the library's own rows take ten times the memory.
fn each_row<T: DataType>(
    mut column: ColumnReaderImpl<T>,
    width: usize,
    number: impl Fn(&T::T) -> f64,
    row: &mut Visit<'_>,
) -> Result<(), Error> {
    let (mut defined, mut repeated, mut values) = (Vec::new(), Vec::new(), Vec::new());
    let mut done = 0;
    loop {
        defined.clear();
        repeated.clear();
        values.clear();
        let read =
            column.read_records(ROWS_AT_ONCE, Some(&mut defined), Some(&mut repeated), &mut values);
        let (rows, numbers, places) = read.map_err(broken)?;
        if rows == 0 && places == 0 {
            return Ok(());
        }
        // None is missing, and a row begins where one has to. Single numbers have no repetition.
        let begins = |(at, level): (usize, &i16)| (*level == 0) == (at % width == 0);
        let whole = numbers == places && numbers == rows * width;
        if !whole || !repeated.iter().enumerate().all(begins) {
            let end = done + rows;
            return Err(foreign(format!("of rows {done} to {end} one is not {width} numbers")));
        }
        for numbers in values.chunks_exact(width) {
            row(&numbers.iter().map(&number).collect::<Vec<f64>>())?;
        }
        done += rows;
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::export::{Episode, LeRobotOptions, LeRobotVersion, lerobot};
    use super::super::super::sample;
    use super::*;
    use std::collections::BTreeMap;

    fn source(episode: i64) -> LeRobotSource {
        LeRobotSource { episode, column: "observation.state".to_owned(), degrees: true }
    }

    #[test]
    fn both_versions_come_back() {
        let takes = [20, 33].map(|n| sample::take("ur5e", 40, n).1);
        let episodes: Vec<Episode> = takes.iter().map(|t| Episode::of_take(t, "wave")).collect();
        for version in [LeRobotVersion::V3, LeRobotVersion::V2] {
            let dir = tempfile::tempdir().unwrap();
            let out = dir.path().join("set");
            let options = LeRobotOptions { version, degrees: true, ..LeRobotOptions::default() };
            lerobot(&episodes, None, &options).unwrap().write(&out).unwrap();
            for (e, take) in takes.iter().enumerate() {
                let samples = from_lerobot(&out, &source(e as i64)).unwrap();
                assert_eq!(samples.joints, take.robot.joints);
                assert_eq!(samples.rows.len(), take.frames());
                for (f, row) in samples.rows.iter().enumerate() {
                    let near = row
                        .iter()
                        .zip(take.state(f))
                        .all(|(a, b)| (a.to_radians() - b).abs() < 1e-6);
                    assert!(near, "{version:?} episode {e} frame {f}");
                }
            }
            let e = from_lerobot(&out, &source(2)).unwrap_err().to_string();
            assert!(e.contains("no episode 2") || e.contains("episode_000002"), "{e}");
            let other = LeRobotSource { column: "observation.images".to_owned(), ..source(0) };
            let e = from_lerobot(&out, &other).unwrap_err().to_string();
            assert!(e.contains("there are action, episode_index"), "{e}");
        }
    }

    #[test]
    fn degrees_are_of_hinges_only() {
        for id in ["ur5e", "pointmass"] {
            let (robot, take) = sample::take(id, 8, 8);
            let dir = tempfile::tempdir().unwrap();
            let out = dir.path().join("set");
            let options = LeRobotOptions { degrees: true, ..LeRobotOptions::default() };
            let episodes = [Episode::of_take(&take, "wave")];
            lerobot(&episodes, None, &options).unwrap().write(&out).unwrap();
            let samples = from_lerobot(&out, &source(0)).unwrap();
            let clip = samples.clip(&sample::clip(&robot, 8).robot, &BTreeMap::new(), 0.0).unwrap();
            let command = robert_clip::compile(&clip).unwrap();
            for f in 0..take.frames() {
                let row = command.row(f as u32);
                let near =
                    row.iter().zip(take.state(f)).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-5);
                assert!(near, "{id} frame {f}");
            }
        }
    }

    /// A dataset of one episode with eight frames of two joints: its folder, which lives as long as
    /// the first value, and its file.
    fn small() -> (tempfile::TempDir, PathBuf, PathBuf) {
        let take = sample::take("pointmass", 8, 8).1;
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("set");
        let episodes = [Episode::of_take(&take, "wave")];
        lerobot(&episodes, None, &LeRobotOptions::default()).unwrap().write(&out).unwrap();
        let path = out.join("data/chunk-000/file-000.parquet");
        (dir, out, path)
    }

    /// One byte in seven is changed: the result is an error or a reading, never a panic.
    #[test]
    fn damaged_files_are_refused() {
        let (_dir, out, path) = small();
        let whole = std::fs::read(&path).unwrap();
        std::panic::set_hook(Box::new(|_| ()));
        for at in (0..whole.len()).step_by(7) {
            let mut bad = whole.clone();
            bad[at] ^= 0x41;
            std::fs::write(&path, &bad).unwrap();
            from_lerobot(&out, &source(0)).ok();
        }
        drop(std::panic::take_hook());
    }

    #[test]
    fn a_file_has_a_limit_of_bytes() {
        let (_dir, out, path) = small();
        // Zeros that take no place on the disk.
        let said = |bytes| {
            let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
            file.set_len(bytes).unwrap();
            from_lerobot(&out, &source(0)).unwrap_err().to_string()
        };
        assert!(!said(limits::DATASET_FILE_BYTES).contains("more than"));
        assert!(said(limits::DATASET_FILE_BYTES + 1).contains("more than 268435456 bytes"));
    }

    #[test]
    fn rows_and_values_are_capped_over_all_row_groups() {
        let (rows, values) = (limits::DATASET_ROWS, limits::DATASET_VALUES);
        let check = |groups: &[i64], width| allowed(groups.iter().copied(), width).is_ok();
        assert!(check(&[rows - 5, 5, -1], 1) && !check(&[rows - 5, 6], 1));
        assert!(check(&[values / 64], 64) && !check(&[values / 64, 1], 64));
        assert!(!check(&[i64::MAX, i64::MAX], 1));
    }

    /// The header of a page claims more than belongs there: it is refused before it is decoded.
    #[test]
    fn claims_of_a_page_are_checked_before_it_is_decoded() {
        let (_dir, out, path) = small();
        let mut bytes = std::fs::read(&path).unwrap();
        let reader = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
        let schema = reader.metadata().file_metadata().schema_descr_ptr();
        let column = leaf(&schema, "observation.state", 1).unwrap();
        let (from, length) = reader.metadata().row_group(0).column(column).byte_range();
        let pages = &mut bytes[from as usize..(from + length) as usize];
        // The number of values of its data: the first field of the fifth or eighth of the header.
        let at = pages.windows(2).position(|w| matches!(w, [0x2c | 0x5c, 0x15])).unwrap() + 2;
        assert_eq!(pages[at] >> 1, 16, "eight frames of two joints");
        pages[at] = 126;
        std::fs::write(&path, &bytes).unwrap();
        let e = from_lerobot(&out, &source(0)).unwrap_err().to_string();
        assert!(
            e.contains("claim 63 values where 16 belong") && e.contains("file-000.parquet"),
            "{e}"
        );
    }
}
