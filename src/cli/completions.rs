//! `robert completions SHELL`.

use clap_complete::Shell;

use super::failure::Outcome;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert completions bash > ~/.local/share/bash-completion/completions/robert"
)]
pub(super) struct Args {
    /// The shell.
    shell: Shell,
}

pub(super) fn run(args: &Args, mut command: clap::Command) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "robert", &mut script);
    super::out::line(String::from_utf8_lossy(&script).trim_end())
}
