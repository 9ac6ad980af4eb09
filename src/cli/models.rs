//! `robert models`: the built-in trained policies, and small model files to give away.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::failure::{Failure, Outcome};
use super::{out, output};
use crate::dataset::{Dataset, Verify};
use crate::net::{Card, checkpoint};
use crate::rollout::{PolicyConfig, PolicyName, case, model_path, runs_near, shipped};
use crate::train::fit;

#[derive(clap::Subcommand, Debug)]
#[command(
    after_help = "Examples:\n  robert models ls\n  robert models show shadow_hand/robert\n  robert models show runs/first --json\n  robert models pack runs/first -o first.safetensors --notes \"400k noise transitions, seed 1\"\n\nSelect a built-in model by its name: robert rollout fire --policy robert:faithful"
)]
pub(super) enum Args {
    /// List the built-in trained policies.
    #[command(after_help = "Examples:\n  robert models ls\n  robert models ls --json")]
    Ls {
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Print a model's card: what it learned from, its settings and its figures.
    #[command(
        after_help = "Examples:\n  robert models show shadow_hand/robert\n  robert models show runs/first --json"
    )]
    Show {
        /// ROBOT/NAME of a built-in model, a model file, or a run directory.
        model: String,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Write a run's best model as one small file: half precision, no optimiser state.
    #[command(
        after_help = "Examples:\n  robert models pack runs/first -o first.safetensors --notes \"400k noise transitions, seed 1\""
    )]
    Pack {
        /// Run directory or model file.
        run: PathBuf,
        /// File to write.
        #[arg(short, long, alias = "output")]
        out: PathBuf,
        /// Notes for the card: data, commands, seeds, limits.
        #[arg(long)]
        notes: Option<String>,
        /// Ignore corrections of the linear prediction up to this size (action units, 0 to 0.5). On
        /// a nearly linear robot they are the network's own noise.
        #[arg(long)]
        dead_zone: Option<f64>,
        /// Add what past motion shows to be missing to each action: percent that the newest frame
        /// counts, 0 to 100; 30 is usual, and 0 is off.
        #[arg(long, value_name = "PERCENT", value_parser = clap::value_parser!(u8).range(0..=100))]
        observer: Option<u8>,
        /// Learn from this dataset what actions can move, for a model without that information or
        /// with that of other data.
        #[arg(long, value_name = "DATA")]
        reach: Option<PathBuf>,
    },
}

pub(super) fn run(args: &Args) -> Outcome {
    match args {
        Args::Ls { json } => ls(*json),
        Args::Show { model, json } => show(model, *json),
        Args::Pack { run, out: to, notes, dead_zone, observer, reach } => {
            output::may_create(to)?;
            let mut model = checkpoint::load(&model_path(run), None)?;
            if let Some(dead_zone) = dead_zone {
                model.card.net.dead_zone = *dead_zone;
                model.card.net.check()?;
            }
            if let Some(observer) = observer {
                model.card.may_observe(*observer)?;
                model.card.observer = *observer;
            }
            if let Some(notes) = notes {
                model.card.training.notes.clone_from(notes);
            }
            if let Some(data) = reach {
                let data = Dataset::open(data, Verify::Full)?;
                model.card.reach = Some(fit::reach(&data, &model.card)?);
            }
            checkpoint::save_half(to, &model)?;
            let bytes = std::fs::metadata(to).map_or(0, |m| m.len());
            out::line(&format!("{}: {:.2} MB", to.display(), bytes as f64 / 1e6))
        }
    }
}

fn ls(json: bool) -> Outcome {
    let found = shipped::all()?;
    if json {
        let rows: Vec<Value> = found
            .iter()
            .map(|m| {
                json!({
                    "robot": m.robot, "name": m.name, "bytes": m.bytes,
                    "parameters": parameters(&m.card), "tokens": m.card.tokens.kind,
                    "default": m.name == shipped::DEFAULT,
                    "policy": asked_as(&m.name, &m.card), "suits": case(&m.card).0,
                    "precision": m.card.training.precision,
                    "data": {
                        "agents": m.card.training.agents,
                        "sha256": m.card.training.dataset_sha256,
                    },
                })
            })
            .collect();
        return out::json(&rows);
    }
    let mut t =
        out::table(&["robot", "policy", "for", "learned from", "size", "Precision by suite"]);
    for m in &found {
        // Whole suites only; the card lists their tasks (`manual/fire`).
        let whole = m.card.training.precision.iter().filter(|(suite, _)| !suite.contains('/'));
        let suites = whole.map(|(s, p)| format!("{s} {p:.5}"));
        t.add_row([
            m.robot.clone(),
            asked_as(&m.name, &m.card),
            case(&m.card).0.to_owned(),
            learned_from(&m.card),
            format!("{:.1} MB", m.bytes as f64 / 1e6),
            suites.collect::<Vec<_>>().join(", "),
        ]);
    }
    if found.is_empty() {
        return out::line("this build contains no trained policies; robert train makes one");
    }
    out::line(&t.to_string())
}

/// The transitions that a model learned from, by agent: `0.80 M babble, 0.80 M noise`.
fn learned_from(card: &Card) -> String {
    let millions = |n: u64| n as f64 / 1e6;
    let agents = &card.training.agents;
    let each = agents.iter().map(|(agent, n)| format!("{:.2} M {agent}", millions(*n)));
    each.collect::<Vec<_>>().join(", ")
}

/// The argument of `--policy` that selects a built-in model with its best options.
fn asked_as(name: &str, card: &Card) -> String {
    let default = PolicyConfig { guide: case(card).1, ..PolicyConfig::new(PolicyName::Robert) };
    let named = name != shipped::DEFAULT;
    PolicyConfig { model_path: named.then(|| name.into()), ..default }.label()
}

fn show(model: &str, json: bool) -> Outcome {
    let all = shipped::all()?;
    let called = |m: &shipped::ShippedModel| format!("{}/{}", m.robot, m.name);
    let inside = all.iter().find(|m| called(m) == model);
    let card = match inside {
        Some(m) => m.card.clone(),
        None if !Path::new(model).exists() => {
            let known: Vec<String> =
                all.iter().map(called).chain(runs_near(model.as_ref())).collect();
            return Err(Failure::usage(format!(
                "no model {model}; the built-in models are {}; a model file also works",
                known.join(", ")
            )));
        }
        None => checkpoint::read_card(&model_path(model.as_ref()))?,
    };
    if json {
        return out::json(&card);
    }
    let net = &card.net;
    let mut t = out::table(&["", ""]);
    let training = &card.training;
    let rows = [
        ("robot", card.robot.id.clone()),
        ("for", case(&card).0.to_owned()),
        ("state, action", format!("{}, {}", card.facts.joints.len(), card.facts.actions)),
        (
            "observer",
            match card.observer {
                0 => "off".to_owned(),
                percent => format!("{percent} % (off: --policy robert:MODEL+observer=0)"),
            },
        ),
        ("network", format!("{} layers of {}, {} heads", net.layers, net.width, net.heads)),
        ("parameters", parameters(&card).to_string()),
        ("tokens, skip", format!("{:?}, {:?}", card.tokens.kind, net.skip).to_lowercase()),
        ("action bins", net.bins.to_string()),
        ("masks", format!("{:?}", card.mask_granularity).to_lowercase()),
        ("learned from", learned_from(&card)),
        ("dataset", training.dataset_sha256.clone()),
        ("seed, step", format!("{}, {}", training.seed, training.step)),
        (
            "Precision",
            training
                .precision
                .iter()
                .map(|(s, p)| format!("{s} {p:.5}"))
                .collect::<Vec<_>>()
                .join("\n"),
        ),
        ("notes", training.notes.clone()),
    ];
    for (name, value) in rows {
        t.add_row([name.to_owned(), value]);
    }
    out::line(&t.to_string())
}

fn parameters(card: &Card) -> usize {
    crate::net::params::Layout::new(&card.net).count()
}
