//! `robert clip ops`: the edits that `robert clip apply` knows.

use crate::cli::failure::{Failure, Outcome};
use crate::cli::out;
use crate::clip::{Operation, operations};

/// List the operations of `robert clip apply` with their arguments.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert clip ops                  all operations\n  robert clip ops keys             those of keys\n  robert clip ops pose.save        one of them\n  robert clip ops --json"
)]
pub(super) struct Ops {
    /// The name of an operation, or the part of it before the dot
    name: Option<String>,
    /// Print them as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Ops) -> Outcome {
    let all = operations();
    let wanted = |one: &&Operation| {
        let name = args.name.as_deref();
        name.is_none_or(|n| one.name == n || one.name.split('.').next() == Some(n))
    };
    let found: Vec<&Operation> = all.iter().filter(wanted).collect();
    if found.is_empty() {
        let names: Vec<_> = all.iter().map(|one| one.name.as_str()).collect();
        let name = args.name.as_deref().unwrap_or_default();
        let message = format!("there is no operation \"{name}\"; there are {}", names.join(", "));
        return Err(Failure::usage(message));
    }
    if args.json {
        return out::json(&found);
    }
    out::line(&found.into_iter().map(page).collect::<Vec<_>>().join("\n\n"))
}

/// An operation and a line for each of its arguments.
fn page(one: &Operation) -> String {
    let wide = |of: fn(&crate::clip::Argument) -> &str| {
        one.args.iter().map(|a| of(a).chars().count()).max().unwrap_or(0)
    };
    let (name, kind) = (wide(|a| &a.name), wide(|a| &a.kind));
    let line = |a: &crate::clip::Argument| {
        let optional = if a.required { "" } else { " Optional." };
        format!("\n  {:name$}  {:kind$}  {}{optional}", a.name, a.kind, a.about)
    };
    let lines: String = one.args.iter().map(line).collect();
    format!("{}: {}{lines}", one.name, one.about)
}
