//! Errors of graphics cards.

use robert_base::exit::{Exit, HasExit};

/// Why a card cannot train.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// There is no card.
    #[error("{why}")]
    Absent {
        /// The available adapters, and what would help.
        why: String,
    },
    /// A card was asked for by a number that none has.
    #[error("there is no gpu:{number}; there are {known}")]
    Number {
        /// The number.
        number: usize,
        /// The numbers and names of all.
        known: String,
    },
    /// The card is busy, or its driver is broken.
    #[error("{device} does not answer: {why}")]
    Broken {
        /// Its name.
        device: String,
        /// The driver's words.
        why: String,
    },
    /// The card's limits are too small for this network.
    #[error("{device} cannot train this network: {why}")]
    Unfit {
        /// Its name.
        device: String,
        /// The limit and why it is too low.
        why: String,
    },
    /// The card has no units for matrices of 16-bit factors that the kernels can use.
    #[error("{device} cannot multiply 16-bit factors: {why}")]
    Half {
        /// Its name.
        device: String,
        /// What is missing.
        why: String,
    },
    /// Not even one window fits.
    #[error(
        "{device} has not enough memory: one window of this network needs {needs_mib} MiB with its weights; a smaller width or fewer layers would fit"
    )]
    Memory {
        /// Its name.
        device: String,
        /// Weights, gradient, moments and the activations of one window.
        needs_mib: u64,
    },
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::Number { .. } => Exit::Usage,
            Error::Absent { .. } => Exit::Missing,
            _ => Exit::Failed,
        }
    }
}
