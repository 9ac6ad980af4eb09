//! Options that let a shard differ from its plan.

use crate::shard::Accept;

/// Differences from the plan that are accepted.
#[derive(clap::Args, Clone, Copy, Debug)]
pub(super) struct AcceptArgs {
    /// Accept another kind of processor than that of the plan, whose last bits differ.
    #[arg(long)]
    any_processor: bool,
    /// Accept another build of the program than that of the plan.
    #[arg(long)]
    any_build: bool,
}

impl AcceptArgs {
    pub(super) fn accept(self) -> Accept {
        Accept { any_processor: self.any_processor, any_build: self.any_build }
    }

    /// The options as words of a command.
    pub(super) fn words(self) -> Vec<String> {
        let mut words = Vec::new();
        words.extend(self.any_processor.then(|| "--any-processor".to_owned()));
        words.extend(self.any_build.then(|| "--any-build".to_owned()));
        words
    }
}
