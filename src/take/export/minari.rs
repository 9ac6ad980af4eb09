//! Minari datasets, stored as parquet: motion for offline reinforcement learning.
//!
//! A dataset is in the folder `<root>/<namespace>/<name>-v<N>`, and its id must be that path. An
//! episode has one more row than actions. The action beside its last observation is padding, which
//! readers remove.

use robert_base::json;
use serde_json::{Value, json};

use super::super::error::Error;
use super::episode::Episode;
use super::files::{Export, File, Folder};
use super::table::{Column, Kind, Table};

/// The version of the layout that is written.
const VERSION: &str = "0.5.4";
const MEGABYTE: f64 = 1_000_000.0;

/// Episodes as the dataset `robert/<robot>/<name>-v0` below the output.
///
/// # Errors
/// [`Error::Unfit`] for no episode with an action, or for different robots;
/// [`Error::Encode`].
pub fn minari(
    episodes: impl Iterator<Item = Episode>,
    name: &str,
    describe: &str,
) -> Result<Export, Error> {
    let mut robot: Option<(String, usize, usize)> = None;
    let (mut files, mut steps, mut rows) = (Vec::new(), 0, 0);
    let mut count = 0;
    for e in episodes {
        let taken = e.control.rows().len();
        let shape = (e.robot.clone(), e.position.names.len(), e.control.names.len());
        if taken == 0 {
            continue;
        }
        match &robot {
            Some(first) if *first != shape => {
                return Err(unfit(format!("episodes of {} and of {}", first.0, e.robot)));
            }
            _ => robot = Some(shape),
        }
        let (table, at) = (episode(&e)?, format!("data/{count}"));
        files.push(File { name: format!("{at}/part-0.parquet"), bytes: table });
        let own = json!({"id": count, "total_steps": taken, "task": e.task});
        files.push(text(&format!("{at}/metadata.json"), &own));
        steps += taken;
        rows += e.frames();
        count += 1;
    }
    let Some((robot, state, action)) = robot else {
        return Err(unfit("no episode has an action".to_owned()));
    };
    let id = format!("robert/{}/{}-v0", plain(&robot), plain(name));
    let size: usize = files.iter().map(|f| f.bytes.len()).sum();
    let space = |n: usize, low: f64, high: f64, dtype: &str| {
        // Python's reader accepts Infinity, but JSON has no such number: the values are words in a
        // string.
        let word = |v: f64| {
            if v.is_finite() {
                format!("{v:?}")
            } else if v > 0.0 {
                "Infinity".into()
            } else {
                "-Infinity".to_owned()
            }
        };
        let list = |v: f64| vec![word(v); n].join(", ");
        format!(
            "{{\"type\": \"Box\", \"dtype\": \"{dtype}\", \"shape\": [{n}], \"low\": [{}], \"high\": [{}]}}",
            list(low),
            list(high)
        )
    };
    let unbounded = f64::INFINITY;
    let metadata = json!({
        "total_episodes": count,
        "total_steps": steps,
        "data_format": "parquet",
        "jpeg_encoding": true,
        "observation_space": space(2 * state, -unbounded, unbounded, "float64"),
        "action_space": space(action, -unbounded, unbounded, "float32"),
        "dataset_id": id,
        "minari_version": VERSION,
        "algorithm_name": describe,
        "author": ["robert"],
        "author_email": [],
        "code_permalink": "",
        "description": format!(
            "{robot}, 20 frames a second. Observations are joint positions, then velocities (rad, rad/s; m, m/s for slides); actions are controls (N m, or N). There are no rewards: all are 0. Episodes are truncated, never terminated."
        ),
        "requirements": [],
        "dataset_size": (size as f64 / MEGABYTE * 10.0).round() / 10.0,
    });
    files.push(text("data/metadata.json", &metadata));
    for file in &mut files {
        file.name = format!("{id}/{}", file.name);
    }
    for space in ["robert".to_owned(), format!("robert/{}", plain(&robot))] {
        files
            .push(File { name: format!("{space}/namespace_metadata.json"), bytes: b"{}".to_vec() });
    }
    let open = format!(
        "MINARI_DATASETS_PATH={} python -c \"import minari; print(minari.load_dataset('{id}'))\"",
        Export::OUT
    );
    let export = Export {
        files,
        folder: Some(Folder { path: id.clone(), marker: "data/metadata.json" }),
        frames: rows,
        meaning: Vec::new(),
        open,
    };
    Ok(export
        .says(format!("{id}: {count} episodes, {steps} steps, 20 a second; pip install 'minari[arrow]' Pillow."))
        .says("Observations: positions, then velocities (rad, rad/s); actions: controls (N m). Rewards are 0: there are none."))
}

/// The table of an episode.
fn episode(e: &Episode) -> Result<Vec<u8>, Error> {
    let (frames, taken) = (e.control.rows().len() + 1, e.control.rows().len());
    let (state, action) = (e.position.names.len(), e.control.names.len());
    let columns = [
        ("observations", Kind::Doubles),
        ("actions", Kind::Floats),
        ("rewards", Kind::Double),
        ("terminations", Kind::Bool),
        ("truncations", Kind::Bool),
    ]
    .map(|(name, kind)| (name.to_owned(), kind));
    let mut table = Table::new(&columns, None)?;
    let observations = e
        .position
        .rows()
        .zip(e.velocity.rows())
        .take(frames)
        .flat_map(|(q, v)| q.iter().chain(v).copied())
        .collect();
    let mut actions: Vec<f32> = e.control.values.iter().map(|v| *v as f32).collect();
    actions.resize(frames * action, 0.0);
    table.group(&[
        Column::Doubles(2 * state, observations),
        Column::Floats(action, actions),
        Column::Double(vec![0.0; frames]),
        Column::Bool(vec![false; frames]),
        Column::Bool((0..frames).map(|f| f + 1 == taken).collect()),
    ])?;
    table.finish()
}

/// A word of an id.
fn plain(name: &str) -> String {
    let word: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' }).collect();
    if word.is_empty() { "motion".to_owned() } else { word }
}

fn text(name: &str, value: &Value) -> File {
    // Values only: serialising cannot fail.
    let bytes = json::pretty(value).into_bytes();
    File { name: name.to_owned(), bytes }
}

fn unfit(problem: String) -> Error {
    Error::Unfit { format: "minari", problem }
}

#[cfg(test)]
mod tests {
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use parquet::record::RowAccessor as _;

    use super::super::super::sample;
    use super::*;

    #[test]
    fn an_episode_has_a_row_more_than_actions() {
        let takes = [20, 33].map(|n| sample::take("ur5e", 40, n).1);
        let episodes = || takes.iter().map(|t| Episode::of_take(t, "wave"));
        let export = minari(episodes(), "my clip", "pd").unwrap();
        assert_eq!(minari(episodes(), "my clip", "pd").unwrap(), export);
        let find = |end: &str| {
            let name = format!("robert/ur5e/my-clip-v0/data/{end}");
            export.files.iter().find(|f| f.name == name).unwrap().bytes.clone()
        };
        let whole: Value = serde_json::from_slice(&find("metadata.json")).unwrap();
        assert_eq!((&whole["total_steps"], &whole["total_episodes"]), (&json!(51), &json!(2)));
        let space = whole["observation_space"].as_str().unwrap();
        assert!(space.contains("\"shape\": [10]") && space.contains("-Infinity"), "{space}");
        let bytes = bytes::Bytes::from(find("1/part-0.parquet"));
        let reader = SerializedFileReader::new(bytes).unwrap();
        let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
        assert_eq!(rows.len(), 33);
        let truncated: Vec<bool> = rows.iter().map(|r| r.get_bool(4).unwrap()).collect();
        assert_eq!(truncated.iter().position(|t| *t), Some(31));
        let seen = rows[5].get_list(0).unwrap().elements().to_vec();
        for (j, want) in takes[1].state(5).iter().enumerate() {
            assert_eq!(format!("{:?}", seen[j]), format!("Double({want:?})"));
        }
        let marks = export.files.iter().filter(|f| f.name.ends_with("namespace_metadata.json"));
        assert_eq!(marks.count(), 2);
    }
}
