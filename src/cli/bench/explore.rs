//! `robert bench explore`: reward and coverage of every collector over steps, in one table.

use std::path::PathBuf;
use std::sync::Arc;

use crate::cli::bar::Bar;
use crate::cli::failure::Outcome;
use crate::cli::{interrupt, out};
use crate::explore::{AgentKind, AgentSummary, Preset, learning_curves};
use crate::plot::{Axis, Curve, Figure, curves};
use crate::robot::Robot;

/// Rows of the table.
const ROWS: usize = 5;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert bench explore --robot ur5e --steps 50k --plot coverage.png"
)]
pub(super) struct Args {
    /// Robot: id, or a folder with robot.xml.
    #[arg(long, default_value = "ur5e")]
    robot: String,
    /// Collectors.
    #[arg(long, value_delimiter = ',', default_value = "rnd,icm,apt,aps,proto,noise,uniform")]
    agent: Vec<AgentKind>,
    /// Environment steps per collector.
    #[arg(long, default_value_t = 200_000, value_name = "N", value_parser = crate::units::count)]
    steps: u64,
    /// Change one setting of url-fast, as in lr=3e-4; may be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seed.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Write a chart of coverage over steps (png or svg).
    #[arg(long)]
    plot: Option<PathBuf>,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Outcome {
    let robot = Arc::new(Robot::load(&args.robot)?);
    let mut preset = Preset::url_fast().lasting(args.steps);
    for assignment in &args.set {
        preset.set(assignment)?;
    }
    let threads = crate::cli::global::cores();
    let cancel = interrupt::cancel_on_ctrl_c();
    let bar = Bar::new("explore", "steps", args.json);
    let done = learning_curves(&robot, &args.agent, &preset, args.seed, threads, &bar, &cancel);
    bar.finish();
    let done = done?;
    if let Some(path) = &args.plot {
        figure(robot.id(), &done).save(path)?;
    }
    if args.json {
        return out::json(&done);
    }
    let names: Vec<&str> = done.iter().map(|a| a.agent.name()).collect();
    let header: Vec<&str> = std::iter::once("steps").chain(names).collect();
    let mut table = out::table(&header);
    let points = done.iter().map(|a| a.curve.len()).min().unwrap_or(0);
    let picks: Vec<usize> = (1..=ROWS).map(|r| (points * r).div_ceil(ROWS)).collect();
    for pick in picks.into_iter().filter(|&p| p > 0) {
        let mut row = Vec::new();
        for a in &done {
            let Some(p) = a.curve.get(pick - 1) else { continue };
            if row.is_empty() {
                row.push(p.step.to_string());
            }
            let pinned = p.near_limit.iter().sum::<f64>() / p.near_limit.len().max(1) as f64;
            row.push(format!(
                "cover {:.1} %\nr {:.3}\nQ {:.2}\n|a| {:.2}\nsat {:.0} %\npinned {:.1} %\ntouch {:.1} %",
                p.coverage * 100.0,
                p.reward,
                p.value,
                p.action,
                p.saturated * 100.0,
                pinned * 100.0,
                p.self_contact * 100.0,
            ));
        }
        table.add_row(row);
    }
    out::line(&table.to_string())
}

fn figure(robot: &str, done: &[AgentSummary]) -> Figure {
    let lines: Vec<Curve> = done
        .iter()
        .map(|a| {
            let points = a.curve.iter().map(|p| (p.step as f64, p.coverage * 100.0)).collect();
            Curve { name: a.agent.name().to_owned(), points, ..Curve::default() }
        })
        .collect();
    let title = format!("{robot}: coverage of coarse state cells");
    curves(
        &title,
        &lines,
        Axis::new("environment steps", ""),
        Axis::new("visited", "%").from_zero(),
    )
}
