//! `robert sweep FILE`: trains a grid of settings, and writes a table and a chart.

use std::io;
use std::path::PathBuf;
use std::sync::Arc;

use super::bar::Bar;
use super::failure::{Failure, Outcome};
use super::global::Global;
use super::interrupt::cancel_on_ctrl_c;
use super::{device, motion, out, output, pool};
use crate::exit::Exit;
use crate::fsio;
use crate::rollout::Interval;
use crate::shard::Pool;
use crate::train::points::{Points, Swept, sweep};
use crate::train::sweep::{Row, Sweep, Work, figure};
use crate::units::Unit;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert sweep assets/sweeps/masking.toml --data data/pointmass --out sweeps/masking\n  robert sweep my.toml --data data/ur5e --set steps=500 --out sweeps/my --json\n  robert sweep my.toml --data data/ur5e --out sweeps/my --jobs 4\n  robert sweep my.toml --data data/ur5e --out sweeps/my --device gpu\n\nThe same command continues a stopped sweep. Each point is a run directory below OUT/points,\nwhich robert runs show can read."
)]
pub(super) struct Args {
    /// The file with the grid, its seeds and its suites.
    file: PathBuf,
    /// Dataset folder [default: that of the file].
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder for points, table.csv, results.json and sweep.png.
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Change one setting of all points; may be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Points that are trained at once, each in its own process. Small networks then use the cores
    /// better.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: u16,
    /// Threads of a point [default: all cores, divided by --jobs]. They do not change the figures.
    #[arg(long, value_name = "N", value_parser = super::global::thread_count())]
    threads: Option<usize>,
    #[command(flatten)]
    on: device::On,
    /// Read the numbers of points from stdin and answer each with a line of JSON.
    #[arg(long, hide = true)]
    stdin: bool,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    let file = Sweep::load(&args.file, &args.set)?;
    let Some(data) = args.data.clone().or_else(|| file.data.clone()) else {
        return Err(Failure::usage("the file names no data: give --data DIR"));
    };
    output::may_be_folder(&args.out)?;
    let robot = motion::robot(&file.robot)?;
    let request = args.on.request()?;
    let bar = Bar::new("sweep", "points", global.quiet);
    let cancel = cancel_on_ctrl_c();
    let work = Work {
        data: data.clone(),
        out: args.out.clone(),
        threads: args
            .threads
            .unwrap_or_else(|| (super::global::cores() / usize::from(args.jobs)).max(1)),
        checkpoint_secs: 120.0,
        engines: Some(&request),
        progress: &bar,
        cancel: &cancel,
        meta: serde_json::json!({
            "version": env!("CARGO_PKG_VERSION"),
            "argv": std::env::args().collect::<Vec<_>>(),
        }),
    };
    if args.stdin {
        let points = Points::open(&file, &robot, &work)?;
        return pool::serve(|index| match points.reach(index)? {
            None => Err(Failure::with(Exit::Interrupted, "stopped")),
            Some(_) => Ok(()),
        });
    }
    if args.jobs > 1 {
        in_pool(args, &Points::open(&file, &robot, &work)?, &work)?;
    }
    let done = sweep(&file, &Arc::clone(&robot), &work);
    bar.finish();
    let Swept { rows, complete, data_sha256 } = done?;
    let report = serde_json::json!({
        "sweep": file,
        "data": data,
        "data_sha256": data_sha256,
        "complete": complete,
        "rows": rows,
    });
    let text = serde_json::to_vec_pretty(&report).map_err(io::Error::other)?;
    fsio::write_atomic(&args.out.join("results.json"), &text)?;
    fsio::write_atomic(&args.out.join("table.csv"), &csv(&rows)?)?;
    let unit = robot.joints().first().map_or(Unit::Rad, |j| j.unit);
    if let Some(figure) = figure(&file, unit, &rows) {
        figure.save(&args.out.join("sweep.png"))?;
    }
    if args.json {
        out::json(&report)?;
    } else if !rows.is_empty() {
        out::line(&table(&file, &rows))?;
    }
    if !complete {
        let hint = format!("stopped; the same command continues in {}", args.out.display());
        return Err(Failure::with(Exit::Interrupted, hint));
    }
    Ok(())
}

/// Performs the points that are not done in the local pool, whose children run this same command.
fn in_pool(args: &Args, points: &Points<'_>, work: &Work<'_>) -> Outcome {
    let left = points.left()?;
    let mut words = vec!["sweep".to_owned(), args.file.display().to_string()];
    for (name, value) in [("--data", &work.data), ("--out", &work.out)] {
        words.extend([name.to_owned(), value.display().to_string()]);
    }
    for assignment in &args.set {
        words.extend(["--set".to_owned(), assignment.clone()]);
    }
    words.extend(["--threads".to_owned(), work.threads.to_string()]);
    words.extend(args.on.words());
    words.push("--stdin".to_owned());
    let workers =
        Pool { binary: std::env::current_exe()?, args: words, jobs: usize::from(args.jobs) };
    let found = workers.run(&left, work.progress, work.cancel)?;
    pool::outcome(&found, left.len(), "points")
}

fn suites(rows: &[Row]) -> Vec<String> {
    rows.first().map_or_else(Vec::new, |r| r.suites.keys().cloned().collect())
}

fn table(file: &Sweep, rows: &[Row]) -> String {
    let (keys, suites) = (file.grid.keys().cloned().collect::<Vec<_>>(), suites(rows));
    let mut header = keys.clone();
    header.extend(suites.iter().cloned());
    header.extend(["held-out nMSE, clear".to_owned(), "seeds".to_owned()]);
    let mut t = out::table(&header.iter().map(String::as_str).collect::<Vec<_>>());
    let cell = |i: Option<Interval>| match i {
        None => "failed".to_owned(),
        Some(i) => {
            format!("{:.5}{}", i.mean, i.ci95.map_or_else(String::new, |c| format!(" ±{c:.5}")))
        }
    };
    for r in rows {
        let values =
            keys.iter().map(|k| r.values.get(k).map_or_else(String::new, ToString::to_string));
        let found = suites.iter().map(|s| cell(r.suites.get(s).copied().flatten()));
        // A run without frames to measure on has not failed.
        let nmse = r.nmse_clear.map_or_else(|| "-".to_owned(), |i| cell(Some(i)));
        let tail = [nmse, r.seeds.to_string()];
        t.add_row(values.chain(found).chain(tail));
    }
    out::right(&mut t, keys.len());
    format!(
        "{}\n{t}\nPrecision of the {} model by suite, rad or m (lower is better), mean ± 95 % interval over seeds",
        file.title,
        if file.evaluations > 0 { "best" } else { "last" }
    )
}

fn csv(rows: &[Row]) -> Outcome<Vec<u8>> {
    let mut w = csv::Writer::from_writer(Vec::new());
    let keys: Vec<String> =
        rows.first().map_or_else(Vec::new, |r| r.values.keys().cloned().collect());
    let suites = suites(rows);
    let mut head = keys.clone();
    head.push("seeds".to_owned());
    for s in suites.iter().map(String::as_str).chain(["nmse_clear"]) {
        head.extend([s.to_owned(), format!("{s}_ci95")]);
    }
    w.write_record(&head).map_err(io::Error::other)?;
    let two = |i: Option<Interval>| {
        let number = |x: Option<f64>| x.map_or_else(String::new, |x| x.to_string());
        [number(i.map(|i| i.mean)), number(i.and_then(|i| i.ci95))]
    };
    for r in rows {
        let mut line: Vec<String> = keys
            .iter()
            .map(|k| r.values.get(k).map_or_else(String::new, ToString::to_string))
            .collect();
        line.push(r.seeds.to_string());
        for s in &suites {
            line.extend(two(r.suites.get(s).copied().flatten()));
        }
        line.extend(two(r.nmse_clear));
        w.write_record(&line).map_err(io::Error::other)?;
    }
    Ok(w.into_inner().map_err(|e| io::Error::other(e.to_string()))?)
}
