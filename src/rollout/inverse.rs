//! `mlp-inverse`: the simplest learned inverse dynamics. The input of a small network is the last
//! state, the current state and the state one frame ahead; its output is the action.
//!
//! It does not know how long a gap is: while frames are masked, its goal is the point one frame
//! ahead on the straight line to the next visible goal.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::error::Error;
use super::fitted::{FitCard, FitKind, Scales, file_error, tensors_of};
use super::policy::{Policy, View};
use super::window::{HISTORY, Window};
use robert_base::fsio;
use robert_base::limits;
use robert_explore::{Layer, Mlp, Tape};
use robert_net::tensors::Out;
use robert_net::{self as net, RobotCard, checkpoint};

/// Widest hidden layer.
const MOST_WIDTH: usize = 4096;

/// Sizes and settings of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InverseSettings {
    /// Units of each of the two hidden layers.
    pub width: usize,
    /// Training steps.
    pub steps: u64,
    /// Frames per step.
    pub batch: usize,
    /// Highest learning rate; it falls to zero along a half cosine.
    pub lr: f64,
}

impl Default for InverseSettings {
    fn default() -> Self {
        InverseSettings { width: 128, steps: 12_000, batch: 256, lr: 2e-3 }
    }
}

/// The network with its units.
#[derive(Clone, Debug)]
pub struct Inverse {
    card: FitCard<InverseSettings>,
    pub net: Mlp<f32>,
    scales: Scales,
    tape: Tape<f32>,
    input: Vec<f32>,
}

impl Inverse {
    /// An untrained network, its weights drawn from the card's seed.
    ///
    /// # Errors
    /// [`net::Error::Config`] for a width out of bounds.
    pub fn new(card: FitCard<InverseSettings>) -> Result<Self, net::Error> {
        if !(1..=MOST_WIDTH).contains(&card.settings.width) {
            let why = format!("{} is not in 1..={MOST_WIDTH}", card.settings.width);
            return Err(net::Error::Config { field: "width", why });
        }
        Ok(Inverse {
            net: Mlp::new(&layers(&card), card.seed, 0),
            scales: Scales::new(&card),
            tape: Tape::default(),
            input: vec![0.0; 3 * card.state()],
            card,
        })
    }

    /// Its settings.
    pub fn card(&self) -> &FitCard<InverseSettings> {
        &self.card
    }

    /// Inputs of one frame, (3 S): position, last change and next change.
    pub fn encode(&self, before: &[f32], now: &[f32], next: &[f32], to: &mut [f32]) {
        let s = self.card.state();
        let (place, ways) = to.split_at_mut(s);
        let (behind, ahead) = ways.split_at_mut(s);
        let Scales { mean, place: by_place, way } = &self.scales;
        for (j, ((place, behind), ahead)) in place.iter_mut().zip(behind).zip(ahead).enumerate() {
            *place = (now[j] - mean[j]) * by_place[j];
            *behind = (now[j] - before[j]) * way[j];
            *ahead = (next[j] - now[j]) * way[j];
        }
    }

    /// The action for this window, (A).
    pub fn answer(&mut self, window: &Window, action: &mut [f64]) {
        let s = window.dim();
        let single = |x: &[f64]| x.iter().map(|&x| x as f32).collect::<Vec<f32>>();
        let now = single(&window.current);
        let before = single(&window.history[(HISTORY - 1) * s..]);
        let next: Vec<f32> = (0..s).map(|j| window.next_target(j) as f32).collect();
        let mut input = std::mem::take(&mut self.input);
        self.encode(&before, &now, &next, &mut input);
        let found = self.net.forward(&input, 1, &mut self.tape);
        for (to, &x) in action.iter_mut().zip(found) {
            *to = f64::from(x.clamp(-1.0, 1.0));
        }
        self.input = input;
    }

    /// Writes it, atomically.
    ///
    /// # Errors
    /// [`net::Error::Files`].
    pub fn save(&self, path: &Path) -> Result<(), net::Error> {
        let mut all = BTreeMap::new();
        let mut at = 0;
        for (name, shape) in shapes(&self.card) {
            let end = at + shape.iter().product::<usize>();
            let numbers = &self.net.params[at..end];
            all.insert(name, Out::new(&shape, numbers));
            at = end;
        }
        self.card.save(path, &all)
    }

    /// Reads and checks a file; `robot`, when given, must be its robot.
    ///
    /// # Errors
    /// [`net::Error::File`] with the reason, [`net::Error::Robot`], [`net::Error::Files`].
    pub fn load(path: &Path, robot: Option<&RobotCard>) -> Result<Self, net::Error> {
        let bytes = fsio::read_capped(path, limits::TENSOR_FILE_BYTES)?;
        let card = FitCard::<InverseSettings>::parse(&bytes, FitKind::MlpInverse, robot, path)?;
        if !(1..=MOST_WIDTH).contains(&card.settings.width) {
            return Err(file_error(format!("a width of {}", card.settings.width), path));
        }
        let shapes = shapes(&card);
        let names: Vec<String> = shapes.iter().map(|(name, _)| name.clone()).collect();
        let file = tensors_of(&bytes, &names, path)?;
        let mut params = Vec::new();
        for (name, shape) in &shapes {
            let found = checkpoint::numbers(&file, name, shape);
            params.extend(found.map_err(|why| file_error(why, path))?);
        }
        let mut inverse = Self::new(card)?;
        inverse.net.params = params;
        Ok(inverse)
    }
}

/// Layers of the network: two hidden ones.
fn layers(card: &FitCard<InverseSettings>) -> [Layer; 5] {
    let (s, a, w) = (card.state(), card.actions(), card.settings.width);
    [
        Layer::Linear(3 * s, w),
        Layer::Relu(w),
        Layer::Linear(w, w),
        Layer::Relu(w),
        Layer::Linear(w, a),
    ]
}

/// Tensors of the file in the order of the parameters.
fn shapes(card: &FitCard<InverseSettings>) -> Vec<(String, Vec<usize>)> {
    let mut all = Vec::new();
    let linear = layers(card).into_iter().filter_map(|l| match l {
        Layer::Linear(m, n) => Some((m, n)),
        _ => None,
    });
    for (i, (m, n)) in linear.enumerate() {
        all.push((format!("layer{i}.weight"), vec![m, n]));
        all.push((format!("layer{i}.bias"), vec![n]));
    }
    all
}

impl Policy for Inverse {
    fn name(&self) -> String {
        "mlp-inverse".to_owned()
    }

    fn reset(&mut self, _seed: u64) {}

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.answer(view.window, action);
        Ok(())
    }
}
