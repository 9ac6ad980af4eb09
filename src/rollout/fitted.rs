//! Files of the policies that are fitted without a network: `nearest` and `mlp-inverse`.
//!
//! A safetensors file with a JSON card in its header, like a model. Each policy defines the content
//! of the card and its tensors. Everything is checked before a number is used, since such files are
//! foreign data.

use std::collections::BTreeMap;
use std::path::Path;

use safetensors::tensor::SafeTensors;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use robert_base::fsio;
use robert_base::limits;
use robert_base::units::Unit;
use robert_dataset::{self as dataset, Dataset, Part};
use robert_net::tensors::{self, Out};
use robert_net::{self as net, Facts, JointFacts, Normaliser, RobotCard, checkpoint};

/// Value of `format`.
const FORMAT: &str = "robert-fit/1";
/// Key of the card in the header's metadata.
const CARD: &str = "robert-fit";

/// The kind of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FitKind {
    /// Recorded frames for retrieval.
    Nearest,
    /// A small network of three frames.
    MlpInverse,
}

impl FitKind {
    /// Its name on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            FitKind::Nearest => "nearest",
            FitKind::MlpInverse => "mlp-inverse",
        }
    }

    /// Default name of its file in the data's folder.
    pub fn file(self) -> &'static str {
        match self {
            FitKind::Nearest => "nearest.safetensors",
            FitKind::MlpInverse => "mlp-inverse.safetensors",
        }
    }
}

/// Everything about a fit except its numbers; `T` contains the settings of its kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FitCard<T> {
    /// The format and its version.
    pub format: String,
    /// The kind of the fit.
    pub kind: FitKind,
    /// Robot of the data.
    pub robot: RobotCard,
    /// Whether a joint turns, and its stops.
    pub joints: Vec<JointFacts>,
    /// Spread of the frames fitted to.
    pub normaliser: Normaliser,
    /// Sha-256 of the dataset's manifest.
    pub dataset_sha256: String,
    /// Seed of split and draws.
    pub seed: u64,
    /// Sizes and settings of this kind.
    pub settings: T,
}

impl<T: Serialize + DeserializeOwned> FitCard<T> {
    /// The card of a fit to the training part of a dataset.
    pub fn of(kind: FitKind, data: &Dataset, seed: u64, settings: T) -> Self {
        let robot = &data.manifest().robot;
        FitCard {
            format: FORMAT.to_owned(),
            kind,
            robot: card_of(robot),
            joints: facts(robot).joints,
            normaliser: normaliser(data, seed).0,
            dataset_sha256: data.manifest().sha256(),
            seed,
            settings,
        }
    }

    /// State joints S.
    pub fn state(&self) -> usize {
        self.robot.joints.len()
    }

    /// Actuators A.
    pub fn actions(&self) -> usize {
        self.robot.actuators.len()
    }

    /// Writes card and tensors, atomically.
    ///
    /// # Errors
    /// [`net::Error::Files`], [`net::Error::File`].
    pub(super) fn save(
        &self,
        path: &Path,
        tensors: &BTreeMap<String, Out<'_>>,
    ) -> Result<(), net::Error> {
        let damaged = |e: serde_json::Error| file_error(e.to_string(), path);
        let json = serde_json::to_string(self).map_err(damaged)?;
        let metadata = BTreeMap::from([(CARD.to_owned(), json)]);
        let bytes = tensors::serialise(tensors, &metadata).map_err(damaged)?;
        Ok(fsio::write_atomic(path, &bytes)?)
    }

    /// Reads and checks a card from a file's bytes; `robot`, when given, must be its robot.
    ///
    /// # Errors
    /// [`net::Error::File`] with the reason, [`net::Error::Robot`].
    pub(super) fn parse(
        bytes: &[u8],
        kind: FitKind,
        robot: Option<&RobotCard>,
        path: &Path,
    ) -> Result<Self, net::Error> {
        let card: Self = read(bytes, kind).map_err(|why| file_error(why, path))?;
        if let Some(given) = robot {
            checkpoint::same_robot(&card.robot, given, path)?;
        }
        card.check().map_err(|why| file_error(why, path))?;
        Ok(card)
    }

    fn check(&self) -> Result<(), String> {
        let (s, a) = (self.state(), self.actions());
        if s == 0 || a == 0 || s > limits::JOINTS || a > limits::JOINTS {
            return Err(format!("{s} joints and {a} actuators"));
        }
        if self.joints.len() != s {
            return Err("joint names and joint facts of different numbers".to_owned());
        }
        let n = &self.normaliser;
        let columns = [("mean", &n.mean), ("std", &n.std), ("d1", &n.std_d1), ("d2", &n.std_d2)];
        for (what, x) in columns {
            if x.len() != s {
                return Err(format!("{} values of {what} for {s} joints", x.len()));
            }
            if x.iter().any(|x| !x.is_finite() || (what != "mean" && *x <= 0.0)) {
                return Err(format!("a normaliser whose {what} is not positive and finite"));
            }
        }
        Ok(())
    }
}

fn read<T: DeserializeOwned>(bytes: &[u8], kind: FitKind) -> Result<FitCard<T>, String> {
    let length = bytes.get(..8).and_then(|b| b.try_into().ok()).map_or(0, u64::from_le_bytes);
    if length > limits::TENSOR_HEADER_BYTES {
        return Err(format!("a header of {length} bytes"));
    }
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| e.to_string())?;
    let metadata = header.metadata().clone().unwrap_or_default();
    let text = metadata.get(CARD).ok_or("no card (metadata key \"robert-fit\")")?;
    let json: serde_json::Value =
        serde_json::from_str(text).map_err(|e| format!("a card that is not JSON ({e})"))?;
    let word = |key: &str| json.get(key).and_then(|f| f.as_str()).unwrap_or("nothing").to_owned();
    if word("format") != FORMAT {
        return Err(format!("format {:?} instead of {FORMAT:?}", word("format")));
    }
    if word("kind") != kind.as_str() {
        return Err(format!("a fit of {:?}, not of {:?}", word("kind"), kind.as_str()));
    }
    serde_json::from_value(json).map_err(|e| format!("a bad card: {e}"))
}

/// The facts about the robot of a dataset that the features need.
pub fn facts(robot: &dataset::Robot) -> Facts {
    let joints = robot.units.iter().zip(&robot.ranges);
    Facts {
        joints: joints
            .map(|(&unit, &range)| JointFacts { hinge: unit == Unit::Rad, range })
            .collect(),
        actions: robot.actuators.len(),
    }
}

/// The robot of a dataset as a model card names it.
pub fn card_of(robot: &dataset::Robot) -> RobotCard {
    RobotCard {
        id: robot.id.clone(),
        model_sha256: robot.model_sha256.clone(),
        joints: robot.joints.clone(),
        actuators: robot.actuators.clone(),
    }
}

/// The network's normaliser for the training split, and the variance of actions.
pub fn normaliser(data: &Dataset, seed: u64) -> (Normaliser, f64) {
    let n = dataset::Normaliser::fit(data, &data.part(Part::Train, seed));
    let floor = |x: &[f64], least: f64| x.iter().map(|x| x.max(least)).collect();
    // A joint that never moves in the data must not get a huge scale.
    let norm = Normaliser {
        mean: n.qpos.mean,
        std: floor(&n.qpos.std, 1e-3),
        std_d1: floor(&n.d1.std, 1e-5),
        std_d2: floor(&n.d2.std, 1e-6),
    };
    let power = n.ctrl.std.iter().map(|s| s * s).sum::<f64>() / n.ctrl.std.len().max(1) as f64;
    (norm, power)
}

/// Tensors of a file, with their names checked against what must be there.
pub(super) fn tensors_of<'a>(
    bytes: &'a [u8],
    known: &[String],
    path: &Path,
) -> Result<SafeTensors<'a>, net::Error> {
    let file = SafeTensors::deserialize(bytes).map_err(|e| file_error(e.to_string(), path))?;
    for name in file.names() {
        if !known.iter().any(|k| k == name) {
            return Err(file_error(format!("an unknown tensor {name:?}"), path));
        }
    }
    Ok(file)
}

pub(super) fn file_error(why: String, path: &Path) -> net::Error {
    net::Error::File { why, path: path.to_owned() }
}

/// Scales from radians (or metres) to units of typical motion, for the distances and inputs
/// of both policies.
#[derive(Clone, Debug)]
pub(super) struct Scales {
    /// Mean position, (S).
    pub(super) mean: Vec<f32>,
    /// 1 / spread of positions, in 1/rad or 1/m; 0 for a joint whose position has no effect; (S).
    pub(super) place: Vec<f32>,
    /// 1 / spread of the change in one frame, in 1/rad or 1/m; (S).
    pub(super) way: Vec<f32>,
}

impl Scales {
    pub(super) fn new<T>(card: &FitCard<T>) -> Self {
        let n = &card.normaliser;
        let inverse = |x: &f64| (1.0 / x) as f32;
        let floats = |j: &JointFacts| !j.hinge && j.range.is_none();
        Scales {
            mean: n.mean.iter().map(|&x| x as f32).collect(),
            place: n
                .std
                .iter()
                .zip(&card.joints)
                .map(|(s, j)| if floats(j) { 0.0 } else { inverse(s) })
                .collect(),
            way: n.std_d1.iter().map(inverse).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::inverse::{Inverse, InverseSettings};
    use super::super::nearest::{Nearest, NearestSettings};
    use super::*;
    use robert_base::rng::{Rng, Stream};
    use robert_net::tensors::with_header;

    const S: usize = 2;
    const A: usize = 3;

    fn card<T: Serialize + DeserializeOwned>(kind: FitKind, settings: T) -> FitCard<T> {
        let names = |prefix: &str, n: usize| (0..n).map(|i| format!("{prefix}{i}")).collect();
        let spread = vec![0.5; S];
        FitCard {
            format: FORMAT.to_owned(),
            kind,
            robot: RobotCard {
                id: "toy".into(),
                model_sha256: "ab".repeat(32),
                joints: names("j", S),
                actuators: names("m", A),
            },
            joints: vec![JointFacts { hinge: true, range: Some([-1.0, 1.0]) }; S],
            normaliser: Normaliser {
                mean: vec![0.1; S],
                std: spread.clone(),
                std_d1: spread.clone(),
                std_d2: spread,
            },
            dataset_sha256: "cd".repeat(32),
            seed: 3,
            settings,
        }
    }

    fn nearest() -> Nearest {
        let lengths = vec![60, 70];
        let mut rng = Rng::new(1, Stream::Test, 0);
        let mut numbers =
            |n: usize| (0..n).map(|_| rng.range(-0.9, 0.9) as f32).collect::<Vec<f32>>();
        let (qpos, ctrl) = (numbers(130 * S), numbers(130 * A));
        Nearest::new(card(FitKind::Nearest, NearestSettings::new(lengths)), &qpos, ctrl).unwrap()
    }

    fn inverse() -> Inverse {
        let settings = InverseSettings { width: 8, ..InverseSettings::default() };
        Inverse::new(card(FitKind::MlpInverse, settings)).unwrap()
    }

    type Load = fn(&Path, Option<&RobotCard>) -> Result<(), net::Error>;

    /// A good file of each kind, its loader, and a tensor in it.
    fn files() -> Vec<(Vec<u8>, Load, &'static str)> {
        let dir = tempfile::tempdir().unwrap();
        let (a, b) = (dir.path().join("a"), dir.path().join("b"));
        nearest().save(&a).unwrap();
        inverse().save(&b).unwrap();
        let read = |p| std::fs::read(p).unwrap();
        vec![
            (read(a), |p, r| Nearest::load(p, r).map(|_| ()), "qpos"),
            (read(b), |p, r| Inverse::load(p, r).map(|_| ()), "layer0.weight"),
        ]
    }

    fn refusal(load: Load, bytes: &[u8]) -> net::Error {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("fit.safetensors");
        std::fs::write(&path, bytes).unwrap();
        let e = load(&path, None).unwrap_err();
        assert_eq!(robert_base::exit::HasExit::exit(&e), robert_base::exit::Exit::Invalid, "{e}");
        assert!(e.to_string().contains("fit.safetensors"), "{e}");
        e
    }

    /// The file with another card.
    fn recarded(bytes: &[u8], change: impl FnOnce(&mut serde_json::Value)) -> Vec<u8> {
        with_header(bytes, |h| {
            let text = h["__metadata__"][CARD].as_str().unwrap();
            let mut card: serde_json::Value = serde_json::from_str(text).unwrap();
            change(&mut card);
            h["__metadata__"][CARD] = card.to_string().into();
        })
        .unwrap()
    }

    #[test]
    fn a_file_comes_back_as_it_was() {
        let dir = tempfile::tempdir().unwrap();
        let (a, b) = (dir.path().join("a"), dir.path().join("b"));
        for (bytes, load, _) in files() {
            std::fs::write(&a, &bytes).unwrap();
            load(&a, Some(&nearest().card().robot)).unwrap();
        }
        nearest().save(&a).unwrap();
        Nearest::load(&a, None).unwrap().save(&b).unwrap();
        assert_eq!(std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap());
        inverse().save(&a).unwrap();
        Inverse::load(&a, None).unwrap().save(&b).unwrap();
        assert_eq!(std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap());
    }

    #[test]
    fn damaged_files_are_refused_with_the_reason() {
        for (good, load, tensor) in files() {
            let says = |bytes: &[u8], words: &str| {
                let e = refusal(load, bytes).to_string();
                assert!(e.contains(words), "{e} should speak of {words}");
            };
            for cut in (0..good.len()).step_by(211).chain([good.len() - 1]) {
                refusal(load, &good[..cut]);
            }
            let mut nan = good.clone();
            let end = nan.len();
            nan[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
            says(&nan, "NaN");
            let mut huge = good.clone();
            huge[..8].copy_from_slice(&u64::MAX.to_le_bytes());
            says(&huge, "header");
            let vast =
                with_header(&good, |h| h[tensor]["shape"] = serde_json::json!([1_u64 << 60]));
            refusal(load, &vast.unwrap());
            says(&with_header(&good, |h| h[tensor]["dtype"] = "I32".into()).unwrap(), "type");
            let renamed = with_header(&good, |h| {
                let t = h[tensor].take();
                h.as_object_mut().unwrap().remove(tensor);
                h["other"] = t;
            })
            .unwrap();
            says(&renamed, "unknown tensor \"other\"");
            says(
                &with_header(&good, |h| h["__metadata__"] = serde_json::json!({})).unwrap(),
                "no card",
            );
            says(&recarded(&good, |c| c["format"] = "robert-fit/9".into()), "robert-fit/9");
            says(&recarded(&good, |c| c["kind"] = "ridge".into()), "ridge");
            says(&recarded(&good, |c| c["extra"] = 1.into()), "extra");
            says(&recarded(&good, |c| c["joints"] = serde_json::json!([])), "different numbers");
            says(&recarded(&good, |c| c["robot"]["joints"] = serde_json::json!([])), "0 joints");
            let many: Vec<String> = (0..=limits::JOINTS).map(|i| i.to_string()).collect();
            says(&recarded(&good, |c| c["robot"]["joints"] = serde_json::json!(many)), "joints");
            says(&recarded(&good, |c| c["normaliser"]["std"][0] = 0.into()), "not positive");
            says(&recarded(&good, |c| c["robot"]["actuators"] = serde_json::json!(["a"])), "shape");
        }
    }

    #[test]
    fn sizes_that_are_absurd_are_refused() {
        let all = files();
        let (bytes, load, _) = &all[0];
        for (key, value) in [
            ("neighbours", serde_json::json!(0)),
            ("neighbours", serde_json::json!(1_000_000)),
            ("place", serde_json::json!(-1.0)),
            ("lengths", serde_json::json!([])),
            ("lengths", serde_json::json!([130, 0])),
            ("lengths", serde_json::json!([60, 71])),
            ("lengths", serde_json::json!([u64::MAX, u64::MAX])),
        ] {
            refusal(*load, &recarded(bytes, |c| c["settings"][key] = value));
        }
        let mut wild = bytes.clone();
        let n = u64::from_le_bytes(wild[..8].try_into().unwrap()) as usize + 8;
        // The first tensor by name is `ctrl`.
        wild[n..n + 4].copy_from_slice(&1.5_f32.to_le_bytes());
        assert!(refusal(*load, &wild).to_string().contains("beyond"));
        let (bytes, load, _) = &all[1];
        for width in [0_u64, 1 << 40] {
            refusal(*load, &recarded(bytes, |c| c["settings"]["width"] = width.into()));
        }
    }

    #[test]
    fn flipped_bytes_never_panic() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f");
        for (good, load, _) in files() {
            let n = u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
            for index in 0..300 {
                let mut rng = Rng::new(6, Stream::Test, index);
                let mut bad = good.clone();
                for _ in 0..=rng.below(3) {
                    bad[rng.below((n + 8) as u64) as usize] = rng.next_u64() as u8;
                }
                std::fs::write(&path, &bad).unwrap();
                load(&path, None).ok();
            }
        }
    }

    #[test]
    fn another_robot_is_refused_by_name() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f");
        for (good, load, _) in files() {
            std::fs::write(&path, &good).unwrap();
            let mut other = nearest().card().robot.clone();
            other.model_sha256 = "ef".repeat(32);
            let e = load(&path, Some(&other)).unwrap_err();
            assert!(matches!(e, net::Error::Robot { .. }), "{e}");
            let mut other = nearest().card().robot.clone();
            other.joints.reverse();
            assert!(load(&path, Some(&other)).unwrap_err().to_string().contains("j1, j0"));
        }
    }
}
