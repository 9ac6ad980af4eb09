//! Episodes of LeRobot datasets, versions 2.1 and 3.0.

use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::{Field, Row};
use serde::Deserialize;

use super::super::error::Error;
use super::samples::{Samples, foreign, rate};
use robert_base::fsio;
use robert_base::limits;

/// The limit of bytes in one data file: the format's own limit and a reserve.
const FILE_BYTES: u64 = 256 << 20;

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
    let factor = if source.degrees { 1.0_f64.to_radians() } else { 1.0 };
    let rows = frames.into_iter().map(|(_, row)| row.iter().map(|v| v * factor).collect());
    Ok(Samples::steady(joints, fps, rows.collect()))
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
    if file.metadata().map_err(failed)?.len() > FILE_BYTES {
        return Err(foreign(format!("more than {FILE_BYTES} bytes")));
    }
    // The reader panics for some damaged files; its results are dropped then.
    let read = catch_unwind(AssertUnwindSafe(|| rows(file, source, width, frames)));
    read.unwrap_or_else(|_panic| Err(foreign("a damaged parquet file")))
}

fn rows(
    file: File,
    source: &LeRobotSource,
    width: usize,
    frames: &mut Vec<(i64, Vec<f64>)>,
) -> Result<(), Error> {
    let broken = |e: parquet::errors::ParquetError| foreign(e.to_string());
    let reader = SerializedFileReader::new(file).map_err(broken)?;
    let claimed = reader.metadata().row_groups().iter().map(|g| g.num_rows().max(0));
    let claimed = claimed.fold(0_i64, i64::saturating_add);
    if claimed > limits::DATASET_ROWS {
        let most = limits::DATASET_ROWS;
        return Err(foreign(format!("the file claims {claimed} rows; at most {most} are read")));
    }
    // Only the columns that are needed, one of which is a list.
    let wanted = ["episode_index", "frame_index", source.column.as_str()];
    let schema = reader.metadata().file_metadata().schema();
    let fields = schema.get_fields().iter().filter(|f| wanted.contains(&f.name())).cloned();
    let projection = parquet::schema::types::Type::group_type_builder(schema.name())
        .with_fields(fields.collect())
        .build()
        .map_err(broken)?;
    for row in reader.get_row_iter(Some(projection)).map_err(broken)? {
        let row = row.map_err(broken)?;
        if integer(&row, "episode_index")? != source.episode {
            continue;
        }
        let values = match column(&row, &source.column)? {
            Field::ListInternal(list) => list.elements().iter().map(number).collect(),
            single => number(single).map(|v| vec![v]),
        };
        let values: Option<Vec<f64>> = values;
        let values = values.filter(|v| v.len() == width && v.iter().all(|x| x.is_finite()));
        let index = integer(&row, "frame_index")?;
        let values = values.ok_or_else(|| {
            foreign(format!("frame {index}: {} is not {width} numbers", source.column))
        })?;
        if frames.len() >= limits::CLIP_FRAMES as usize {
            return Err(foreign("more frames than a clip can hold"));
        }
        frames.push((index, values));
    }
    Ok(())
}

fn column<'a>(row: &'a Row, name: &str) -> Result<&'a Field, Error> {
    let found = row.get_column_iter().find(|(n, _)| *n == name).map(|(_, f)| f);
    found.ok_or_else(|| foreign(format!("no column {name}")))
}

fn integer(row: &Row, name: &str) -> Result<i64, Error> {
    match column(row, name)? {
        Field::Long(v) => Ok(*v),
        Field::Int(v) => Ok(i64::from(*v)),
        other => Err(foreign(format!("{name} is {other}"))),
    }
}

fn number(field: &Field) -> Option<f64> {
    match field {
        Field::Float(v) => Some(f64::from(*v)),
        Field::Double(v) => Some(*v),
        Field::Long(v) => Some(*v as f64),
        Field::Int(v) => Some(f64::from(*v)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::export::{Episode, LeRobotOptions, LeRobotVersion, lerobot};
    use super::super::super::sample;
    use super::*;

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
                    let near = row.iter().zip(take.state(f)).all(|(a, b)| (a - b).abs() < 1e-6);
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

    /// One byte in seven is changed: the result is an error or a reading, never a panic.
    #[test]
    fn damaged_files_are_refused() {
        let take = sample::take("pointmass", 8, 8).1;
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("set");
        let episodes = [Episode::of_take(&take, "wave")];
        lerobot(&episodes, None, &LeRobotOptions::default()).unwrap().write(&out).unwrap();
        let path = out.join("data/chunk-000/file-000.parquet");
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
}
