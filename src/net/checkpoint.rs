//! The model file: one safetensors file with a JSON model card in its header.
//!
//! A safetensors loader cannot be made to run code or to read past the file, and every framework
//! opens the format. Foreign files are checked before a number is used: header size, overlaps and
//! holes, names, shapes, types, finite weights, and that robot, joints and sizes are the expected
//! ones.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

use half::f16;
use safetensors::tensor::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};

use super::config::{COMMAND, HISTORY};
use super::model::Net;
use super::params::Layout;
use super::reach::Reach;
use super::ridge::Ridge;
use super::step::Learner;
use super::tensors::{self, Out};
use super::token::{Facts, Normaliser, RIDGE_HEADS, TokenConfig, Tokeniser};
use super::{Encoder, Error, MaskGranularity, NetConfig, SkipKind};
use robert_base::fsio;
use robert_base::limits;

/// Value of `format`.
pub const FORMAT: &str = "robert-model/1";
/// Key of the card in the header's metadata.
const CARD: &str = "robert";
/// Prefix of the names of the optimiser's tensors.
const STATE: [&str; 3] = ["adam.first.", "adam.second.", "average."];

/// The robot that a model drives.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotCard {
    /// Name of the robot.
    pub id: String,
    /// Sha-256 of its MJCF.
    pub model_sha256: String,
    /// State joints in order.
    pub joints: Vec<String>,
    /// Actuators in order.
    pub actuators: Vec<String>,
}

/// The window a model reads.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WindowCard {
    /// Frames before the current one.
    pub history: usize,
    /// The current frame.
    pub current: usize,
    /// Commanded frames.
    pub command: usize,
    /// Frames per second.
    pub rate_hz: u32,
}

/// The simulation that produced the data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhysicsCard {
    /// Simulator step, s.
    pub dt: f64,
    /// Simulator steps in a frame.
    pub substeps: usize,
    /// Integrator.
    pub integrator: String,
    /// Friction cone.
    pub cone: String,
}

/// The usual range and speed of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Usual {
    /// 1 of 100 frames is below, rad or m.
    pub low: f64,
    /// 1 of 100 frames is above, rad or m.
    pub high: f64,
    /// 1 of 100 frames is faster, rad/s or m/s.
    pub speed: f64,
}

/// The training of a model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingCard {
    /// Sha-256 of the dataset's manifest.
    pub dataset_sha256: String,
    /// Transitions of the dataset by the agent that made them; empty in files of older programs.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub agents: BTreeMap<String, u64>,
    /// Resolved settings.
    pub config: serde_json::Value,
    /// Seed.
    pub seed: u64,
    /// Steps taken.
    pub step: u64,
    /// Precision by suite, if it was measured.
    pub precision: BTreeMap<String, f64>,
    /// Notes for people: data, commands, limits.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub notes: String,
}

/// Everything about a model except its numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// [`FORMAT`].
    pub format: String,
    /// Robot.
    pub robot: RobotCard,
    /// Window.
    pub window: WindowCard,
    /// Simulation.
    pub physics: PhysicsCard,
    /// Sizes.
    pub net: NetConfig,
    /// Features.
    pub tokens: TokenConfig,
    /// The masks that the model was trained with; the studio offers per-joint masks accordingly.
    pub mask_granularity: MaskGranularity,
    /// The facts about the robot that the features use.
    pub facts: Facts,
    /// Normaliser of the training split.
    pub normaliser: Normaliser,
    /// The usual range of each joint in the training split; empty in files of older programs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub usual: Vec<Usual>,
    /// The effect of actions, and the usual speeds; a policy without it uses goals unchanged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<Reach>,
    /// Meaning of the actions.
    pub action: String,
    /// Training record.
    pub training: TrainingCard,
}

impl Card {
    /// A card for a network of this process, with the standard window, physics and action.
    pub fn new(
        robot: RobotCard,
        net: NetConfig,
        tokens: &Tokeniser,
        normaliser: Normaliser,
        training: TrainingCard,
    ) -> Self {
        Card {
            format: FORMAT.into(),
            robot,
            window: WindowCard {
                history: HISTORY,
                current: 1,
                command: COMMAND,
                rate_hz: robert_base::units::FPS,
            },
            physics: PhysicsCard {
                dt: robert_base::units::SIM_DT,
                substeps: robert_base::units::SUBSTEPS,
                integrator: "Euler".into(),
                cone: "pyramidal".into(),
            },
            net,
            mask_granularity: tokens.config().granularity,
            tokens: tokens.config().clone(),
            facts: tokens.facts().clone(),
            normaliser,
            usual: Vec::new(),
            reach: None,
            action: "[-1, 1] scaled to ctrlrange".into(),
            training,
        }
    }
}

/// Number of standard deviations on each side of the mean that covers 98 of 100 frames, for files
/// with only these. Joints stay inside their limits, so their tails are short.
const SIDE_STD: f64 = 2.0;
/// Number of standard deviations of speed that 99 of 100 frames stay below.
const SPEED_STD: f64 = 2.58;

impl Card {
    /// The masks that a policy with this model accepts: also single joints, if gaps are filled
    /// before the network sees them.
    pub fn masks(&self) -> MaskGranularity {
        if self.reach.is_some() { MaskGranularity::Joint } else { self.mask_granularity }
    }

    /// The usual range of each joint in the training split, (S); estimated from mean and spread if
    /// the file does not say.
    pub fn usual(&self) -> Vec<Usual> {
        let n = &self.normaliser;
        if self.usual.len() == n.mean.len() {
            return self.usual.clone();
        }
        let each = n.mean.iter().zip(&n.std).zip(&n.std_d1);
        each.map(|((mean, std), step)| Usual {
            low: mean - SIDE_STD * std,
            high: mean + SIDE_STD * std,
            speed: SPEED_STD * step / robert_base::units::CTRL_DT,
        })
        .collect()
    }
}

/// Moments and step of the optimiser, which resuming needs besides the weights. Random numbers and
/// the data cursor are functions of seed and step.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimiserState {
    /// First moment, laid out as the weights.
    pub first: Vec<f32>,
    /// Second moment.
    pub second: Vec<f32>,
    /// Running average of the weights, if there is one.
    pub average: Option<Vec<f32>>,
    /// Steps applied.
    pub count: u64,
}

/// A model read from a file.
#[derive(Clone, Debug)]
pub struct Model {
    /// The card.
    pub card: Card,
    /// The network.
    pub net: Net<f32>,
    /// Features and linear prediction.
    pub encoder: Encoder,
    /// Present in training checkpoints.
    pub optimiser: Option<OptimiserState>,
}

/// Writes a model, atomically; with `optimiser` it can be resumed exactly.
///
/// # Errors
/// [`Error::Files`], [`Error::File`].
pub fn save(
    path: &Path,
    card: &Card,
    net: &Net<f32>,
    ridge: Option<&Ridge>,
    optimiser: Option<&OptimiserState>,
) -> Result<(), Error> {
    let damaged = |why: String| Error::File { why, path: path.to_owned() };
    let mut all = BTreeMap::new();
    for t in &net.layout.tensors {
        let data = &net.weights[t.range.clone()];
        all.insert(t.name.clone(), Out::new(&t.shape, data));
        if let Some(state) = optimiser {
            let average = state.average.as_deref().map(|a| ("average.", a));
            let moments = [("adam.first.", &state.first[..]), ("adam.second.", &state.second)];
            for (prefix, moment) in moments.into_iter().chain(average) {
                let data = &moment[t.range.clone()];
                all.insert(format!("{prefix}{}", t.name), Out::new(&t.shape, data));
            }
        }
    }
    add_fixed(&mut all, card, net, ridge);
    let json = serde_json::to_string(card).map_err(|e| damaged(e.to_string()))?;
    let mut metadata = BTreeMap::from([(CARD.to_owned(), json)]);
    if let Some(state) = optimiser {
        metadata.insert("adam.count".into(), state.count.to_string());
    }
    let bytes = tensors::serialise(&all, &metadata).map_err(|e| damaged(e.to_string()))?;
    Ok(fsio::write_atomic(path, &bytes)?)
}

/// Reads the card alone, without the numbers.
///
/// # Errors
/// As [`load`].
pub fn read_card(path: &Path) -> Result<Card, Error> {
    card(&read_file(path)?, path)
}

fn read_file(path: &Path) -> Result<Vec<u8>, Error> {
    if path.is_dir() {
        return Err(Error::NoModel { path: path.to_owned() });
    }
    Ok(fsio::read_capped(path, limits::TENSOR_FILE_BYTES)?)
}

/// [`read_card`] from memory; `path` is for messages.
///
/// # Errors
/// [`Error::File`].
pub fn card(bytes: &[u8], path: &Path) -> Result<Card, Error> {
    let damaged = |why: String| Error::File { why, path: path.to_owned() };
    parse_card(bytes).map(|(card, _)| card).map_err(damaged)
}

/// Writes a small model file: weights of the network in half precision, the linear prediction and
/// the centres in full precision (their rounding would show in every action).
///
/// # Errors
/// [`Error::Files`], [`Error::File`].
pub fn save_half(path: &Path, model: &Model) -> Result<(), Error> {
    let damaged = |why: String| Error::File { why, path: path.to_owned() };
    let net = &model.net;
    let halves: Vec<f16> = net.weights.iter().map(|&w| f16::from_f32(w)).collect();
    let mut all = BTreeMap::new();
    for t in &net.layout.tensors {
        all.insert(t.name.clone(), Out::half(&t.shape, &halves[t.range.clone()]));
    }
    add_fixed(&mut all, &model.card, net, model.encoder.ridge.as_ref());
    let json = serde_json::to_string(&model.card).map_err(|e| damaged(e.to_string()))?;
    let metadata = BTreeMap::from([(CARD.to_owned(), json)]);
    let bytes = tensors::serialise(&all, &metadata).map_err(|e| damaged(e.to_string()))?;
    Ok(fsio::write_atomic(path, &bytes)?)
}

/// The tensors that are not weights of the network: bin centres and the linear prediction.
fn add_fixed<'a>(
    all: &mut BTreeMap<String, Out<'a>>,
    card: &Card,
    net: &'a Net<f32>,
    ridge: Option<&'a Ridge>,
) {
    let centres = Out::new(&[net.cfg.bins, net.cfg.actions], &net.centres);
    all.insert("centres".into(), centres);
    if let Some(ridge) = ridge {
        let actions = card.facts.actions;
        let inputs = ridge.weights().len() / (RIDGE_HEADS * actions).max(1);
        let shape = [RIDGE_HEADS, inputs, actions];
        all.insert("ridge".into(), Out::new(&shape, ridge.weights()));
    }
}

fn parse_card(bytes: &[u8]) -> Result<(Card, HashMap<String, String>), String> {
    let length = bytes.get(..8).and_then(|b| b.try_into().ok()).map_or(0, u64::from_le_bytes);
    if length > limits::TENSOR_HEADER_BYTES {
        return Err(format!("a header of {length} bytes"));
    }
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| e.to_string())?;
    let metadata = header.metadata().clone().unwrap_or_default();
    let text = metadata.get(CARD).ok_or("no model card (metadata key \"robert\")")?;
    let format = serde_json::from_str::<serde_json::Value>(text)
        .map_err(|e| format!("a model card that is not JSON ({e})"))?;
    let found = format.get("format").and_then(|f| f.as_str()).unwrap_or("no format").to_owned();
    if found != FORMAT {
        return Err(format!("format {found:?} instead of {FORMAT:?}"));
    }
    let card = serde_json::from_str(text).map_err(|e| format!("a bad model card: {e}"))?;
    Ok((card, metadata))
}

/// Loads a model, checking everything; `robot`, when given, must be the one it was trained
/// for.
///
/// # Errors
/// [`Error::Files`], [`Error::File`] with the reason, [`Error::Robot`], [`Error::Config`].
pub fn load(path: &Path, robot: Option<&RobotCard>) -> Result<Model, Error> {
    parse(&read_file(path)?, path, robot)
}

/// [`load`] from memory; `path` is for messages.
///
/// # Errors
/// As [`load`].
pub fn parse(bytes: &[u8], path: &Path, robot: Option<&RobotCard>) -> Result<Model, Error> {
    let damaged = |why: String| Error::File { why, path: path.to_owned() };
    let (card, metadata) = parse_card(bytes).map_err(damaged)?;
    if let Some(given) = robot {
        same_robot(&card.robot, given, path)?;
    }
    check_card(&card).map_err(damaged)?;
    card.net.check()?;
    let file = SafeTensors::deserialize(bytes).map_err(|e| damaged(e.to_string()))?;
    if let Some(reach) = &card.reach {
        reach.check(&card.facts)?;
    }
    let tokens = Tokeniser::new(card.tokens.clone(), card.facts.clone(), &card.normaliser)?;

    let layout = Layout::new(&card.net);
    // Memory for the weights is allocated only if the file is large enough for them in half
    // precision.
    let count = layout.count();
    if count > bytes.len() / 2 {
        let why = format!("{} bytes are too few for the {count} weights of its card", bytes.len());
        return Err(damaged(why));
    }
    let mut known: BTreeSet<&str> = layout.tensors.iter().map(|t| t.name.as_str()).collect();
    known.insert("centres");
    let mut weights = robert_linalg::Aligned::<f32>::zeros(layout.len);
    for t in &layout.tensors {
        let from = numbers(&file, &t.name, &t.shape).map_err(damaged)?;
        weights[t.range.clone()].copy_from_slice(&from);
    }
    let shape = [card.net.bins, card.net.actions];
    let centres = numbers(&file, "centres", &shape).map_err(damaged)?;
    let ridge = if card.net.skip == SkipKind::Off {
        None
    } else {
        known.insert("ridge");
        let inputs = tokens.ridge_inputs();
        let shape = [RIDGE_HEADS, inputs, card.net.actions];
        let w = numbers(&file, "ridge", &shape).map_err(damaged)?;
        Some(Ridge::new(inputs, card.net.actions, w)?)
    };
    let optimiser = read_optimiser(&file, &layout, &metadata).map_err(damaged)?;
    for name in file.names() {
        let plain = STATE.iter().find_map(|prefix| name.strip_prefix(prefix));
        if !known.contains(plain.unwrap_or(name)) {
            return Err(damaged(format!("an unknown tensor {name:?}")));
        }
    }
    let encoder = Encoder::new(tokens, ridge)?;
    encoder.check(&card.net)?;
    let net = Net { cfg: card.net.clone(), layout, weights, centres };
    Ok(Model { card, net, encoder, optimiser })
}

/// Refuses a file that was made for another robot, and names the difference.
///
/// # Errors
/// [`Error::Robot`].
pub fn same_robot(trained: &RobotCard, given: &RobotCard, path: &Path) -> Result<(), Error> {
    let refuse = |trained: String, given: String| {
        Err(Error::Robot { trained, given, path: path.to_owned() })
    };
    if trained.joints != given.joints {
        let list = |r: &RobotCard| format!("{} with joints {}", r.id, r.joints.join(", "));
        return refuse(list(trained), list(given));
    }
    if trained.actuators != given.actuators {
        let list = |r: &RobotCard| format!("{} with actuators {}", r.id, r.actuators.join(", "));
        return refuse(list(trained), list(given));
    }
    if trained.model_sha256 != given.model_sha256 {
        let short = |r: &RobotCard| {
            format!("{} (model {})", r.id, r.model_sha256.get(..12).unwrap_or(&r.model_sha256))
        };
        return refuse(short(trained), short(given));
    }
    Ok(())
}

fn check_card(card: &Card) -> Result<(), String> {
    let window = &card.window;
    if (window.history, window.current, window.command) != (HISTORY, 1, COMMAND) {
        let (h, c, n) = (window.history, window.current, window.command);
        return Err(format!(
            "a window of {h} + {c} + {n} frames instead of {HISTORY} + 1 + {COMMAND}"
        ));
    }
    if window.rate_hz != robert_base::units::FPS {
        return Err(format!(
            "{} frames a second instead of {}",
            window.rate_hz,
            robert_base::units::FPS
        ));
    }
    if card.robot.joints.len() != card.facts.joints.len() {
        return Err("joint names and joint facts of different numbers".into());
    }
    if card.robot.actuators.len() != card.facts.actions || card.net.actions != card.facts.actions {
        return Err("actuator names and action sizes of different numbers".into());
    }
    if card.facts.joints.len() > limits::JOINTS {
        return Err(format!("{} joints, more than {}", card.facts.joints.len(), limits::JOINTS));
    }
    if card.mask_granularity != card.tokens.granularity {
        return Err("two different mask granularities".into());
    }
    Ok(())
}

/// Reads the tensor `name` as f32.
///
/// # Errors
/// A sentence, if it is missing, has another shape, is neither f32 nor f16, or is not finite.
pub fn numbers(file: &SafeTensors<'_>, name: &str, shape: &[usize]) -> Result<Vec<f32>, String> {
    let t = file.tensor(name).map_err(|_e| format!("no tensor {name:?}"))?;
    if t.shape() != shape {
        return Err(format!("tensor {name:?} of shape {:?} instead of {shape:?}", t.shape()));
    }
    let x: Vec<f32> = match t.dtype() {
        Dtype::F32 => t.data().as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect(),
        Dtype::F16 => {
            let words = t.data().as_chunks::<2>().0;
            words.iter().map(|&b| f16::from_le_bytes(b).to_f32()).collect()
        }
        other => return Err(format!("tensor {name:?} of type {other:?} instead of F32 or F16")),
    };
    match x.iter().position(|x| !x.is_finite()) {
        Some(i) => Err(format!("tensor {name:?} with the value {} at {i}", x[i])),
        None => Ok(x),
    }
}

fn read_optimiser(
    file: &SafeTensors<'_>,
    layout: &Layout,
    metadata: &HashMap<String, String>,
) -> Result<Option<OptimiserState>, String> {
    let Some(text) = metadata.get("adam.count") else { return Ok(None) };
    let count = text.parse().map_err(|_e| format!("an optimiser step {text:?}"))?;
    let read = |prefix: &str| {
        let mut all = vec![0.0_f32; layout.len];
        for t in &layout.tensors {
            let from = numbers(file, &format!("{prefix}{}", t.name), &t.shape)?;
            all[t.range.clone()].copy_from_slice(&from);
        }
        Ok::<_, String>(all)
    };
    let averaged = file.names().iter().any(|n| n.starts_with("average."));
    Ok(Some(OptimiserState {
        first: read("adam.first.")?,
        second: read("adam.second.")?,
        average: averaged.then(|| read("average.")).transpose()?,
        count,
    }))
}

impl OptimiserState {
    /// The state of a learner, with the running average if one is kept.
    pub fn of(learner: &Learner<f32>, average: Option<&[f32]>) -> Self {
        OptimiserState {
            first: learner.first.to_vec(),
            second: learner.second.to_vec(),
            average: average.map(<[f32]>::to_vec),
            count: learner.count,
        }
    }

    /// Restores the state of a learner whose network came from the same file.
    ///
    /// # Errors
    /// [`Error::Shape`].
    pub fn restore(&self, learner: &mut Learner<f32>) -> Result<(), Error> {
        let want = learner.first.len();
        if self.first.len() != want || self.second.len() != want {
            return Err(Error::Shape { what: "optimiser state", want, got: self.first.len() });
        }
        learner.first.copy_from_slice(&self.first);
        learner.second.copy_from_slice(&self.second);
        learner.count = self.count;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ridge::{RidgeConfig, toy::Toy};
    use crate::tensors::with_header;
    use crate::{AdamConfig, Batch, JointFacts, Mixing};
    use robert_base::progress::Cancel;
    use robert_base::rng::{Rng, Stream};

    fn model() -> (Card, Net<f32>, Encoder) {
        let data = Toy::new(2, 4, 120, 1);
        let range = Some([-1.0, 1.0]);
        let facts = Facts { joints: vec![JointFacts { hinge: true, range }; 2], actions: 2 };
        let norm = Normaliser::measure(2, (0..4).map(|e| data.episodes[e].0.as_slice()));
        let tokens = Tokeniser::new(TokenConfig::for_robot(&facts), facts, &norm).unwrap();
        let fit = RidgeConfig { samples: 200, ..RidgeConfig::default() };
        let ridge = Ridge::fit(&tokens, &data, &fit, 1, &Cancel::default()).unwrap();
        let encoder = Encoder::new(tokens, Some(ridge)).unwrap();
        let cfg = NetConfig {
            layers: 1,
            width: 16,
            heads: 2,
            inputs: encoder.inputs(),
            actions: 2,
            bins: 1,
            offset_weight: 10.0,
            mask_replaces: false,
            skip: SkipKind::Gated,
            mixing: Mixing::Attention,
            dead_zone: 0.0,
        };
        let net = Net::init(cfg.clone(), None, 4).unwrap();
        let robot = RobotCard {
            id: "toy".into(),
            model_sha256: "ab".repeat(32),
            joints: vec!["a".into(), "b".into()],
            actuators: vec!["ma".into(), "mb".into()],
        };
        let training = TrainingCard { seed: 4, ..TrainingCard::default() };
        (Card::new(robot, cfg, &encoder.tokens, norm, training), net, encoder)
    }

    fn bytes() -> Vec<u8> {
        let (card, net, encoder) = model();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.safetensors");
        save(&path, &card, &net, encoder.ridge.as_ref(), None).unwrap();
        std::fs::read(path).unwrap()
    }

    fn refusal(bytes: &[u8]) -> String {
        parse(bytes, Path::new("m.safetensors"), None).unwrap_err().to_string()
    }

    #[test]
    fn headers_have_a_limit_of_bytes() {
        let claimed = |bytes: u64| {
            let text = [&bytes.to_le_bytes()[..], b"{}"].concat();
            parse(&text, Path::new("a.safetensors"), None).unwrap_err().to_string()
        };
        assert!(!claimed(limits::TENSOR_HEADER_BYTES).contains("a header of"));
        assert!(claimed(limits::TENSOR_HEADER_BYTES + 1).contains("a header of 104857601 bytes"));
    }

    #[test]
    fn round_trip_keeps_every_bit() {
        let (card, net, encoder) = model();
        let bytes = bytes();
        let back = parse(&bytes, Path::new("m"), Some(&card.robot)).unwrap();
        assert_eq!(back.card, card);
        assert_eq!(back.net.weights[..], net.weights[..]);
        assert_eq!(back.encoder.ridge.unwrap().weights(), encoder.ridge.unwrap().weights());
        assert!(back.optimiser.is_none());
        assert_eq!(bytes, self::bytes(), "the same model gives the same file");
    }

    #[test]
    fn what_is_usual_is_kept_and_estimated_where_an_older_program_did_not_say() {
        let (mut card, ..) = model();
        let old = serde_json::to_string(&card).unwrap();
        assert!(!old.contains("usual"), "as older programs wrote it");
        let read: Card = serde_json::from_str(&old).unwrap();
        let n = &card.normaliser;
        for (j, usual) in read.usual().iter().enumerate() {
            assert!((usual.low - (n.mean[j] - 2.0 * n.std[j])).abs() < 1e-12);
            assert!((usual.high - (n.mean[j] + 2.0 * n.std[j])).abs() < 1e-12);
            assert!(usual.speed > 0.0);
        }
        card.usual = vec![Usual { low: -0.5, high: 0.25, speed: 2.0 }; 2];
        let read: Card = serde_json::from_str(&serde_json::to_string(&card).unwrap()).unwrap();
        assert_eq!(read.usual(), card.usual);
    }

    #[test]
    fn half_precision_halves_the_weights_alone() {
        let (card, net, encoder) = model();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("half.safetensors");
        let whole = Model { card, net, encoder, optimiser: None };
        save_half(&path, &whole).unwrap();
        let back = load(&path, None).unwrap();
        assert_eq!(back.card, whole.card);
        for (a, b) in back.net.weights.iter().zip(&whole.net.weights[..]) {
            assert!((a - b).abs() <= b.abs() / 1024.0 + 1e-7, "{a} for {b}");
        }
        assert_eq!(back.encoder.ridge.unwrap().weights(), whole.encoder.ridge.unwrap().weights());
        let size = |p: &Path| std::fs::metadata(p).unwrap().len();
        let full = dir.path().join("full.safetensors");
        std::fs::write(&full, bytes()).unwrap();
        assert!(size(&path) < size(&full));
    }

    #[test]
    fn damaged_files_are_refused_with_the_reason() {
        let good = bytes();
        for cut in (0..good.len()).step_by(37).chain([good.len() - 1]) {
            refusal(&good[..cut]);
        }
        let mut nan = good.clone();
        let end = nan.len();
        nan[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(refusal(&nan).contains("NaN"));
        let mut long = good.clone();
        long.extend([0; 8]);
        refusal(&long);
        let mut huge = good.clone();
        huge[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        assert!(refusal(&huge).contains("header"));
        let overlap = with_header(&good, |h| {
            h["mask"]["data_offsets"] = h["position"]["data_offsets"].clone();
        })
        .unwrap();
        refusal(&overlap);
        let big =
            with_header(&good, |h| h["mask"]["shape"] = serde_json::json!([1_u64 << 60])).unwrap();
        refusal(&big);
        let renamed = with_header(&good, |h| {
            let t = h["mask"].take();
            h.as_object_mut().unwrap().remove("mask");
            h["mark"] = t;
        })
        .unwrap();
        assert!(refusal(&renamed).contains("no tensor \"mask\""));
        let reshaped =
            with_header(&good, |h| h["mask"]["shape"] = serde_json::json!([4, 4])).unwrap();
        assert!(refusal(&reshaped).contains("shape"));
        let retyped = with_header(&good, |h| h["mask"]["dtype"] = "I32".into()).unwrap();
        assert!(refusal(&retyped).contains("type"));
        let bare = with_header(&good, |h| h["__metadata__"] = serde_json::json!({})).unwrap();
        assert!(refusal(&bare).contains("model card"));
        let newer = with_header(&good, |h| {
            let card = h["__metadata__"]["robert"].as_str().unwrap().replace("model/1", "model/2");
            h["__metadata__"]["robert"] = card.into();
        })
        .unwrap();
        assert!(refusal(&newer).contains("robert-model/2"));
        let absurd = with_header(&good, |h| {
            let card = h["__metadata__"]["robert"].as_str().unwrap();
            h["__metadata__"]["robert"] = card.replace("\"layers\":1", "\"layers\":9000000").into();
        })
        .unwrap();
        assert!(refusal(&absurd).contains("layers"));
        // These sizes are valid, but not in a file this small.
        let hollow = with_header(&good, |h| {
            let card = h["__metadata__"]["robert"].as_str().unwrap();
            let card = card.replace("\"width\":16", "\"width\":4096");
            h["__metadata__"]["robert"] = card.into();
        })
        .unwrap();
        assert!(refusal(&hollow).contains("too few for the"), "{}", refusal(&hollow));
    }

    #[test]
    fn flipped_bytes_never_panic() {
        let good = bytes();
        let n = u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
        for index in 0..3000 {
            let mut rng = Rng::new(6, Stream::Test, index);
            let mut bad = good.clone();
            for _ in 0..=rng.below(3) {
                let at = rng.below((n + 8) as u64) as usize;
                bad[at] = rng.next_u64() as u8;
            }
            parse(&bad, Path::new("m"), None).ok();
        }
    }

    #[test]
    fn another_robot_is_refused_by_name() {
        let (card, ..) = model();
        let bytes = bytes();
        let refuse = |robot: RobotCard| {
            let e = parse(&bytes, Path::new("m"), Some(&robot)).unwrap_err();
            assert!(matches!(e, Error::Robot { .. }), "{e}");
            e.to_string()
        };
        let mut swapped = card.robot.clone();
        swapped.joints.reverse();
        assert!(refuse(swapped).contains("b, a"));
        let mut other = card.robot.clone();
        other.model_sha256 = "cd".repeat(32);
        assert!(refuse(other).contains("cdcdcd"));
    }

    #[test]
    fn resumed_training_is_the_same_training() {
        let (card, net, encoder) = model();
        let fill = |step: u64| {
            move |w: usize, slot: usize, batch: &mut Batch<f32>| {
                let mut rng = Rng::new(step, Stream::Test, w as u64);
                let n = batch.tokens.len() / batch.masked.len() * crate::WINDOW;
                batch.tokens[slot * n..(slot + 1) * n].fill_with(|| rng.normal() as f32);
                let n = 2 * crate::WINDOW;
                batch.actions[slot * n..(slot + 1) * n].fill_with(|| rng.normal() as f32);
                batch.linear[slot * n..(slot + 1) * n].fill_with(|| rng.normal() as f32);
            }
        };
        let run = |learner: &mut Learner<f32>, steps: std::ops::Range<u64>| {
            steps.for_each(|s| assert!(learner.step(1e-3, &fill(s)).applied));
        };
        let mut whole = Learner::new(net.clone(), AdamConfig::default(), 6, 1);
        run(&mut whole, 0..6);

        let mut half = Learner::new(net, AdamConfig::default(), 6, 1);
        run(&mut half, 0..3);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("c.safetensors");
        let state = OptimiserState::of(&half, Some(&half.net.weights));
        save(&path, &card, &half.net, encoder.ridge.as_ref(), Some(&state)).unwrap();
        let model = load(&path, Some(&card.robot)).unwrap();
        let mut rest = Learner::new(model.net, AdamConfig::default(), 6, 2);
        assert_eq!(model.optimiser, Some(state));
        model.optimiser.unwrap().restore(&mut rest).unwrap();
        run(&mut rest, 3..6);
        assert_eq!(whole.net.weights[..], rest.net.weights[..]);
        assert_eq!(whole.first[..], rest.first[..]);
    }
}
