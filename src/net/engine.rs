//! The interface of engines, which compute the steps of a training, and the engine that uses the
//! processor.
//!
//! The training loop handles batches, schedules, checkpoints, metrics and the choice of the best
//! model. An engine holds the weights, the optimiser's moments and the running average of the
//! weights. It turns a batch into a gradient, and a gradient into new weights. [`CpuEngine`] is the
//! reference; `robert-gpu` contains the engine for graphics cards.

use super::batch::Batch;
use super::checkpoint::OptimiserState;
use super::head::Sums;
use super::model::Net;
use super::step::{AdamConfig, GradientView, Learner};
use super::{Error, config::WINDOW};
use robert_base::progress::Progress;

/// Writes window w of batch `index` into a slot: `fill(index, w, slot, batch)`.
pub type Fill<'a> = dyn Fn(u64, usize, usize, &mut Batch<f32>) + Sync + 'a;

/// The state with which an engine begins.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The network with its weights.
    pub net: Net<f32>,
    /// Optimiser.
    pub adam: AdamConfig,
    /// Windows in a step.
    pub batch: usize,
    /// Threads of the processor.
    pub threads: usize,
    /// Loss at the current frame alone instead of all 51.
    pub current_only: bool,
    /// Whether a running average of the weights is kept; it begins as the weights.
    pub averages: bool,
}

/// The device of an engine that is not the processor.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceUse {
    /// Name of the graphics card.
    pub name: String,
    /// Bytes of its memory that the training uses.
    pub bytes: u64,
    /// Windows that it computes at once.
    pub windows: usize,
}

/// Computes the steps of a training. Every method may end with [`Error::Lost`]; then the weights
/// since the last checkpoint are gone.
pub trait Engine {
    /// Loss and gradient of batch `index`; weights and moments are unchanged. If `next` is the
    /// batch that the same `fill` will be asked for after this, it may be prepared meanwhile.
    ///
    /// # Errors
    /// [`Error::Lost`].
    fn gradient(
        &mut self,
        fill: &Fill<'_>,
        index: u64,
        next: Option<u64>,
    ) -> Result<GradientView, Error>;

    /// Updates the weights by the result of [`Engine::gradient`], and their running average by
    /// `decay`. The average forgets faster at first, so that the initial weights do not stay in it.
    ///
    /// # Errors
    /// [`Error::Lost`].
    fn apply(&mut self, lr: f64, view: &GradientView, decay: f64) -> Result<(), Error>;

    /// Errors of batch `index` without gradients, for held-out data.
    ///
    /// # Errors
    /// [`Error::Lost`].
    fn errors(&mut self, fill: &Fill<'_>, index: u64) -> Result<Sums, Error>;

    /// Output of the head for batch `index`, (B, 51, outputs).
    ///
    /// # Errors
    /// [`Error::Lost`].
    fn infer(&mut self, fill: &Fill<'_>, index: u64) -> Result<Vec<f32>, Error>;

    /// Exchanges the weights and their running average; does nothing if no average is kept.
    ///
    /// # Errors
    /// [`Error::Lost`].
    fn swap_average(&mut self) -> Result<(), Error>;

    /// The network with its weights. If `averaged` is set and an average is kept, with their
    /// running average.
    ///
    /// # Errors
    /// [`Error::Lost`].
    fn net(&mut self, averaged: bool) -> Result<Net<f32>, Error>;

    /// Moments, average and step.
    ///
    /// # Errors
    /// [`Error::Lost`].
    fn state(&mut self) -> Result<OptimiserState, Error>;

    /// Restores what [`Engine::state`] returned, of any engine; the weights are those of the setup.
    ///
    /// # Errors
    /// [`Error::Shape`] for the state of another network, [`Error::Lost`].
    fn restore(&mut self, state: &OptimiserState) -> Result<(), Error>;

    /// The device, if it is not the processor.
    fn device(&self) -> Option<DeviceUse>;
}

/// Opens the engine of a run.
pub trait Engines {
    /// Opens an engine. If the wanted device cannot work, the processor's engine is opened, and
    /// `progress` gets a line with the reason.
    ///
    /// # Errors
    /// Those of the crate that implements it; a processor has none.
    fn open(&self, setup: Setup, progress: &dyn Progress) -> Result<Box<dyn Engine>, Error>;

    /// Whether a run goes on with the processor when its device is lost.
    fn survives(&self) -> bool;
}

/// Share of the new weights in the average after this many steps.
pub fn average_share(count: u64, decay: f64) -> f32 {
    let n = count as f64;
    1.0 - decay.min((1.0 + n) / (10.0 + n)) as f32
}

/// The processor.
#[derive(Debug)]
pub struct CpuEngine {
    learner: Learner<f32>,
    averaged: Option<Vec<f32>>,
}

impl CpuEngine {
    /// Memory for the steps.
    pub fn new(setup: Setup) -> Self {
        let Setup { net, adam, batch, threads, current_only, averages } = setup;
        let averaged = averages.then(|| net.weights.to_vec());
        let mut learner = Learner::new(net, adam, batch, threads);
        learner.current_only = current_only;
        CpuEngine { learner, averaged }
    }

    /// Gradient of the last batch, laid out as the weights.
    pub fn last_gradient(&self) -> &[f32] {
        self.learner.gradient()
    }
}

impl Engine for CpuEngine {
    fn gradient(
        &mut self,
        fill: &Fill<'_>,
        index: u64,
        _next: Option<u64>,
    ) -> Result<GradientView, Error> {
        Ok(self.learner.compute_gradient(&|w, slot, batch: &mut _| fill(index, w, slot, batch)))
    }

    fn apply(&mut self, lr: f64, view: &GradientView, decay: f64) -> Result<(), Error> {
        self.learner.apply(lr, view);
        if let Some(average) = &mut self.averaged {
            let share = average_share(self.learner.count, decay);
            for (a, &w) in average.iter_mut().zip(&self.learner.net.weights[..]) {
                *a += share * (w - *a);
            }
        }
        Ok(())
    }

    fn errors(&mut self, fill: &Fill<'_>, index: u64) -> Result<Sums, Error> {
        Ok(self.learner.errors(&|w, slot, batch: &mut _| fill(index, w, slot, batch)))
    }

    fn infer(&mut self, fill: &Fill<'_>, index: u64) -> Result<Vec<f32>, Error> {
        let net = &self.learner.net;
        let panels = super::model::Panels::new(net);
        let mut arena = super::model::Arena::new(&net.cfg, 1);
        let mut batch = Batch::zeros(&net.cfg, 1);
        let mut all = Vec::new();
        for w in 0..self.learner.batch() {
            fill(index, w, 0, &mut batch);
            super::model::forward(net, &panels, &batch, &mut arena);
            all.extend_from_slice(&arena.out[..WINDOW * net.cfg.outputs()]);
        }
        Ok(all)
    }

    fn swap_average(&mut self) -> Result<(), Error> {
        if let Some(average) = &mut self.averaged {
            self.learner.net.weights.swap_with_slice(average);
            self.learner.weights_changed();
        }
        Ok(())
    }

    fn net(&mut self, averaged: bool) -> Result<Net<f32>, Error> {
        let mut net = self.learner.net.clone();
        if let Some(average) = self.averaged.as_ref().filter(|_| averaged) {
            net.weights.copy_from_slice(average);
        }
        Ok(net)
    }

    fn state(&mut self) -> Result<OptimiserState, Error> {
        Ok(OptimiserState::of(&self.learner, self.averaged.as_deref()))
    }

    fn restore(&mut self, state: &OptimiserState) -> Result<(), Error> {
        state.restore(&mut self.learner)?;
        self.averaged.clone_from(&state.average);
        Ok(())
    }

    fn device(&self) -> Option<DeviceUse> {
        None
    }
}
