//! A batch of windows, the input of the network.

use super::config::{NetConfig, SkipKind, WINDOW};
use robert_linalg::{Aligned, Real};

/// Whether the robot is free, at a stop, or in contact. At stops and in contact there are forces
/// that positions do not show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Place {
    /// Away from stops and self-contact.
    #[default]
    Clear,
    /// A joint near a stop.
    Stop,
    /// In self-contact, no joint near a stop.
    Contact,
    /// Any place, if the next token contains the action of this frame. Errors of such frames are
    /// not counted.
    Told,
}

/// A batch of windows, (B, 51, ·) row-major.
#[derive(Clone, Debug)]
pub struct Batch<T: Real> {
    /// Windows B.
    pub count: usize,
    /// Token features, (B, 51, inputs).
    pub tokens: Aligned<T>,
    /// Whether a token is hidden, (B, 51).
    pub masked: Vec<bool>,
    /// The linear prediction, (B, 51, A); empty without a skip.
    pub linear: Vec<T>,
    /// Actions to infer, (B, 51, A).
    pub actions: Vec<T>,
    /// Weight of each token in the loss, (B, 51).
    pub weight: Vec<T>,
    /// The robot's [`Place`] at each frame, (B, 51); for the log only.
    pub place: Vec<Place>,
}

impl<T: Real> Batch<T> {
    /// `count` windows of zeros with weight 1.
    pub fn zeros(cfg: &NetConfig, count: usize) -> Self {
        let rows = count * WINDOW;
        let skip = cfg.skip != SkipKind::Off;
        Batch {
            count,
            tokens: Aligned::zeros(rows * cfg.inputs),
            masked: vec![false; rows],
            linear: vec![T::default(); if skip { rows * cfg.actions } else { 0 }],
            actions: vec![T::default(); rows * cfg.actions],
            weight: vec![T::of(1.0); rows],
            place: vec![Place::Clear; rows],
        }
    }
}
