//! The points of a sweep on disk: each is trained once, by whichever process is asked for it.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::sweep::{Combination, Point, Reached, Row, Sweep, Work, rows, slug, suites_of, view};
use super::{Error, TrainConfig, read_config};
use robert_base::json;
use robert_base::{fsio, limits};
use robert_dataset::{Dataset, Verify};
use robert_robot::Robot;
use robert_rollout::Suite;

/// The result of a call of [`sweep`].
#[derive(Clone, Debug)]
pub struct Swept {
    /// The rows so far.
    pub rows: Vec<Row>,
    /// Whether all points are done.
    pub complete: bool,
    /// Sha-256 of the manifest of the data.
    pub data_sha256: String,
}

/// The points of a sweep in its folder, by index.
#[derive(Debug)]
pub struct Points<'a> {
    sweep: &'a Sweep,
    robot: &'a Arc<Robot>,
    work: &'a Work<'a>,
    combinations: Vec<Combination>,
    data_sha256: String,
    suites: OnceCell<Vec<Suite>>,
}

impl<'a> Points<'a> {
    /// Verifies the data and takes possession of the folder.
    ///
    /// # Errors
    /// [`Error::Data`]; [`Error::Sweep`] for a folder of other data.
    pub fn open(
        sweep: &'a Sweep,
        robot: &'a Arc<Robot>,
        work: &'a Work<'a>,
    ) -> Result<Self, Error> {
        // All data are verified once; the views use the same shards.
        let whole = Dataset::open(&work.data, Verify::Full)?;
        whole.must_be_of(robot)?;
        let data_sha256 = whole.manifest().sha256();
        claim(&work.out, &data_sha256)?;
        let (combinations, suites) = (sweep.combinations(), OnceCell::new());
        Ok(Points { sweep, robot, work, combinations, data_sha256, suites })
    }

    /// Number of points, seeds included.
    pub fn count(&self) -> usize {
        self.combinations.len() * self.sweep.seeds.len()
    }

    /// The seed and the values of a point. The points are ordered by seed.
    fn at(&self, index: usize) -> (u64, &Combination) {
        let n = self.combinations.len();
        (self.sweep.seeds[index / n], &self.combinations[index % n])
    }

    fn dir(&self, index: usize) -> PathBuf {
        let (seed, values) = self.at(index);
        self.work.out.join("points").join(slug(values)).join(format!("seed-{seed}"))
    }

    fn data(&self, index: usize) -> Result<Dataset, Error> {
        let (seed, values) = self.at(index);
        view(values, seed, &self.work.data, &self.work.out)
    }

    /// The result of a point that is done.
    ///
    /// # Errors
    /// [`Error::Sweep`] if it was made with other settings or data, or is damaged.
    pub fn finished(&self, index: usize) -> Result<Option<Reached>, Error> {
        let (seed, values) = self.at(index);
        let sha = self.data(index)?.manifest().sha256();
        finished(&self.dir(index), &self.sweep.config(values, seed)?, self.sweep.evaluations, &sha)
    }

    /// The points that are not done. All views of the data exist afterwards, so that several processes
    /// can work on them.
    ///
    /// # Errors
    /// As [`Points::finished`].
    pub fn left(&self) -> Result<Vec<usize>, Error> {
        let mut left = Vec::new();
        for index in 0..self.count() {
            if self.finished(index)?.is_none() {
                left.push(index);
            }
        }
        Ok(left)
    }

    /// Trains and evaluates a point, or continues it; `None` if a stop was requested.
    ///
    /// # Errors
    /// Those of training and of the files.
    pub fn reach(&self, index: usize) -> Result<Option<Reached>, Error> {
        let (sweep, robot) = (self.sweep, self.robot);
        let ((seed, values), dir) = (self.at(index), self.dir(index));
        let data = &self.data(index)?;
        let suites = match self.suites.get() {
            Some(suites) => suites,
            None => {
                // Extracted from the held-out part, which is the same in every view.
                let made = suites_of(sweep, robot, data)?;
                self.suites.get_or_init(|| made)
            }
        };
        let point = Point { sweep, robot, values, seed, data, suites, dir: &dir };
        let Some(reached) = point.reach(self.work)? else { return Ok(None) };
        let text = json::pretty(&reached);
        fsio::write_atomic(&dir.join("result.json"), text.as_bytes())?;
        Ok(Some(reached))
    }
}

/// Trains and evaluates the points that are not done yet.
///
/// # Errors
/// Those of training and of the files; finished points are kept.
pub fn sweep(sweep: &Sweep, robot: &Arc<Robot>, work: &Work<'_>) -> Result<Swept, Error> {
    let points = Points::open(sweep, robot, work)?;
    let mut found = Vec::new();
    let mut complete = true;
    for index in 0..points.count() {
        if let Some(done) = points.finished(index)? {
            found.push(done);
            continue;
        }
        // The work of earlier calls says nothing about the time left.
        let (seed, values) = points.at(index);
        let note = format!("{} seed {seed}", slug(values));
        work.progress.tick(found.len() as u64, points.count() as u64, &note);
        let Some(reached) = points.reach(index)? else {
            complete = false;
            break;
        };
        found.push(reached);
    }
    let rows = rows(&points.combinations, &found);
    Ok(Swept { rows, complete, data_sha256: points.data_sha256 })
}

/// Records the data of the folder's views; refuses a folder of other data.
fn claim(out: &Path, sha256: &str) -> Result<(), Error> {
    let folder = out.join("data");
    let path = folder.join("source");
    let refuse = |why: &str| Err(Error::Sweep { why: why.to_owned(), path: out.to_owned() });
    if path.exists() {
        let found = fsio::read_capped(&path, limits::SETTINGS_BYTES)?;
        if String::from_utf8_lossy(&found).trim() == sha256 {
            return Ok(());
        }
        return refuse("the folder belongs to other data; choose another --out");
    }
    // A temporary file of an interrupted write is not a view.
    let named = |e: std::fs::DirEntry| !e.file_name().to_string_lossy().starts_with('.');
    if std::fs::read_dir(&folder).is_ok_and(|all| all.flatten().any(named)) {
        return refuse("the folder does not record its data; choose another --out");
    }
    Ok(fsio::write_atomic(&path, format!("{sha256}\n").as_bytes())?)
}

/// The result of a finished point; refuses one of other settings or data.
fn finished(
    dir: &Path,
    cfg: &TrainConfig,
    evaluations: u64,
    sha: &str,
) -> Result<Option<Reached>, Error> {
    let path = dir.join("result.json");
    if !path.exists() {
        return Ok(None);
    }
    let refuse = |why: &str| Err(Error::Sweep { why: why.to_owned(), path: path.clone() });
    let bytes = fsio::read_capped(&path, limits::SETTINGS_BYTES)?;
    let Ok(reached) = serde_json::from_slice::<Reached>(&bytes) else {
        return refuse("the result is damaged; remove it to measure the point again");
    };
    if read_config(dir)? != *cfg || reached.evaluations != evaluations {
        return refuse("the point was trained with other settings; choose another --out");
    }
    if reached.dataset_sha256 != sha {
        return refuse("the point was trained on other data; choose another --out");
    }
    Ok(Some(reached))
}
