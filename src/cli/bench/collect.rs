//! `robert bench collect`: the roll-out phase against bare simulation of the same episodes,
//! the time of one update of each agent, and reading windows back.

use std::panic::resume_unwind;
use std::path::PathBuf;
use std::sync::{Arc, Barrier};
use std::thread::ScopedJoinHandle;
use std::time::Instant;

use serde::Serialize;

use super::clock::{median, thread_cpu};
use crate::cli::failure::{Failure, Outcome};
use crate::cli::global::thread_count;
use crate::cli::out;
use crate::dataset::{Dataset, Part, Verify, Windows};
use crate::explore::{AgentKind, Preset, RolloutBench, UpdateBench};
use crate::net::WINDOW;
use crate::robot::Robot;

/// Windows in a batch, as in training.
const BATCH: usize = 512;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert bench collect --robot ur5e --json\n  robert bench collect --data data/ur5e"
)]
pub(super) struct Args {
    /// Robots [default: the three of the paper].
    #[arg(long, value_delimiter = ',', default_value = "pointmass,ur5e,shadow_hand")]
    robot: Vec<String>,
    /// Threads for the roll-outs.
    #[arg(long, default_value_t = 2, value_parser = thread_count())]
    threads: usize,
    /// Turns; the report gives the median.
    #[arg(long, default_value_t = 5)]
    turns: usize,
    /// Frames per roll-out turn and thread.
    #[arg(long, default_value_t = 4000, value_name = "N", value_parser = crate::units::count)]
    frames: u64,
    /// Updates per turn.
    #[arg(long, default_value_t = 20)]
    updates: usize,
    /// Sizes of the agents.
    #[arg(long, default_value = "url-fast")]
    preset: String,
    /// Measure how fast windows of this dataset are read instead.
    #[arg(long)]
    data: Option<PathBuf>,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Row {
    robot: String,
    threads: usize,
    /// Frames per second of wall time on all threads, with policy network, records and files.
    rollout_frames_per_sec: f64,
    /// Frames per second of wall time for the same episodes with nothing but simulation.
    bare_frames_per_sec: f64,
    /// Processor time of bare simulation divided by that of the roll-out, median over turns.
    ratio_to_bare: f64,
    /// Milliseconds of processor time of one update, by agent.
    update_cpu_ms: Vec<(String, f64)>,
}

#[derive(Serialize)]
struct Reading {
    windows: usize,
    frames: usize,
    threads: usize,
    batch_bytes: usize,
    gigabytes_per_sec: f64,
}

pub(super) fn run(args: &Args) -> Outcome {
    if args.turns == 0 || args.updates == 0 {
        return Err(Failure::usage("--turns and --updates take 1 or more"));
    }
    if let Some(data) = &args.data {
        return read(args, data);
    }
    let preset = Preset::named(&args.preset)?;
    let mut rows = Vec::new();
    for id in &args.robot {
        let robot = Arc::new(Robot::load(id)?);
        let (rollout, bare, ratio) = roll_out(&robot, args, preset.hidden)?;
        let mut update_cpu_ms = Vec::new();
        for kind in AgentKind::ALL.into_iter().filter(|k| k.learns()) {
            update_cpu_ms.push((kind.name().to_owned(), update(&robot, kind, &preset, args)));
        }
        rows.push(Row {
            robot: id.clone(),
            threads: args.threads,
            rollout_frames_per_sec: rollout.round(),
            bare_frames_per_sec: bare.round(),
            ratio_to_bare: ratio,
            update_cpu_ms,
        });
    }
    if args.json {
        return out::json(&rows);
    }
    let mut table =
        out::table(&["robot", "roll-out frames/s", "bare", "ratio (cpu)", "update, cpu ms"]);
    for r in &rows {
        let updates: Vec<String> =
            r.update_cpu_ms.iter().map(|(n, ms)| format!("{n} {ms:.2}")).collect();
        table.add_row([
            r.robot.clone(),
            format!("{:.0}", r.rollout_frames_per_sec),
            format!("{:.0}", r.bare_frames_per_sec),
            format!("{:.3}", r.ratio_to_bare),
            updates.join("  "),
        ]);
    }
    out::line(&table.to_string())
}

/// (roll-out frames/s, bare frames/s, ratio in processor time).
fn roll_out(robot: &Arc<Robot>, args: &Args, hidden: usize) -> Outcome<(f64, f64, f64)> {
    let barrier = Barrier::new(args.threads);
    let results = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..args.threads as u64)
            .map(|i| {
                let barrier = &barrier;
                scope.spawn(move || turns(robot, args, hidden, i, barrier))
            })
            .collect();
        handles.into_iter().map(std::thread::ScopedJoinHandle::join).collect::<Vec<_>>()
    });
    let (mut ours, mut bare, mut ratios) = (0.0, 0.0, Vec::new());
    for result in results {
        let died = |_| Failure::with(crate::exit::Exit::Failed, "a worker died");
        let (a, b, ratio) = result.map_err(died)??;
        ours += a;
        bare += b;
        ratios.push(ratio);
    }
    Ok((ours, bare, median(&mut ratios)))
}

fn turns(
    robot: &Arc<Robot>,
    args: &Args,
    hidden: usize,
    index: u64,
    barrier: &Barrier,
) -> Outcome<(f64, f64, f64)> {
    let dir = tempfile::tempdir()?;
    let bench = RolloutBench::new(robot, hidden, index);
    // All threads wait, also for one that failed, because a barrier cannot report errors.
    barrier.wait();
    let mut bench = bench?;
    let (mut ours, mut bare, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..args.turns {
        let (start, cpu) = (Instant::now(), thread_cpu());
        let frames = bench.roll_out(dir.path(), args.frames as usize)? as f64;
        let own = thread_cpu().saturating_sub(cpu).as_secs_f64() / frames;
        ours.push(frames / start.elapsed().as_secs_f64());
        bench.prepare(dir.path())?;
        let (start, cpu) = (Instant::now(), thread_cpu());
        let frames = bench.simulate()? as f64;
        ratios.push(thread_cpu().saturating_sub(cpu).as_secs_f64() / frames / own);
        bare.push(frames / start.elapsed().as_secs_f64());
    }
    Ok((median(&mut ours), median(&mut bare), median(&mut ratios)))
}

/// Processor milliseconds of one update, median over turns.
fn update(robot: &Robot, kind: AgentKind, preset: &Preset, args: &Args) -> f64 {
    let Some(mut bench) = UpdateBench::new(kind, preset, robot.state_dim(), robot.action_dim())
    else {
        return 0.0;
    };
    bench.update();
    let mut times: Vec<f64> = (0..args.turns)
        .map(|_| {
            let cpu = thread_cpu();
            (0..args.updates).for_each(|_| bench.update());
            thread_cpu().saturating_sub(cpu).as_secs_f64() * 1e3 / args.updates as f64
        })
        .collect();
    median(&mut times)
}

/// Batches of random windows from the page cache.
fn read(args: &Args, path: &std::path::Path) -> Outcome {
    let data = Dataset::open(path, Verify::Full)?;
    let windows = Windows::new(&data, WINDOW, Part::Train, 0)?;
    let m = data.manifest();
    let (s, a) = (m.qpos_dim(), m.ctrl_dim());
    let share = BATCH.div_ceil(args.threads);
    let bytes = share * args.threads * WINDOW * (s + a) * 4;
    let barrier = Barrier::new(args.threads);
    let repeats = (2_000_000_000 / bytes).clamp(10, 2000) as u64;
    let rates: Vec<f64> = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..args.threads as u64)
            .map(|t| {
                let (windows, barrier) = (&windows, &barrier);
                scope.spawn(move || {
                    let mut qpos = vec![0.0; share * WINDOW * s];
                    let mut ctrl = vec![0.0; share * WINDOW * a];
                    barrier.wait();
                    let mut rates: Vec<f64> = (0..args.turns as u64)
                        .map(|turn| {
                            let start = Instant::now();
                            for i in 0..repeats {
                                let first = (turn * repeats + i) * BATCH as u64 + t * share as u64;
                                windows.fill(1, first, &mut qpos, &mut ctrl);
                            }
                            let bytes = repeats as f64 * (bytes / args.threads) as f64;
                            bytes / 1e9 / start.elapsed().as_secs_f64()
                        })
                        .collect();
                    median(&mut rates)
                })
            })
            .collect();
        let rate = |h: ScopedJoinHandle<'_, f64>| h.join().unwrap_or_else(|e| resume_unwind(e));
        handles.into_iter().map(rate).collect()
    });
    let reading = Reading {
        windows: BATCH,
        frames: WINDOW,
        threads: args.threads,
        batch_bytes: bytes,
        gigabytes_per_sec: rates.iter().sum(),
    };
    if args.json {
        return out::json(&reading);
    }
    out::line(&format!(
        "{} windows x {} frames ({} bytes), {} threads: {:.2} GB/s",
        BATCH, WINDOW, bytes, args.threads, reading.gigabytes_per_sec
    ))
}
