//! `--device` and `--half`: what computes the steps of a training.

use super::failure::{Failure, Outcome};
use crate::gpu::{self, Arithmetic, Choice, Request};

#[derive(clap::Args, Clone, Copy, Debug)]
pub(super) struct On {
    /// The device that computes the steps: the processor, or a graphics card, whose rounding
    /// differs. `auto` uses a card if there is one and continues on the processor if the card is
    /// lost; `gpu:1` is the second card in `robert doctor`. ROBERT_GPU=software allows the software
    /// driver.
    #[arg(long, value_name = "auto|cpu|gpu[:N]", default_value_t = Choice::Cpu)]
    pub(super) device: Choice,
    /// Let the card multiply 16-bit factors on its matrix units, with 32-bit sums: faster, and less
    /// exact. When work is resumed, give it again.
    #[arg(long)]
    half: bool,
}

impl On {
    /// What the trainer asks for. A number that no card has is a mistake on the command line; a
    /// missing card is not, and the engine says so.
    pub(super) fn request(self) -> Outcome<Request> {
        if self.half && self.device == Choice::Cpu {
            return Err(Failure::usage("--half is for graphics cards: add --device gpu"));
        }
        if let Choice::Gpu(Some(number)) = self.device
            && let Err(e @ gpu::Error::Number { .. }) =
                gpu::adapter::choose(Some(number), gpu::adapter::software_wanted())
        {
            return Err(e.into());
        }
        let arithmetic = if self.half { Arithmetic::Half } else { Arithmetic::Single };
        Ok(Request { choice: self.device, arithmetic })
    }

    /// The words of a command that asks for the same.
    pub(super) fn words(self) -> Vec<String> {
        let device = ["--device".to_owned(), self.device.to_string()];
        device.into_iter().chain(self.half.then(|| "--half".to_owned())).collect()
    }
}
