//! `robert runs`: training runs as tables, side by side, and as a chart.

use robert_base::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::failure::{Failure, Outcome};
use super::out;
use crate::plot::{self, Axis};
use crate::train::Evaluation;
use crate::train::record::{Record, runs_in};
use crate::train::{TrainConfig, curves};

#[derive(clap::Subcommand, Debug)]
#[command(
    after_help = "Examples:\n  robert runs ls\n  robert runs show runs/first\n  robert runs show runs/first --json | jq .best\n  robert runs compare runs/a runs/b -o compare.png"
)]
pub(super) enum Args {
    /// List the runs in a folder.
    #[command(after_help = "Examples:\n  robert runs ls\n  robert runs ls runs/sweep --json")]
    Ls {
        /// Folder of the runs.
        #[arg(default_value = "runs")]
        dir: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Show a run: settings, best and last checkpoint task by task, held-out errors.
    #[command(
        after_help = "Examples:\n  robert runs show runs/first\n  robert runs show runs/first --json | jq .best"
    )]
    Show {
        /// Run directory.
        run: PathBuf,
        /// Also draw its curves to this file; the run directory has its own curves.png.
        #[arg(short, long, alias = "output", value_name = "FILE")]
        out: Option<PathBuf>,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Compare runs: the settings that differ, and their best and last checkpoints side by side.
    #[command(after_help = "Examples:\n  robert runs compare runs/a runs/b -o compare.png")]
    Compare {
        /// Run directories.
        #[arg(required = true, num_args = 2..)]
        runs: Vec<PathBuf>,
        /// Draw the Precision of all runs over training.
        #[arg(short, long, alias = "output", value_name = "FILE")]
        out: Option<PathBuf>,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
}

pub(super) fn run(args: &Args) -> Outcome {
    match args {
        Args::Ls { dir, json } => ls(dir, *json),
        Args::Show { run, out, json } => show(run, out.as_deref(), *json),
        Args::Compare { runs, out, json } => compare(runs, out.as_deref(), *json),
    }
}

fn cell(x: Option<f64>) -> String {
    out::number(x, 5)
}

fn brief(r: &Record) -> Value {
    let at = |e: Option<(u64, &Evaluation)>| e.map(|(s, e)| json!({"step": s, "found": e}));
    json!({
        "name": r.name,
        "dir": r.dir,
        "robot": r.robot,
        "preset": r.config.preset,
        "step": r.step,
        "steps": r.config.steps,
        "secs": r.secs,
        "windows_per_sec": r.windows_per_sec(),
        "best": at(r.best()),
        "last": at(r.last()),
        "linear": r.linear,
        "held_out": r.held_out(),
    })
}

fn ls(dir: &Path, json: bool) -> Outcome {
    // The folder comes with the first run.
    let none = dir == Path::new("runs") && !dir.exists();
    let runs = if none { Vec::new() } else { runs_in(dir)? };
    if json {
        return out::json(&runs.iter().map(brief).collect::<Vec<_>>());
    }
    if runs.is_empty() {
        return out::line(&format!("no runs in {}", dir.display()));
    }
    let mut t = out::table(&[
        "run", "robot", "preset", "step", "of", "minutes", "best", "at", "last", "linear",
    ]);
    for r in &runs {
        t.add_row([
            r.name.clone(),
            r.robot.clone(),
            r.config.preset.clone(),
            r.step.to_string(),
            r.config.steps.to_string(),
            format!("{:.1}", r.secs / 60.0),
            cell(r.best().map(|b| b.1.precision)),
            r.best().map_or_else(|| "-".to_owned(), |b| b.0.to_string()),
            cell(r.last().map(|b| b.1.precision)),
            cell(r.linear.as_ref().map(|l| l.precision)),
        ]);
    }
    out::right(&mut t, 1);
    out::line(&t.to_string())?;
    out::line("Precision in closed loop, mean over suites, rad or m: lower is better")
}

fn show(dir: &Path, output: Option<&Path>, json: bool) -> Outcome {
    let r = Record::read(dir)?;
    if let Some(path) = output {
        let figure = curves::figure(&r);
        let none =
            || Failure::invalid(format!("there are no metrics to draw yet: {}", dir.display()));
        super::plot::save(&figure.ok_or_else(none)?, path)?;
    }
    if json {
        let mut value = brief(&r);
        value["config"] = json::value(&r.config);
        value["evaluations"] =
            r.evaluations.iter().map(|(s, e)| json!({"step": s, "found": e})).collect();
        return out::json(&value);
    }
    out::line(&format!(
        "{}: {} with preset {}, step {} of {}, {:.1} min, {:.0} windows/s",
        r.name,
        if r.robot.is_empty() { "unknown robot" } else { &r.robot },
        r.config.preset,
        r.step,
        r.config.steps,
        r.secs / 60.0,
        r.windows_per_sec()
    ))?;
    let preset = TrainConfig::preset(&r.config.preset).unwrap_or_default();
    let (own, base) = (settings(&r.config), settings(&preset));
    let changed: Vec<String> = own
        .iter()
        .filter(|(k, v)| base.get(*k) != Some(v))
        .map(|(k, v)| format!("{k}={v}"))
        .collect();
    if !changed.is_empty() {
        out::line(&format!("settings that differ from the preset: {}", changed.join(", ")))?;
    }
    let (best, last) = (r.best(), r.last());
    if best.is_some() || r.linear.is_some() {
        let head = |what: &str, e: Option<(u64, &Evaluation)>| {
            e.map_or_else(|| what.to_owned(), |(step, _)| format!("{what}, step {step}"))
        };
        let (b, l) = (head("best", best), head("last", last));
        let mut t = out::table(&["task", &b, &l, "linear prediction"]);
        let at =
            |e: Option<&Evaluation>, task: &str| cell(e.and_then(|e| e.suites.get(task).copied()));
        for task in r.tasks() {
            t.add_row([
                task.clone(),
                at(best.map(|b| b.1), &task),
                at(last.map(|b| b.1), &task),
                at(r.linear.as_ref(), &task),
            ]);
        }
        t.add_row([
            "mean over suites".to_owned(),
            cell(best.map(|b| b.1.precision)),
            cell(last.map(|b| b.1.precision)),
            cell(r.linear.as_ref().map(|l| l.precision)),
        ]);
        out::right(&mut t, 1);
        out::line(&t.to_string())?;
        out::line(
            "Precision, rad or m; the best checkpoint was chosen on these tasks, so its figures are slightly too good",
        )?;
    }
    if r.worse_than_linear() {
        out::line(
            "warning: the last checkpoint is worse than the linear prediction it started from",
        )?;
    }
    let Some(h) = r.held_out() else { return Ok(()) };
    out::line("\nheld-out action error, share of the actions' variance")?;
    let mut t = out::table(&["frames", "share", "nMSE"]);
    let places = ["clear", "at a stop", "in contact"].into_iter().zip(h.shares);
    for ((place, share), nmse) in places.zip([h.nmse_clear, h.nmse_stop, h.nmse_contact]) {
        let name = format!("next known, {place}");
        t.add_row([name, format!("{:.1} %", 100.0 * share), out::number(nmse, 4)]);
    }
    for (hidden, nmse) in h.nmse_by_hidden.iter().enumerate() {
        if [0, 1, 2, 4, 8, 12, 16, 19].contains(&hidden) {
            t.add_row([format!("{hidden} hidden"), String::new(), out::number(*nmse, 4)]);
        }
    }
    out::right(&mut t, 1);
    out::line(&t.to_string())
}

/// Settings as words.
fn settings(config: &TrainConfig) -> BTreeMap<String, String> {
    let table = toml::Table::try_from(config).unwrap_or_default();
    let word = |v: &toml::Value| v.as_str().map_or_else(|| v.to_string(), str::to_owned);
    table.iter().map(|(k, v)| (k.clone(), word(v))).collect()
}

fn compare(dirs: &[PathBuf], output: Option<&Path>, json: bool) -> Outcome {
    let runs = dirs.iter().map(|d| Record::read(d)).collect::<Result<Vec<_>, _>>()?;
    let all: Vec<_> = runs.iter().map(|r| settings(&r.config)).collect();
    let differ = |key: &&String| all.iter().any(|s| s.get(*key) != all[0].get(*key));
    let keys: Vec<String> = all[0].keys().filter(differ).cloned().collect();
    if let Some(path) = output {
        let lines: Vec<_> = runs.iter().map(curves::precision_curve).collect();
        let title = "closed-loop Precision over training";
        let y = Axis::new("Precision", "rad or m").log();
        super::plot::save(&plot::curves(title, &lines, Axis::new("step", ""), y), path)?;
    }
    if json {
        let settings: BTreeMap<&String, Vec<Option<&String>>> =
            keys.iter().map(|k| (k, all.iter().map(|s| s.get(k)).collect())).collect();
        let runs: Vec<_> = runs.iter().map(brief).collect();
        return out::json(&json!({"settings": settings, "runs": runs}));
    }
    let mut header = vec![String::new()];
    header.extend(runs.iter().map(|r| r.name.clone()));
    let mut t = out::table(&header.iter().map(String::as_str).collect::<Vec<_>>());
    let mut row = |name: String, of: &dyn Fn(&Record) -> String| {
        t.add_row(std::iter::once(name).chain(runs.iter().map(of)));
    };
    for key in &keys {
        row(key.clone(), &|r| settings(&r.config).get(key).cloned().unwrap_or_default());
    }
    row("steps done".into(), &|r| r.step.to_string());
    row("minutes".into(), &|r| format!("{:.1}", r.secs / 60.0));
    row("best Precision".into(), &|r| cell(r.best().map(|b| b.1.precision)));
    row("  at step".into(), &|r| r.best().map_or_else(|| "-".to_owned(), |b| b.0.to_string()));
    row("last Precision".into(), &|r| cell(r.last().map(|b| b.1.precision)));
    row("linear prediction".into(), &|r| cell(r.linear.as_ref().map(|l| l.precision)));
    let mut tasks: Vec<String> = runs.iter().flat_map(Record::tasks).collect();
    tasks.sort_by_key(|t| (t.contains('/'), t.clone()));
    tasks.dedup();
    for task in &tasks {
        row(format!("best {task}"), &|r| {
            cell(r.best().and_then(|b| b.1.suites.get(task).copied()))
        });
        row(format!("last {task}"), &|r| {
            cell(r.last().and_then(|b| b.1.suites.get(task).copied()))
        });
    }
    row("held out, clear".into(), &|r| cell(r.held_out().and_then(|h| h.nmse_clear)));
    for hidden in [0, 4, 16] {
        row(format!("held out, {hidden} hidden"), &|r| {
            cell(r.held_out().and_then(|h| h.nmse_by_hidden.get(hidden).copied().flatten()))
        });
    }
    out::right(&mut t, 1);
    out::line(&t.to_string())
}
