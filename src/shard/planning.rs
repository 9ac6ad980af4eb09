//! Makes a plan: reads the spec, checks every cell, and hashes what the cells read.
//!
//! A mistake that shows only in the queue costs a day. So every policy is built, every clip is
//! given to the robot, every setting is checked and the data are verified here.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use robert_base::fsio;
use robert_base::progress::{Progress, Silent};
use robert_robot::Robot;

use super::draft::{Draft, fingerprint, whole};
use super::error::write_error;
use super::plan::{FORMAT, SHARDS};
use super::spec::Train;
use super::{Error, Machine, Plan, Spec, collecting, evaluating, training};

/// Plans `spec` into the folder `out`. With `numerics` (`avx2`), all machines limit themselves to
/// that kind of arithmetic.
///
/// # Errors
/// Any error that a cell would meet later, with the exit code of its cause. Nothing is written
/// then.
pub fn make(
    path: &Path,
    out: &Path,
    numerics: Option<&str>,
    progress: &dyn Progress,
) -> Result<Plan, Error> {
    let spec = Spec::load(path)?;
    let place = path.display().to_string();
    let limited = numerics.is_some();
    if limited && !robert_linalg::limit_to_avx2() {
        return Err(Error::NoAvx2);
    }
    let machine = Machine::here()?;
    let robot = Arc::new(Robot::load(spec.robot())?);
    let mut draft: Draft = match &spec {
        Spec::Collect(collect) => collecting::draft(collect, &robot, &place)?,
        Spec::Eval(eval) => evaluating::draft(eval, &robot, &place, progress)?,
        Spec::Sweep(train) | Spec::Train(train) => {
            train.check(&place)?;
            // The settings first: recording data takes time.
            train.sweep().check(path)?;
            let data = data_of(train, &robot, out)?;
            training::draft(train, &robot, &data, out)?
        }
    };
    if draft.cells.is_empty() || draft.cells.len() > SHARDS {
        let why = format!("{} shards; 1 to {SHARDS} are allowed", draft.cells.len());
        return Err(Error::Spec { why, place });
    }
    draft.inputs.insert("robot".to_owned(), fingerprint(&robot)?);
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let plan = Plan {
        format: FORMAT.to_owned(),
        name,
        spec: anchored(spec)?,
        numerics: machine.numerics,
        limited,
        binary_sha256: machine.binary_sha256,
        data: draft.data,
        inputs: draft.inputs,
        cells: draft.cells,
    };
    for i in (0..plan.shards()).step_by(1000) {
        let parent = plan.parent_of(out, i);
        std::fs::create_dir_all(&parent).map_err(write_error(&parent))?;
    }
    plan.save(out)?;
    Ok(plan)
}

/// The spec with absolute paths, so that it means the same wherever a shard runs.
fn anchored(mut spec: Spec) -> Result<Spec, Error> {
    let robot = match &mut spec {
        Spec::Collect(c) => &mut c.robot,
        Spec::Eval(e) => &mut e.robot,
        Spec::Sweep(t) | Spec::Train(t) => &mut t.robot,
    };
    *robot = whole(robot)?;
    if let Spec::Eval(e) = &mut spec {
        for suite in &mut e.suites {
            *suite = whole(suite)?;
        }
        for policy in &mut e.policies {
            *policy = evaluating::whole_policy(policy)?;
        }
    }
    Ok(spec)
}

/// The dataset of a training plan: the named one, or one that is recorded now.
fn data_of(train: &Train, robot: &Arc<Robot>, out: &Path) -> Result<PathBuf, Error> {
    let Some(recording) = &train.collect else {
        let data = train.data.clone().unwrap_or_default();
        return Ok(data
            .canonicalize()
            .map_err(|source| fsio::Error::Read { source, path: data.clone() })?);
    };
    collecting::record(recording, robot, out, &Silent)
}
