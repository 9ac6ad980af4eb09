//! LeRobot datasets, version 3.0 (several episodes a file) and 2.1 (a file an episode).
//!
//! A row is a frame: the observation, and the action that was applied after it. Positions are in
//! rad (or degrees), torques in N m; the names of the action are the keys of the robot's
//! `send_action`. The layout is that of lerobot 0.6.1; `script/peers` reads it with `datasets` and
//! `lerobot-doctor`.

use robert_base::json;
use std::fmt::Write as _;

use serde_json::{Map, Value, json};

use super::super::error::Error;
use super::episode::Episode;
use super::files::{Export, File, Folder};
use super::lerobot_features::{Feature, features};
use super::lerobot_layout::{CHUNK_FILES, LeRobotAction, LeRobotOptions, LeRobotVersion, Place};
use super::stats::Stats;
use super::table::{Column, Kind, Table};
use super::video::{Films, KEY};
use robert_base::units::FPS;

/// Limit of bytes in one data file, after which the next begins: that of the format.
const FILE_BYTES: usize = 100 << 20;

/// Episodes as a dataset, with their films if there are any.
///
/// # Errors
/// [`Error::Unfit`] for no episode, or for episodes of different robots; [`Error::Encode`].
pub fn lerobot(
    episodes: &[Episode],
    films: Option<Films>,
    options: &LeRobotOptions,
) -> Result<Export, Error> {
    let Some(first) = episodes.first() else {
        return Err(unfit("there is no episode".to_owned()));
    };
    let names = |e: &Episode| (e.position.names.clone(), e.control.names.clone());
    if let Some(other) = episodes.iter().find(|e| names(e) != names(first)) {
        let (a, b) = (&first.robot, &other.robot);
        return Err(unfit(format!("episodes of {a} and of {b} have other joints or actuators")));
    }
    let features: Vec<Vec<Feature>> = episodes.iter().map(|e| features(e, options)).collect();
    let filmed = films.as_ref().map_or(episodes.len(), |f| f.samples.len());
    assert_eq!(filmed, episodes.len(), "a film for each episode");
    let set = Set::new(episodes, features, films);
    let files = match options.version {
        LeRobotVersion::V3 => set.v3()?,
        LeRobotVersion::V2 => set.v2()?,
    };
    let action = match options.action {
        LeRobotAction::Position => "the position reached one frame later",
        LeRobotAction::Torque => "the torque or force of each actuator during the frame, N m or N",
    };
    let angle = if options.degrees { "degrees" } else { "rad" };
    let export = Export {
        files,
        folder: Some(Folder { path: String::new(), marker: "meta/info.json" }),
        frames: set.total(),
        meaning: Vec::new(),
        open: format!("lerobot-doctor check {}", Export::OUT),
    };
    Ok(export
        .says(format!("{} episodes, 20 frames a second; observation.state is the position ({angle}; m for slides), observation.velocity its rate.", episodes.len()))
        .says(format!("The action of a row is {action}; it is applied after that row's observation."))
        .says(format!("Load it with LeRobotDataset(\"local/robert\", root=\"{}\").", Export::OUT)))
}

/// Everything that both layouts are made of.
struct Set<'a> {
    episodes: &'a [Episode],
    features: Vec<Vec<Feature>>,
    films: Option<Films>,
    /// Distinct tasks in order of appearance.
    tasks: Vec<&'a str>,
}

impl<'a> Set<'a> {
    fn new(episodes: &'a [Episode], features: Vec<Vec<Feature>>, films: Option<Films>) -> Set<'a> {
        let mut tasks: Vec<&str> = Vec::new();
        for e in episodes {
            if !tasks.contains(&e.task.as_str()) {
                tasks.push(&e.task);
            }
        }
        Set { episodes, features, films, tasks }
    }

    fn total(&self) -> usize {
        self.episodes.iter().map(Episode::frames).sum()
    }

    fn task(&self, episode: usize) -> i64 {
        let own = self.episodes[episode].task.as_str();
        self.tasks.iter().position(|t| *t == own).map_or(0, |i| i as i64)
    }

    /// Columns of the data, in the order of the features.
    fn columns(&self) -> Vec<(String, Kind)> {
        let vectors = self.features[0].iter().map(|f| (f.key.to_owned(), Kind::Floats));
        let counters = ["frame_index", "episode_index", "index", "task_index"];
        vectors
            .chain([("timestamp".to_owned(), Kind::Float)])
            .chain(counters.map(|c| (c.to_owned(), Kind::Int)))
            .collect()
    }

    /// Rows of an episode; `from` is its first global index.
    fn rows(&self, episode: usize, from: usize) -> Vec<Column> {
        let n = self.episodes[episode].frames();
        let mut columns: Vec<Column> = self.features[episode]
            .iter()
            .map(|f| {
                let values = f.values.iter().map(|v| *v as f32).collect();
                Column::Floats(f.names.len(), values)
            })
            .collect();
        columns.push(Column::Float(times(n)));
        columns.push(Column::Int((0..n as i64).collect()));
        columns.push(Column::Int(vec![episode as i64; n]));
        columns.push(Column::Int((from as i64..(from + n) as i64).collect()));
        columns.push(Column::Int(vec![self.task(episode); n]));
        columns
    }

    /// Statistics of each feature over these episodes, whose first global index is `from`.
    fn stats(&self, episodes: std::ops::Range<usize>, from: usize) -> Vec<(String, Stats, bool)> {
        let mut out = Vec::new();
        for (i, feature) in self.features[0].iter().enumerate() {
            let values: Vec<f64> =
                episodes.clone().flat_map(|e| self.features[e][i].values.iter().copied()).collect();
            out.push((feature.key.to_owned(), Stats::of(&values, feature.names.len()), false));
        }
        let mut counters: [Vec<f64>; 5] = Default::default();
        let mut index = from;
        for e in episodes.clone() {
            for f in 0..self.episodes[e].frames() {
                let row = [
                    f as f64 / f64::from(FPS),
                    f as f64,
                    e as f64,
                    index as f64,
                    self.task(e) as f64,
                ];
                index += 1;
                counters.iter_mut().zip(row).for_each(|(c, v)| c.push(v));
            }
        }
        let names = ["timestamp", "frame_index", "episode_index", "index", "task_index"];
        for (name, values) in names.iter().zip(&counters) {
            out.push(((*name).to_owned(), Stats::of(values, 1), false));
        }
        if let Some(films) = &self.films {
            let pixels: Vec<f64> =
                episodes.flat_map(|e| films.samples[e].iter().copied()).collect();
            out.push((KEY.to_owned(), Stats::of(&pixels, 3), true));
        }
        out
    }

    fn stats_json(stats: &[(String, Stats, bool)]) -> Value {
        Value::Object(stats.iter().map(|(n, s, p)| (n.clone(), s.json(*p))).collect())
    }

    fn info(&self) -> Map<String, Value> {
        let mut features = Map::new();
        for f in &self.features[0] {
            let one = json!({"dtype": "float32", "shape": [f.names.len()], "names": f.names});
            features.insert(f.key.to_owned(), one);
        }
        let scalar = |dtype: &str| json!({"dtype": dtype, "shape": [1], "names": null});
        features.insert("timestamp".to_owned(), scalar("float32"));
        for counter in ["frame_index", "episode_index", "index", "task_index"] {
            features.insert(counter.to_owned(), scalar("int64"));
        }
        if let Some(films) = &self.films {
            features.insert(KEY.to_owned(), films.feature());
        }
        let info = json!({
            "fps": FPS,
            "features": features,
            "robot_type": self.episodes[0].robot,
            "total_episodes": self.episodes.len(),
            "total_frames": self.total(),
            "total_tasks": self.tasks.len(),
            "chunks_size": CHUNK_FILES,
            "splits": {"train": format!("0:{}", self.episodes.len())},
        });
        let Value::Object(info) = info else { unreachable!("an object was written above") };
        info
    }

    fn v3(&self) -> Result<Vec<File>, Error> {
        let mut files = Vec::new();
        let mut table = Table::new(&self.columns(), None)?;
        let (mut from, mut data, mut rows) = (0, 0, EpisodeRows::default());
        for (e, episode) in self.episodes.iter().enumerate() {
            if table.size() > FILE_BYTES {
                let full = std::mem::replace(&mut table, Table::new(&self.columns(), None)?);
                files.push(File {
                    name: Place::nth(data).path("data", "parquet"),
                    bytes: full.finish()?,
                });
                data += 1;
            }
            table.group(&self.rows(e, from))?;
            rows.places.push(Place::nth(data));
            rows.from.push(from as i64);
            from += episode.frames();
            rows.to.push(from as i64);
        }
        let last = Place::nth(data).path("data", "parquet");
        files.push(File { name: last, bytes: table.finish()? });
        let films = self.films.iter().flat_map(|f| &f.files).enumerate();
        files.extend(films.map(|(n, (bytes, _))| File {
            name: Place::nth(n).path(&format!("videos/{KEY}"), "mp4"),
            bytes: bytes.clone(),
        }));
        files.push(File {
            name: Place::nth(0).path("meta/episodes", "parquet"),
            bytes: self.episode_table(&rows)?,
        });
        let whole = self.stats(0..self.episodes.len(), 0);
        let mut info = self.info();
        for (key, value) in [
            ("codebase_version", json!("v3.0")),
            ("data_files_size_in_mb", json!(100)),
            ("video_files_size_in_mb", json!(200)),
            ("data_path", json!("data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet")),
            (
                "video_path",
                if self.films.is_none() {
                    Value::Null
                } else {
                    json!("videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4")
                },
            ),
        ] {
            info.insert(key.to_owned(), value);
        }
        files.push(json_file("meta/info.json", &Value::Object(info)));
        files.push(json_file("meta/stats.json", &Self::stats_json(&whole)));
        files.push(File { name: "meta/tasks.parquet".to_owned(), bytes: self.task_table()? });
        Ok(files)
    }

    /// One row per episode: the place of its frames, and its statistics.
    fn episode_table(&self, rows: &EpisodeRows) -> Result<Vec<u8>, Error> {
        let n = self.episodes.len();
        let mut columns: Vec<(String, Kind)> = Vec::new();
        let mut values: Vec<Column> = Vec::new();
        let mut add = |name: &str, kind, column| {
            columns.push((name.to_owned(), kind));
            values.push(column);
        };
        let ints = |f: &dyn Fn(usize) -> usize| Column::Int((0..n).map(|e| f(e) as i64).collect());
        add("episode_index", Kind::Int, ints(&|e| e));
        let tasks = self.episodes.iter().map(|e| vec![e.task.clone()]).collect();
        add("tasks", Kind::Texts, Column::Texts(tasks));
        add("length", Kind::Int, ints(&|e| self.episodes[e].frames()));
        add("data/chunk_index", Kind::Int, ints(&|e| rows.places[e].chunk));
        add("data/file_index", Kind::Int, ints(&|e| rows.places[e].file));
        add("dataset_from_index", Kind::Int, Column::Int(rows.from.clone()));
        add("dataset_to_index", Kind::Int, Column::Int(rows.to.clone()));
        if let Some(films) = &self.films {
            // File, first and last second of each episode's film.
            let mut spans = Vec::with_capacity(n);
            for (file, (_, episodes)) in films.files.iter().enumerate() {
                let (mut frame, secs) = (0, |f: usize| f as f64 / f64::from(FPS));
                for e in episodes.clone() {
                    let end = frame + self.episodes[e].frames();
                    spans.push((Place::nth(file), secs(frame), secs(end)));
                    frame = end;
                }
            }
            let key = |end: &str| format!("videos/{KEY}/{end}");
            add(&key("chunk_index"), Kind::Int, ints(&|e| spans[e].0.chunk));
            add(&key("file_index"), Kind::Int, ints(&|e| spans[e].0.file));
            let from = Column::Double(spans.iter().map(|s| s.1).collect());
            add(&key("from_timestamp"), Kind::Double, from);
            let to = Column::Double(spans.iter().map(|s| s.2).collect());
            add(&key("to_timestamp"), Kind::Double, to);
        }
        let per: Vec<Vec<(String, Stats, bool)>> =
            (0..n).map(|e| self.stats(e..e + 1, rows.from[e] as usize)).collect();
        for (f, (name, stats, _)) in per[0].iter().enumerate() {
            for (r, (figure, row)) in stats.rows.iter().enumerate() {
                let all = per.iter().flat_map(|e| e[f].1.rows[r].1.iter().copied()).collect();
                let column = Column::Doubles(row.len(), all);
                add(&format!("stats/{name}/{figure}"), Kind::Doubles, column);
            }
            let count = per.iter().map(|e| e[f].1.count as i64).collect();
            add(&format!("stats/{name}/count"), Kind::Ints, Column::Ints(1, count));
        }
        add("meta/episodes/chunk_index", Kind::Int, ints(&|_| 0));
        add("meta/episodes/file_index", Kind::Int, ints(&|_| 0));
        let mut table = Table::new(&columns, None)?;
        table.group(&values)?;
        table.finish()
    }

    /// The tasks. Without the key `pandas` readers would take a running number for the index and
    /// lose the words.
    fn task_table(&self) -> Result<Vec<u8>, Error> {
        let column = |name: &str, pandas: &str, numpy: &str| json!({"name": name, "field_name": name, "pandas_type": pandas, "numpy_type": numpy, "metadata": null});
        let pandas = json!({
            "index_columns": ["task"],
            "column_indexes": [],
            "columns": [
                column("task_index", "int64", "int64"),
                column("task", "unicode", "object"),
            ],
            "pandas_version": "2.2.0",
        });
        let columns = [("task_index".to_owned(), Kind::Int), ("task".to_owned(), Kind::Text)];
        let mut table = Table::new(&columns, Some(("pandas", pandas.to_string())))?;
        table.group(&[
            Column::Int((0..self.tasks.len() as i64).collect()),
            Column::Text(self.tasks.iter().map(|t| (*t).to_owned()).collect()),
        ])?;
        table.finish()
    }

    fn v2(&self) -> Result<Vec<File>, Error> {
        let mut files = Vec::new();
        let (mut list, mut stats) = (String::new(), String::new());
        let mut from = 0;
        for (e, episode) in self.episodes.iter().enumerate() {
            let chunk = e / CHUNK_FILES;
            let mut table = Table::new(&self.columns(), None)?;
            table.group(&self.rows(e, from))?;
            let name = format!("data/chunk-{chunk:03}/episode_{e:06}.parquet");
            files.push(File { name, bytes: table.finish()? });
            if let Some(films) = &self.films {
                let name = format!("videos/chunk-{chunk:03}/{KEY}/episode_{e:06}.mp4");
                files.push(File { name, bytes: films.files[e].0.clone() });
            }
            let line =
                json!({"episode_index": e, "tasks": [episode.task], "length": episode.frames()});
            writeln!(list, "{line}").ok();
            let own = Self::stats_json(&self.stats(e..e + 1, from));
            writeln!(stats, "{}", json!({"episode_index": e, "stats": own})).ok();
            from += episode.frames();
        }
        let mut tasks = String::new();
        for (i, task) in self.tasks.iter().enumerate() {
            writeln!(tasks, "{}", json!({"task_index": i, "task": task})).ok();
        }
        let mut info = self.info();
        let chunks = self.episodes.len().div_ceil(CHUNK_FILES);
        for (key, value) in [
            ("codebase_version", json!("v2.1")),
            ("total_videos", json!(self.films.as_ref().map_or(0, |f| f.files.len()))),
            ("total_chunks", json!(chunks)),
            (
                "data_path",
                json!("data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"),
            ),
            (
                "video_path",
                if self.films.is_none() {
                    Value::Null
                } else {
                    json!(
                        "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
                    )
                },
            ),
        ] {
            info.insert(key.to_owned(), value);
        }
        files.push(json_file("meta/info.json", &Value::Object(info)));
        let whole = self.stats(0..self.episodes.len(), 0);
        files.push(json_file("meta/stats.json", &Self::stats_json(&whole)));
        for (name, text) in [("episodes", list), ("episodes_stats", stats), ("tasks", tasks)] {
            files.push(File { name: format!("meta/{name}.jsonl"), bytes: text.into_bytes() });
        }
        Ok(files)
    }
}

/// The positions of the episodes' frames.
#[derive(Default)]
struct EpisodeRows {
    places: Vec<Place>,
    from: Vec<i64>,
    to: Vec<i64>,
}

/// Seconds since the start of the episode, as `frame_index / fps` is in single precision.
fn times(frames: usize) -> Vec<f32> {
    (0..frames).map(|f| (f as f64 / f64::from(FPS)) as f32).collect()
}

fn json_file(name: &str, value: &Value) -> File {
    // Values only: serialising cannot fail.
    let text = json::pretty(value);
    File { name: name.to_owned(), bytes: text.into_bytes() }
}

fn unfit(problem: String) -> Error {
    Error::Unfit { format: "lerobot", problem }
}

#[cfg(test)]
mod tests {
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use parquet::record::{Row, RowAccessor as _};

    use super::super::super::sample;
    use super::*;

    fn episodes(id: &str) -> Vec<Episode> {
        [20, 33]
            .map(|n| Episode::of_take(&sample::take(id, 40, n).1, &format!("wave {}", n / 30)))
            .to_vec()
    }

    #[test]
    fn episodes_of_different_robots_are_refused() {
        let mixed = [episodes("pointmass"), episodes("ur5e")].concat();
        // Which joints are commanded is known of the first robot only.
        let options =
            LeRobotOptions { motorised: Some(vec![true; 2]), ..LeRobotOptions::default() };
        let refused = lerobot(&mixed, None, &options).err().unwrap().to_string();
        assert!(
            refused.contains("episodes of pointmass and of ur5e have other joints"),
            "{refused}"
        );
    }

    fn file<'a>(export: &'a Export, name: &str) -> &'a [u8] {
        let found = export.files.iter().find(|f| f.name == name);
        &found.unwrap_or_else(|| panic!("no {name}")).bytes
    }

    fn rows(bytes: &[u8]) -> Vec<Row> {
        let reader = SerializedFileReader::new(bytes::Bytes::copy_from_slice(bytes)).unwrap();
        reader.get_row_iter(None).unwrap().map(Result::unwrap).collect()
    }

    fn floats(row: &Row, column: usize) -> Vec<f64> {
        let number = |f: &parquet::record::Field| match f {
            parquet::record::Field::Float(v) => f64::from(*v),
            other => panic!("{other}"),
        };
        row.get_list(column).unwrap().elements().iter().map(number).collect()
    }

    #[test]
    fn rows_are_states_and_the_actions_after_them() {
        let episodes = episodes("ur5e");
        let export = lerobot(&episodes, None, &LeRobotOptions::default()).unwrap();
        assert_eq!(lerobot(&episodes, None, &LeRobotOptions::default()).unwrap(), export);
        let info: Value = serde_json::from_slice(file(&export, "meta/info.json")).unwrap();
        assert_eq!((&info["total_frames"], &info["total_episodes"]), (&json!(53), &json!(2)));
        assert_eq!(info["features"]["action"]["names"][0], "shoulder_pan.pos");
        let rows = rows(file(&export, "data/chunk-000/file-000.parquet"));
        assert_eq!(rows.len(), 53);
        let first = &episodes[0];
        for (f, row) in rows[..20].iter().enumerate() {
            let state = floats(row, 0);
            let want = first.position.rows().nth(f).unwrap();
            assert!(state.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-6));
            let next = first.position.rows().nth((f + 1).min(19)).unwrap();
            assert!(floats(row, 2).iter().zip(next).all(|(a, b)| (a - b).abs() < 1e-6));
            assert!((f64::from(row.get_float(3).unwrap()) - f as f64 / 20.0).abs() < 1e-6);
        }
        let counters: Vec<i64> = (4..8).map(|c| rows[25].get_long(c).unwrap()).collect();
        assert_eq!(counters, [5, 1, 25, 1]);
        let names = export.files.iter().map(|f| f.name.as_str()).collect::<Vec<_>>();
        assert!(names.contains(&"meta/tasks.parquet") && names.contains(&"meta/stats.json"));
    }

    #[test]
    fn torque_degrees_and_names_are_as_asked_for() {
        let episodes = episodes("ur5e");
        let options = LeRobotOptions {
            version: LeRobotVersion::V2,
            action: LeRobotAction::Torque,
            degrees: true,
            rename: [("elbow".to_owned(), "bend".to_owned())].into(),
            ..LeRobotOptions::default()
        };
        let export = lerobot(&episodes, None, &options).unwrap();
        let info: Value = serde_json::from_slice(file(&export, "meta/info.json")).unwrap();
        assert_eq!(info["codebase_version"], "v2.1");
        assert_eq!(info["features"]["observation.state"]["names"][2], "bend.pos");
        let action = &info["features"]["action"]["names"];
        assert!(action[0].as_str().unwrap().ends_with(".effort"), "{action}");
        let rows = rows(file(&export, "data/chunk-000/episode_000001.parquet"));
        let want = episodes[1].position.rows().nth(7).unwrap()[1].to_degrees();
        assert!((floats(&rows[7], 0)[1] - want).abs() < 1e-4);
        let want = episodes[1].control.rows().nth(7).unwrap()[1];
        assert!((floats(&rows[7], 2)[1] - want).abs() < 1e-4);
        assert_eq!(floats(&rows[32], 2), floats(&rows[31], 2), "the last action again");
        let lines = String::from_utf8(file(&export, "meta/episodes.jsonl").to_vec()).unwrap();
        assert_eq!(lines.lines().count(), 2);
    }

    #[test]
    fn robots_are_not_mixed() {
        let mut mixed = episodes("ur5e");
        mixed.extend(episodes("pointmass"));
        let e = lerobot(&mixed, None, &LeRobotOptions::default()).unwrap_err().to_string();
        assert!(e.contains("ur5e") && e.contains("pointmass"), "{e}");
        assert!(lerobot(&[], None, &LeRobotOptions::default()).is_err());
    }
}
