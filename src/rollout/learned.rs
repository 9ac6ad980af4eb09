//! The learned policies: `robert`, a trained network, and `ridge`, the linear answer inside
//! its model file. Both see the window and nothing else.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::Error;
use super::policy::{Policy, View};
use super::window::Window;
use crate::net::{
    self, CURRENT, Encoder, HISTORY, MaskGranularity, Model, RobotCard, WINDOW, checkpoint,
};
use crate::robot::Robot;

/// The robot as model cards name it.
pub fn robot_card(robot: &Robot) -> RobotCard {
    RobotCard {
        id: robot.id().to_owned(),
        model_sha256: robot.model_sha256().to_owned(),
        joints: robot.joints().iter().map(|j| j.name.clone()).collect(),
        actuators: robot.actuators().iter().map(|a| a.name.clone()).collect(),
    }
}

/// The model file meant by a path: itself, or the best, else the last, of a run directory.
pub fn model_path(path: &Path) -> PathBuf {
    let inside = [path.join("ckpt/best.safetensors"), path.join("model.safetensors")];
    inside.into_iter().find(|p| p.exists()).unwrap_or_else(|| path.to_owned())
}

/// Loads the model that a path means and checks that it is for this robot.
///
/// # Errors
/// [`Error::Model`].
pub fn load(robot: &Robot, path: &Path) -> Result<Model, Error> {
    Ok(checkpoint::load(&model_path(path), Some(&robot_card(robot)))?)
}

/// Window of a rollout as the network takes it.
#[derive(Clone, Debug)]
struct Frames {
    granularity: MaskGranularity,
    q: Vec<f32>,        // (51, S)
    visible: Vec<bool>, // (51, S)
}

impl Frames {
    fn new(encoder: &Encoder) -> Self {
        let n = WINDOW * encoder.tokens.state();
        let granularity = encoder.tokens.config().granularity;
        Frames { granularity, q: vec![0.0; n], visible: vec![true; n] }
    }

    fn fill(&mut self, window: &Window) {
        let s = window.dim();
        let mut put = |window: &Window| {
            let states = window.history.iter().chain(&window.current).chain(&window.command);
            for (to, &x) in self.q.iter_mut().zip(states) {
                *to = x as f32;
            }
            let command = &mut self.visible[(CURRENT + 1) * s..];
            command.copy_from_slice(&window.visible);
        };
        if self.granularity == MaskGranularity::State {
            // This network knows whole frames only.
            let mut whole = window.clone();
            whole.complete_partial_frames();
            put(&whole);
        } else {
            put(window);
        }
    }
}

/// A trained network.
#[derive(Debug)]
pub struct Learned {
    policy: net::Policy,
    frames: Frames,
}

impl Learned {
    /// The network of a model.
    ///
    /// # Errors
    /// [`Error::Model`].
    pub fn new(model: Model, options: net::PolicyConfig) -> Result<Self, Error> {
        let frames = Frames::new(&model.encoder);
        Ok(Learned { policy: net::Policy::new(model.net, model.encoder, options)?, frames })
    }
}

impl Policy for Learned {
    fn name(&self) -> String {
        "robert".to_owned()
    }

    fn reset(&mut self, seed: u64) {
        self.policy.reset(seed);
    }

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.frames.fill(view.window);
        let found = self.policy.act(&self.frames.q, &self.frames.visible, view.frame as u64);
        for (to, &x) in action.iter_mut().zip(found) {
            *to = f64::from(x);
        }
        Ok(())
    }

    fn memory(&self) -> Vec<f64> {
        self.policy.memory()
    }

    fn recall(&mut self, memory: &[f64]) {
        self.policy.recall(memory);
    }
}

/// The linear answer alone: no network, fitted in seconds.
#[derive(Debug)]
pub struct Linear {
    encoder: Arc<Encoder>,
    frames: Frames,
    scratch: net::token::Scratch,
    features: Vec<f32>,
    answer: Vec<f32>,
}

impl Linear {
    /// The linear answer inside a model.
    ///
    /// # Errors
    /// [`Error::Needs`] when the model has none.
    pub fn new(encoder: Encoder) -> Result<Self, Error> {
        if encoder.ridge.is_none() {
            return Err(Error::Needs {
                policy: "ridge".to_owned(),
                needs: "a model with a linear skip; this one was trained without".to_owned(),
            });
        }
        Ok(Linear {
            frames: Frames::new(&encoder),
            scratch: encoder.tokens.scratch(),
            features: Vec::new(),
            answer: vec![0.0; encoder.tokens.facts().actions],
            encoder: Arc::new(encoder),
        })
    }
}

impl Policy for Linear {
    fn name(&self) -> String {
        "ridge".to_owned()
    }

    fn reset(&mut self, _seed: u64) {}

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        debug_assert_eq!(view.window.history.len(), HISTORY * view.window.dim());
        self.frames.fill(view.window);
        let (tokens, now) = (&self.encoder.tokens, CURRENT..CURRENT + 1);
        tokens.read(&self.frames.q, &self.frames.visible, &mut self.scratch);
        if let Some(ridge) = &self.encoder.ridge {
            ridge.answers(tokens, &self.scratch, now, &mut self.features, &mut self.answer);
        }
        for (to, &x) in action.iter_mut().zip(&self.answer) {
            *to = f64::from(x.clamp(-1.0, 1.0));
        }
        Ok(())
    }
}
