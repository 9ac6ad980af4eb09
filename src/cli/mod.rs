//! The command line: parse ([`Cli`]), plan (checked values), run (one file per command).
//!
//! Results go to stdout, progress and log to stderr. There are two phases, as in ripgrep: clap
//! parses text, and each command turns it into a plan whose values are checked before any work
//! begins. So a typo never costs an hour.

mod arrivals;
mod bar;
mod bench;
mod check;
mod clip;
mod collect;
mod completions;
mod dataset;
mod dataset_plot;
mod device;
mod doctor;
mod escape;
mod eval;
mod export;
mod failure;
mod fit;
mod global;
mod import;
mod input;
mod interrupt;
mod log;
mod models;
mod motion;
mod new;
mod out;
mod output;
mod perform;
mod plot;
mod pool;
mod render;
mod robots;
mod rollout;
mod runs;
mod shard;
mod studio;
mod sweep;
mod tasks;
mod train;

pub use failure::{Failure, Outcome};

use std::ffi::OsString;
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Parser, Subcommand};

use crate::child::{self, OnParentExit};
use crate::exit::Exit;
use global::Global;

/// Draft motions for torque-controlled robots from a few keyframes, and let a learned policy
/// perform them in simulation.
#[derive(Debug, Parser)]
#[command(name = "robert", version, max_term_width = 100, arg_required_else_help = true)]
#[command(
    after_help = "Examples:\n  robert studio                          draft motions in the browser\n  robert tasks ls                        the example clips\n  robert rollout CLIP --policy ilqr      perform a clip and print its error\n  robert render CLIP -o hang.mp4         make a film of it\n  robert doctor                          what is missing on this machine\n\nEnvironment: ROBERT_LOG=warn,robert=debug sets the log levels, ROBERT_STATE_DIR=DIR the folder of unsaved clips.\n\nExit codes: 0 success, 1 failure, 2 wrong usage, 3 invalid input, 4 threshold missed, 5 missing dependency, 130 interrupted."
)]
pub struct Cli {
    #[command(flatten)]
    global: Global,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Draft keyframes in the browser while a policy performs them.
    Studio(studio::Args),
    /// Create, check, edit and convert clips.
    Clip(clip::Args),
    /// Perform a clip with a policy, and measure the error.
    Rollout(rollout::Args),
    /// Draw a clip or a take as a picture, a film strip or a film.
    Render(Box<render::Args>),
    /// Write a take in another format; a clip is performed first.
    Export(export::Args),
    /// Compare policies on suites of clips.
    Eval(eval::Args),
    /// List the built-in task clips, or copy them to edit.
    #[command(subcommand)]
    Tasks(tasks::Args),
    /// Draw charts from takes, tables and results.
    Plot(plot::Args),
    /// Record motion by noise, babbling or exploring agents.
    Collect(collect::Args),
    /// Inspect collected data; split, shrink, corrupt, merge or check it.
    Dataset(dataset::Args),
    /// Train a policy on collected data; it can be stopped and resumed at any time.
    Train(train::Args),
    /// List the built-in trained policies, show a model's card, or pack a model.
    #[command(subcommand)]
    Models(models::Args),
    /// Train a grid of settings with several seeds; writes a table and a chart.
    Sweep(sweep::Args),
    /// Divide large work into shards, run them anywhere, and merge the results.
    #[command(subcommand)]
    Shard(shard::Args),
    /// List, show and compare training runs.
    #[command(subcommand)]
    Runs(runs::Args),
    /// Fit a policy that needs no training: ridge, nearest or mlp-inverse.
    Fit(fit::Args),
    /// List and show robots, or settle a pose.
    #[command(subcommand)]
    Robots(robots::Args),
    /// Take a robot from its URDF or MJCF to a trained policy, in one command.
    New(Box<new::Args>),
    /// Make a robot folder from a URDF or MJCF.
    Import(import::Args),
    /// Check this machine: libraries, graphics, cores, models; names the fix for what is missing.
    Doctor(doctor::Args),
    /// Measure speed relative to a named reference.
    Bench(bench::Args),
    /// Print a completion script for your shell.
    Completions(completions::Args),
    /// Run the studio's simulation process.
    #[command(name = "__worker", hide = true)]
    Worker,
    /// Check a foreign model in a child process.
    #[command(name = crate::robot::check::SUBCOMMAND, hide = true)]
    CompileCheck(check::Args),
}

/// The option that `--jsonl` implies.
const JSON: &str = "--json";

/// Whether the command does not know `--json`.
fn is_about_json(e: &clap::Error) -> bool {
    let named = e.get(ContextKind::InvalidArg);
    e.kind() == ErrorKind::UnknownArgument
        && matches!(named, Some(ContextValue::String(name)) if name == JSON)
}

/// Parses, runs, reports: what `main` does.
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    ExitCode::from(call(args).code())
}

/// As [`main`], with the exit code as a value, for programs that call the command line as a library
/// (Python).
pub fn call(args: impl IntoIterator<Item = OsString>) -> Exit {
    crate::mujoco::set_env_at_start("NODEVICE_SELECT", "1");
    let mut args: Vec<OsString> = args.into_iter().collect();
    // What follows `--` are not options of this program.
    let end = args.iter().position(|a| a == "--").unwrap_or(args.len());
    let given = |flag: &str| args.iter().take(end).skip(1).any(|a| a == flag);
    let implied = given("--jsonl") && !given(JSON);
    if implied {
        args.insert(end, JSON.into());
    }
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(e) if implied && is_about_json(&e) => {
            let why = "--jsonl is only for commands that have --json";
            return usage(&Cli::command().error(ErrorKind::UnknownArgument, why));
        }
        Err(e) => return usage(&e),
    };
    if cli.global.jsonl {
        out::in_lines();
    }
    log::init(cli.global.quiet, cli.global.verbose);
    match run(cli) {
        Ok(()) => Exit::Ok,
        Err(failure) => {
            failure.report();
            failure.exit()
        }
    }
}

fn run(cli: Cli) -> Outcome {
    // The simulation and the check of a model handle this themselves. Everything else is a job.
    if !matches!(cli.command, Command::Worker | Command::CompileCheck(_)) {
        child::follow_parent(OnParentExit::Interrupted)?;
    }
    match cli.command {
        Command::Rollout(args) => rollout::run(&args, cli.global),
        Command::Export(args) => export::run(&args, cli.global),
        Command::Eval(args) => eval::run(&args, cli.global),
        Command::Tasks(args) => tasks::run(&args, cli.global),
        Command::Doctor(args) => doctor::run(&args),
        Command::Bench(args) => bench::run(args),
        Command::Collect(args) => collect::run(&args, cli.global),
        Command::Studio(args) => studio::run(args),
        Command::Worker => Ok(crate::studio::run_worker()?),
        Command::Dataset(args) => dataset::run(args),
        Command::Train(args) => train::run(&args, cli.global),
        Command::Models(args) => models::run(&args),
        Command::New(args) => new::run(&args, cli.global),
        Command::Sweep(args) => sweep::run(&args, cli.global),
        Command::Shard(args) => shard::run(&args, cli.global),
        Command::Runs(args) => runs::run(&args),
        Command::Fit(args) => fit::run(&args, cli.global),
        Command::Clip(args) => clip::run(&args, cli.global),
        Command::Render(args) => render::run(&args, cli.global),
        Command::Plot(args) => plot::run(&args),
        Command::Completions(args) => completions::run(&args, Cli::command()),
        Command::Robots(args) => robots::run(&args),
        Command::Import(args) => import::run(&args),
        Command::CompileCheck(args) => check::run(&args),
    }
}

/// Clap prints help and version to stdout with 0, mistakes to stderr with 2.
fn usage(e: &clap::Error) -> Exit {
    e.print().ok();
    if e.use_stderr() { Exit::Usage } else { Exit::Ok }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::Cli;
    use crate::rollout::PolicyName;

    /// The words that call each command that does something, without hidden ones.
    fn leaves(c: &clap::Command, path: &str, found: &mut Vec<(String, clap::Command)>) {
        let mut inside =
            c.get_subcommands().filter(|s| !s.is_hide_set() && s.get_name() != "help").peekable();
        if inside.peek().is_none() {
            found.push((path.to_owned(), c.clone()));
        }
        for s in inside {
            leaves(s, &format!("{path} {}", s.get_name()), found);
        }
    }

    #[test]
    fn every_command_has_examples_of_itself() {
        let mut found = Vec::new();
        leaves(&Cli::command(), "robert", &mut found);
        assert!(found.len() > 50, "{}", found.len());
        for (path, mut c) in found {
            let help = c.render_long_help().to_string();
            let examples = help.split("\nExamples:\n").nth(1);
            assert!(examples.is_some_and(|e| e.contains(&path)), "{path}: {help}");
        }
    }

    #[test]
    fn the_file_to_write_has_one_option() {
        let mut found = Vec::new();
        leaves(&Cli::command(), "robert", &mut found);
        for (path, c) in found {
            for option in c.get_arguments() {
                assert_ne!(option.get_long(), Some("output"), "{path}");
                let is_out = option.get_long() == Some("out");
                assert_eq!(is_out, option.get_short() == Some('o'), "{path}: {option}");
            }
        }
    }

    /// The words of an example, up to a pipe, a redirection or a comment.
    fn words(example: &str) -> Vec<String> {
        let (mut words, mut word, mut quote) = (Vec::new(), String::new(), None);
        let (mut spaces, mut any) = (0, false);
        for c in example.trim().chars() {
            if quote == Some(c) {
                quote = None;
            } else if quote.is_some() {
                word.push(c);
            } else if c == '"' || c == '\'' {
                (quote, any) = (Some(c), true);
            } else if c == ' ' {
                spaces += 1;
                if spaces == 3 {
                    break;
                }
                if any || !word.is_empty() {
                    words.push(std::mem::take(&mut word));
                }
                any = false;
                continue;
            } else if ['|', '>', '<', '&'].contains(&c) {
                break;
            } else {
                word.push(c);
            }
            spaces = 0;
        }
        words.extend((any || !word.is_empty()).then_some(word));
        words
    }

    #[test]
    fn every_example_parses() {
        let mut found = Vec::new();
        leaves(&Cli::command(), "robert", &mut found);
        let groups = Cli::command();
        found.extend(groups.get_subcommands().map(|c| (c.get_name().to_owned(), c.clone())));
        found.push(("robert".to_owned(), groups.clone()));
        let mut parsed = 0;
        for (path, c) in found {
            let help = c.get_after_help().map(ToString::to_string).unwrap_or_default();
            let Some(examples) = help.split("Examples:\n").nth(1) else { continue };
            for line in examples.lines().take_while(|l| l.starts_with("  ")) {
                // A longer line is broken, and cannot be copied from the screen.
                assert!(line.chars().count() <= 100, "{path}: {line}");
                let words = words(line);
                if words.first().is_none_or(|w| w != "robert") || line.contains("CLIP") {
                    continue;
                }
                let tried = Cli::command().try_get_matches_from(&words);
                assert!(tried.is_ok(), "{path}: {line}: {}", tried.unwrap_err());
                parsed += 1;
            }
        }
        assert!(parsed > 120, "{parsed}");
    }

    #[test]
    fn help_names_every_policy() {
        let root = Cli::command();
        for name in ["rollout", "eval", "export", "render"] {
            let mut c = root.find_subcommand(name).unwrap().clone();
            let help = c.render_long_help().to_string();
            for policy in PolicyName::all() {
                assert!(help.contains(&format!("  {}", policy.as_str())), "{name}: {help}");
            }
            assert!(help.contains("nearest:PATH") && help.contains("+ensemble=N"), "{name}");
        }
    }
}
