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

use super::card::check_card;
use super::model::Net;
use super::params::Layout;
use super::ridge::Ridge;
use super::tensors::{self, Out};
use super::token::{RIDGE_HEADS, Tokeniser};
use super::{Encoder, Error, SkipKind};
use robert_base::fsio;
use robert_base::limits;

pub use super::card::{
    Card, FORMAT, PhysicsCard, RobotCard, TrainingCard, Usual, WindowCard, is_off, same_robot,
};
pub use super::optimiser_state::OptimiserState;

/// Key of the card in the header's metadata.
const CARD: &str = "robert";
/// Prefix of the names of the optimiser's tensors.
const STATE: [&str; 3] = ["adam.first.", "adam.second.", "average."];

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ridge::{RidgeConfig, toy::Toy};
    use crate::step::{AdamConfig, Learner};
    use crate::tensors::with_header;
    use crate::token::{Facts, Normaliser, TokenConfig};
    use crate::{Batch, JointFacts, Mixing, NetConfig};
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
