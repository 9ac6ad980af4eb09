//! Evaluation in shards: one policy, one seed, some tasks of a suite. The figures are those of
//! `robert eval` without floors; times are left out, so that equal work gives equal files.

use robert_base::json;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use robert_base::fsio;
use robert_base::progress::{Progress, Silent};
use robert_clip::Clip;
use robert_robot::Robot;
use robert_rollout::ClipFacts as _;
use robert_rollout::{
    Case, Contenders, EvalConfig, PolicyConfig, PolicyName, Rollout, RolloutConfig, Start, Suite,
    evaluate, in_order, tasks,
};
use serde_json::Value;

use super::context::Context;
use super::draft::{Draft, whole};
use super::plan::SHARDS;
use super::spec::Eval;
use super::{Cell, Error};

/// The rows of a shard.
pub(super) const ROWS: &str = "rows.json";
/// The suffix of clip files.
const SUFFIX: &str = ".clip.json";

/// A part of an evaluation; see [`Cell::Eval`].
#[derive(Debug)]
pub(super) struct Part<'a> {
    pub(super) suite: &'a str,
    pub(super) policy: &'a str,
    pub(super) seed: u64,
    pub(super) tasks: &'a [String],
    pub(super) clips_sha256: &'a str,
}

/// Makes the cells; every clip is checked against the robot and every policy is built.
pub(super) fn draft(
    spec: &Eval,
    robot: &Arc<Robot>,
    place: &str,
    progress: &dyn Progress,
) -> Result<Draft, Error> {
    let fail = |why: &str| Error::Spec { why: why.to_owned(), place: place.to_owned() };
    if spec.suites.is_empty() || spec.policies.is_empty() {
        return Err(fail("suites and policies need one entry or more"));
    }
    if spec.seeds == 0 || spec.tasks_per_shard == 0 {
        return Err(fail("seeds and tasks_per_shard take 1 or more"));
    }
    spec.plant()?;
    let mut draft = Draft::default();
    let mut policies = Vec::new();
    for text in &spec.policies {
        let text = whole_policy(text)?;
        let policy: PolicyConfig = text.parse()?;
        if policy.is_tried() {
            Contenders::new(robot, &policy)?;
        } else {
            policy.build(robot)?;
        }
        if let Some((_, sha256)) = policy.model_file(robot)? {
            draft.inputs.insert(format!("policy {text}"), sha256);
        }
        if policies.contains(&text) {
            return Err(fail(&format!("policy {text} is listed twice")));
        }
        policies.push(text);
    }
    let mut suites = Vec::new();
    for suite in &spec.suites {
        for suite in tasks::expand(suite) {
            let suite = whole(suite)?;
            if suites.contains(&suite) {
                return Err(fail(&format!("suite {suite} is listed twice")));
            }
            suites.push(suite.clone());
            let clips = clips(robot, &suite)?;
            progress.log(&format!("checking {} clips of {suite}", clips.len()));
            for (name, clip) in &clips {
                check(robot, name, clip)?;
            }
            let parts: Vec<(Vec<String>, String)> = clips
                .chunks(spec.tasks_per_shard)
                .map(|c| (c.iter().map(|(n, _)| n.clone()).collect(), fingerprint(c)))
                .collect();
            let more = (parts.len() * policies.len()) as u64;
            let count = spec.seeds.saturating_mul(more).saturating_add(draft.cells.len() as u64);
            if count > SHARDS as u64 {
                return Err(fail(&format!("{count} shards; 1 to {SHARDS} are allowed")));
            }
            for policy in &policies {
                for seed in 0..spec.seeds {
                    draft.cells.extend(parts.iter().map(|(tasks, sha)| Cell::Eval {
                        suite: suite.clone(),
                        policy: policy.clone(),
                        seed,
                        tasks: tasks.clone(),
                        clips_sha256: sha.clone(),
                    }));
                }
            }
        }
    }
    Ok(draft)
}

/// A policy as it is typed, with the absolute path of its model.
pub(super) fn whole_policy(text: &str) -> Result<String, Error> {
    let policy: PolicyConfig = text.parse()?;
    let Some(path) = policy.model_path.filter(|p| p.exists()) else { return Ok(text.to_owned()) };
    let real =
        path.canonicalize().map_err(|source| fsio::Error::Read { source, path: path.clone() })?;
    Ok(text.replacen(&*path.to_string_lossy(), &real.to_string_lossy(), 1))
}

/// All clips of a suite, by name.
fn clips(robot: &Robot, suite: &str) -> Result<Vec<(String, Clip)>, Error> {
    let dir = Path::new(suite);
    if !dir.is_dir() {
        return named(robot, suite);
    }
    let unreadable = |source| fsio::Error::Read { source, path: dir.to_owned() };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(unreadable)? {
        let name = entry.map_err(unreadable)?.file_name().to_string_lossy().into_owned();
        names.extend(name.strip_suffix(SUFFIX).map(str::to_owned));
    }
    names.sort();
    if names.is_empty() {
        let why = format!("there is no *{SUFFIX}");
        return Err(Error::Spec { why, place: suite.to_owned() });
    }
    names.into_iter().map(|name| in_folder(dir, name)).collect()
}

fn in_folder(dir: &Path, name: String) -> Result<(String, Clip), Error> {
    let clip = Clip::load(&dir.join(format!("{name}{SUFFIX}")))?;
    Ok((name, clip))
}

/// A built-in suite, or the trial clips of the robot.
fn named(robot: &Robot, suite: &str) -> Result<Vec<(String, Clip)>, Error> {
    if suite == "trial" {
        let trial = tasks::trial(robot, 0)?;
        return Ok(trial.into_iter().map(|t| (t.name.to_owned(), t.clip)).collect());
    }
    Ok(tasks::suite(robot.id(), suite)?)
}

/// Sha-256 of the content of clips.
fn fingerprint(clips: &[(String, Clip)]) -> String {
    let text: Vec<String> = clips.iter().map(|(n, c)| format!("{n} {}\n", c.to_json())).collect();
    fsio::sha256_hex(text.concat().as_bytes())
}

fn case(robot: &Robot, name: &str, clip: &Clip) -> Result<Case, Error> {
    let spec = |why: String| Error::Spec { why, place: format!("clip {name}") };
    let command = robot.compile(clip).map_err(|e| spec(e.to_string()))?;
    let command = in_order(robot, command).map_err(|e| spec(e.to_string()))?;
    Ok(Case { name: name.to_owned(), command, start: Start::Pose, truth: None, floor: None })
}

/// Refuses a clip that the robot cannot perform.
fn check(robot: &Arc<Robot>, name: &str, clip: &Clip) -> Result<(), Error> {
    let case = case(robot, name, clip)?;
    let policy = PolicyConfig::new(PolicyName::Zero).build(robot)?;
    Rollout::new(robot, policy, &case.command, case.start, RolloutConfig::default())?;
    Ok(())
}

/// The clips of a part.
fn clips_of(context: &Context, part: &Part<'_>) -> Result<Vec<(String, Clip)>, Error> {
    let dir = Path::new(part.suite);
    let found: Vec<(String, Clip)> = if dir.is_dir() {
        let each = part.tasks.iter().map(|name| in_folder(dir, name.clone()));
        each.collect::<Result<_, _>>()?
    } else {
        let mut known = context.suites.borrow_mut();
        if !known.contains_key(part.suite) {
            known.insert(part.suite.to_owned(), named(&context.robot, part.suite)?);
        }
        let all = known.get(part.suite).into_iter().flatten();
        all.filter(|(name, _)| part.tasks.contains(name)).cloned().collect()
    };
    if fingerprint(&found) != part.clips_sha256 {
        return Err(Error::Input { what: format!("a clip of {}", part.suite) });
    }
    Ok(found)
}

/// Performs a part and writes its rows; returns the number of rollouts that failed.
pub(super) fn perform(
    context: &Context,
    spec: &Eval,
    part: &Part<'_>,
    out: &Path,
) -> Result<u64, Error> {
    let policy: PolicyConfig = part.policy.parse()?;
    if !context.models.borrow().contains(part.policy) {
        let found = policy.model_file(&context.robot)?.map(|(_, sha256)| sha256);
        if found.as_ref() != context.plan.inputs.get(&format!("policy {}", part.policy)) {
            return Err(Error::Input { what: format!("the model of {}", part.policy) });
        }
        context.models.borrow_mut().insert(part.policy.to_owned());
    }
    let clips = clips_of(context, part)?;
    let cases = clips.iter().map(|(name, clip)| case(&context.robot, name, clip));
    let suite = Suite { name: part.suite.to_owned(), cases: cases.collect::<Result<Vec<_>, _>>()? };
    let config = EvalConfig {
        policies: vec![policy],
        plant: spec.plant()?,
        seeds: part.seed..part.seed + 1,
        threads: context.threads,
    };
    let found = evaluate(&context.robot, &[suite], &config, &Silent, &context.cancel)?;
    let tasks = found.iter().flat_map(|e| &e.tasks);
    let failed = tasks.clone().filter(|t| t.error.is_some()).count();
    let rows: Vec<Value> = tasks.map(|t| row(&json::value(t))).collect();
    let text = json::pretty(&rows) + "\n";
    let path = out.join(ROWS);
    std::fs::write(&path, text).map_err(super::error::write_error(&path))?;
    Ok(failed as u64)
}

/// A row without times, and without what a single seed does not have.
fn row(task: &Value) -> Value {
    let fields = task.as_object().cloned().unwrap_or_default();
    let kept: BTreeMap<String, Value> =
        fields.into_iter().filter(|(k, v)| k != "wall_secs" && !v.is_null()).collect();
    json::value(kept)
}
