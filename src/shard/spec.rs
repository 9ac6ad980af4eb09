//! The file that a person writes: what to do, over which values.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use robert_base::{fsio, limits};
use robert_explore::{AgentKind, CollectConfig, Preset};
use robert_robot::{PlantRange, Robot};
use robert_train::sweep::{Sweep, Value};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::Error;

/// One of the four kinds of work.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Spec {
    /// Motion to record; a shard is a part of the transitions.
    Collect(Collect),
    /// Clips to perform; a shard is one policy, one seed and some tasks.
    Eval(Eval),
    /// A grid of settings to train; a shard is one point with one seed.
    Sweep(Train),
    /// One setting to train with several seeds; a shard is one seed.
    Train(Train),
}

/// Only the kind.
#[derive(Deserialize)]
struct Head {
    kind: String,
}

/// `kind = "collect"`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Collect {
    kind: String,
    /// Robot id or folder.
    pub robot: String,
    /// Collectors with equal parts; without them the default for the robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agents: Option<Vec<AgentKind>>,
    /// Frames in all.
    pub transitions: u64,
    /// Number of shards; shard K has the seed `seed + K`.
    pub shards: usize,
    /// Seed of the first shard.
    #[serde(default)]
    pub seed: u64,
    /// Preset of the agents.
    #[serde(default = "url_fast")]
    pub preset: String,
    /// Changes of the preset.
    #[serde(default)]
    pub set: BTreeMap<String, Value>,
    /// Environment steps of training of each agent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent_steps: Option<u64>,
    /// Frames of an episode.
    #[serde(default = "episode_frames")]
    pub episode_frames: u64,
    /// Only snapshots from this first share of the training are rolled out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub snapshots_until: Option<f64>,
    /// Range of plants, as in `mass=0.8..1.2`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plants: Option<String>,
}

/// `kind = "eval"`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Eval {
    kind: String,
    /// Robot id or folder.
    pub robot: String,
    /// Built-in suites, `trial`, or folders of clips.
    pub suites: Vec<String>,
    /// Policies as they are typed.
    pub policies: Vec<String>,
    /// The seeds are 0 to `seeds` - 1.
    #[serde(default = "one")]
    pub seeds: u64,
    /// Plant or range of plants; each seed draws one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plant: Option<String>,
    /// Tasks of one suite that a shard performs.
    #[serde(default = "tasks_per_shard")]
    pub tasks_per_shard: usize,
}

/// `kind = "sweep"` and `kind = "train"`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Train {
    kind: String,
    /// Title of the table and the charts.
    #[serde(default)]
    pub title: String,
    /// Robot id or folder.
    pub robot: String,
    /// Dataset folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data: Option<PathBuf>,
    /// Motion that the plan records itself, instead of `data`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub collect: Option<Recording>,
    /// Preset that all runs start from.
    pub preset: String,
    /// Settings of all runs.
    #[serde(default)]
    pub set: BTreeMap<String, Value>,
    /// Values by setting; every combination is a point. Only for sweeps.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub grid: BTreeMap<String, Vec<Value>>,
    /// Seeds of every point.
    pub seeds: Vec<u64>,
    /// Setting on the x axis of the charts. Only for sweeps.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub x: String,
    /// Suites that each model performs.
    #[serde(default = "suites")]
    pub suites: Vec<String>,
    /// Tasks per suite extracted from data.
    #[serde(default = "cases")]
    pub cases: usize,
    /// Evaluations during a run, from which the best model is chosen; 0 keeps the last.
    #[serde(default)]
    pub evaluations: u64,
}

/// A small dataset that a plan records before anything else.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recording {
    /// Collectors that need no training; without them the default for the robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agents: Option<Vec<AgentKind>>,
    /// Frames.
    pub transitions: u64,
    /// Seed.
    #[serde(default)]
    pub seed: u64,
    /// Frames of an episode.
    #[serde(default = "episode_frames")]
    pub episode_frames: u64,
}

fn url_fast() -> String {
    "url-fast".to_owned()
}
fn episode_frames() -> u64 {
    250
}
fn one() -> u64 {
    1
}
fn tasks_per_shard() -> usize {
    10
}
fn suites() -> Vec<String> {
    vec!["manual".to_owned()]
}
fn cases() -> usize {
    12
}

impl Spec {
    /// Reads a spec.
    ///
    /// # Errors
    /// [`Error::Files`], [`Error::Spec`] with line and column.
    pub fn load(path: &Path) -> Result<Self, Error> {
        let text = fsio::read_capped(path, limits::SETTINGS_BYTES)?;
        let text = String::from_utf8_lossy(&text);
        let name = path.display().to_string();
        match read::<Head>(&text, &name)?.kind.as_str() {
            "collect" => Ok(Spec::Collect(read(&text, &name)?)),
            "eval" => Ok(Spec::Eval(read(&text, &name)?)),
            "sweep" => Ok(Spec::Sweep(read(&text, &name)?)),
            "train" => Ok(Spec::Train(read(&text, &name)?)),
            other => Err(Error::Spec {
                why: format!("kind = \"{other}\": use collect, eval, sweep or train"),
                place: name,
            }),
        }
    }

    /// The kind as it is written.
    pub fn kind(&self) -> &'static str {
        match self {
            Spec::Collect(_) => "collect",
            Spec::Eval(_) => "eval",
            Spec::Sweep(_) => "sweep",
            Spec::Train(_) => "train",
        }
    }

    /// Robot id or folder.
    pub fn robot(&self) -> &str {
        match self {
            Spec::Collect(c) => &c.robot,
            Spec::Eval(e) => &e.robot,
            Spec::Sweep(t) | Spec::Train(t) => &t.robot,
        }
    }
}

/// Reads one of the kinds; an error contains line and column.
fn read<T: DeserializeOwned>(text: &str, name: &str) -> Result<T, Error> {
    toml::from_str(text).map_err(|e| {
        let at = e.span().map_or(0, |s| s.start.min(text.len()));
        let before = text.get(..at).unwrap_or_default();
        let line = before.matches('\n').count() + 1;
        let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
        let why = e.message().replace('\n', " ");
        Error::Spec { why, place: format!("{name}:{line}:{column}") }
    })
}

impl<'de> Deserialize<'de> for Spec {
    fn deserialize<D: serde::Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        use serde::de::Error as _;
        let value = serde_json::Value::deserialize(d)?;
        let kind = value.get("kind").and_then(serde_json::Value::as_str).unwrap_or_default();
        let wrong = D::Error::custom;
        match kind {
            "collect" => serde_json::from_value(value).map(Spec::Collect).map_err(wrong),
            "eval" => serde_json::from_value(value).map(Spec::Eval).map_err(wrong),
            "sweep" => serde_json::from_value(value).map(Spec::Sweep).map_err(wrong),
            "train" => serde_json::from_value(value).map(Spec::Train).map_err(wrong),
            other => Err(D::Error::custom(format!("there is no kind of work \"{other}\""))),
        }
    }
}

impl Collect {
    /// The request for one shard, or for the whole.
    pub(super) fn config(
        &self,
        robot: &Robot,
        seed: u64,
        transitions: u64,
    ) -> Result<CollectConfig, Error> {
        let mut preset = Preset::named(&self.preset)?;
        if let Some(steps) = self.agent_steps {
            preset = preset.lasting(steps);
        }
        for (key, value) in &self.set {
            preset.set(&format!("{key}={value}"))?;
        }
        let plants = self.plants.as_deref().map(str::parse::<PlantRange>).transpose()?;
        let usual = CollectConfig::new(robot);
        Ok(CollectConfig {
            agents: self.agents.clone().unwrap_or(usual.agents),
            preset,
            transitions,
            seed,
            episode_frames: self.episode_frames,
            snapshots_until: self.snapshots_until.unwrap_or(usual.snapshots_until),
            plants,
            agents_from: None,
        })
    }
}

impl Eval {
    /// The plant or range of plants.
    pub(super) fn plant(&self) -> Result<PlantRange, Error> {
        Ok(self.plant.as_deref().map(str::parse).transpose()?.unwrap_or_default())
    }
}

impl Train {
    /// The same work as a sweep, whose grid may be empty.
    pub(super) fn sweep(&self) -> Sweep {
        Sweep {
            title: self.title.clone(),
            robot: self.robot.clone(),
            data: None,
            preset: self.preset.clone(),
            set: self.set.clone(),
            grid: self.grid.clone(),
            seeds: self.seeds.clone(),
            x: self.x.clone(),
            suites: self.suites.clone(),
            cases: self.cases,
            evaluations: self.evaluations,
        }
    }

    /// Refuses fields that belong to the other kind of work.
    pub(super) fn check(&self, place: &str) -> Result<(), Error> {
        let fail = |why: &str| Err(Error::Spec { why: why.to_owned(), place: place.to_owned() });
        let sweeps = self.kind == "sweep";
        if sweeps && !self.grid.contains_key(&self.x) {
            return fail("a sweep needs a [grid], and x names one of its settings");
        }
        if !sweeps && (!self.grid.is_empty() || !self.x.is_empty()) {
            return fail("grid and x are for kind = \"sweep\"");
        }
        if self.data.is_some() == self.collect.is_some() {
            return fail("name data = \"DIR\", or describe a recording in [collect]");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(text: &str) -> Result<Spec, Error> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.toml");
        std::fs::write(&path, text).unwrap();
        Spec::load(&path)
    }

    #[test]
    fn what_is_wrong_has_line_and_column() {
        let e = load("kind = \"eval\"\nrobot = \"ur5e\"\nsuite = [\"manual\"]\npolicies = []\n");
        let text = e.unwrap_err().to_string();
        assert!(text.contains("s.toml:3:1: ") && text.contains("suite"), "{text}");
        let text = load("kind = \"evil\"").unwrap_err().to_string();
        assert!(text.contains("collect, eval, sweep or train"), "{text}");
    }

    #[test]
    fn a_spec_survives_its_plan() {
        let text = "kind = \"sweep\"\nrobot = \"pointmass\"\npreset = \"pm-tiny\"\nseeds = [1]\n\
                    x = \"lr\"\n[grid]\nlr = [1e-3, 2.0]\n[collect]\ntransitions = 4000\n";
        let spec = load(text).unwrap();
        let json = serde_json::to_string(&spec).unwrap();
        assert_eq!(serde_json::from_str::<Spec>(&json).unwrap(), spec);
    }
}
