//! `robert bench train`: windows per second, and the ratio to the peak of the machine's vector
//! instructions (it may be above 1 on a machine with a tile unit).

use std::time::Instant;

use serde::Serialize;

use super::clock::{median, process_cpu};
use super::engine::{Size, Sizes, fill, peak};
use crate::cli::failure::{Failure, Outcome};
use crate::cli::global::thread_count;
use crate::cli::out;
use crate::gpu::{Arithmetic, Choice};
use crate::net::{AdamConfig, Learner, Net};

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert bench train --json\n  ROBERT_AMX=off robert bench train    # without the tile unit of a processor that has one\n  robert bench train --device gpu --size L --batch 128\n\nAgainst PyTorch, in turns: python benches/peers/compare.py"
)]
pub(super) struct Args {
    #[command(flatten)]
    sizes: Sizes,
    /// Windows per step [default: 256, or 16 at size L].
    #[arg(long)]
    batch: Option<usize>,
    /// Threads.
    #[arg(long, default_value_t = 2, value_parser = thread_count())]
    threads: usize,
    /// Measures the processor, or a graphics card: gpu or gpu:N.
    #[arg(long, value_name = "cpu|gpu[:N]", default_value_t = Choice::Cpu)]
    device: Choice,
    /// Let the card multiply 16-bit factors on its matrix units.
    #[arg(long)]
    half: bool,
    /// Seconds per size.
    #[arg(long, default_value_t = 10.0)]
    secs: f64,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    /// Rate of large products on all threads, by vector instructions.
    peak_gflops: f64,
    /// Whether training also used the tile unit. Its rate may then be above the peak of vector
    /// instructions.
    tiles: bool,
    sizes: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    size: &'static str,
    batch: usize,
    threads: usize,
    windows_per_sec: f64,
    gflops: f64,
    /// Operations per second of processor time, divided by the peak that was measured in turns with
    /// the steps.
    fraction_of_peak: f64,
    cpu_ms_per_step: f64,
    wall_ms_per_step: f64,
}

pub(super) fn run(args: &Args) -> Outcome {
    if !(0.1..=600.0).contains(&args.secs) {
        return Err(Failure::usage("--secs takes 0.1 to 600"));
    }
    if args.batch.is_some_and(|b| !(1..=1 << 16).contains(&b)) {
        return Err(Failure::usage("--batch takes 1 to 65536"));
    }
    let number = match args.device {
        Choice::Cpu if args.half => {
            return Err(Failure::usage("--half is for graphics cards: add --device gpu"));
        }
        Choice::Cpu => None,
        Choice::Auto => return Err(Failure::usage("--device takes cpu, gpu or gpu:N here")),
        Choice::Gpu(number) => Some(number),
    };
    if let Some(number) = number {
        let arithmetic = if args.half { Arithmetic::Half } else { Arithmetic::Single };
        let Args { sizes, batch, threads, secs, json, .. } = args;
        let on = (number, arithmetic);
        return super::device::run(on, sizes, *batch, *threads, *secs, *json);
    }
    let (mut rows, mut peaks) = (Vec::new(), Vec::new());
    for size in args.sizes.iter() {
        let batch = args.batch.unwrap_or(size.batch());
        let (row, mut found) = measure(size, batch, args.threads, args.secs)?;
        rows.push(row);
        peaks.append(&mut found);
    }
    let report = Report {
        peak_gflops: median(&mut peaks) / 1e9,
        tiles: crate::linalg::tiled(),
        sizes: rows,
    };
    if args.json {
        return out::json(&report);
    }
    let mut table =
        out::table(&["size", "batch", "threads", "windows/s", "GFLOP/s", "of peak", "ms/step"]);
    for r in &report.sizes {
        table.add_row([
            r.size.to_owned(),
            r.batch.to_string(),
            r.threads.to_string(),
            format!("{:.0}", r.windows_per_sec),
            format!("{:.0}", r.gflops),
            format!("{:.0} %", 100.0 * r.fraction_of_peak),
            format!("{:.1}", r.wall_ms_per_step),
        ]);
    }
    out::line(&table.to_string())?;
    let tiles = if report.tiles {
        "; training used the tile unit, too (without: ROBERT_AMX=off)"
    } else {
        ""
    };
    out::line(&format!("peak of vector instructions {:.0} GFLOP/s{tiles}", report.peak_gflops))
}

/// Measures steps and products in turns, so that a busy or throttled machine slows both.
fn measure(size: Size, batch: usize, threads: usize, secs: f64) -> Outcome<(Row, Vec<f64>)> {
    let net = Net::<f32>::init(size.config(), None, 1)?;
    let mut learner = Learner::new(net, AdamConfig::default(), batch, threads);
    learner.step(1e-4, &fill);
    let begin = Instant::now();
    learner.step(1e-4, &fill);
    let per_turn = (0.8 / begin.elapsed().as_secs_f64()).ceil().clamp(1.0, 1000.0) as usize;
    let (mut cpu, mut wall, mut ratios, mut peaks) = (vec![], vec![], vec![], vec![]);
    let flop = 3.0 * size.forward_flop() * batch as f64;
    let begin = Instant::now();
    while begin.elapsed().as_secs_f64() < secs || cpu.len() < 3 {
        let (peak_cpu, peak_wall) = peak(threads, 0.5);
        let (cpu0, wall0) = (process_cpu(), Instant::now());
        for _ in 0..per_turn {
            learner.step(1e-4, &fill);
        }
        let spent = ((process_cpu() - cpu0).as_secs_f64() / per_turn as f64).max(1e-9);
        cpu.push(spent);
        wall.push(wall0.elapsed().as_secs_f64() / per_turn as f64);
        ratios.push(flop / spent * threads as f64 / peak_cpu.max(1.0));
        peaks.push(peak_wall);
    }
    let (cpu, wall) = (median(&mut cpu), median(&mut wall));
    let row = Row {
        size: size.name(),
        batch,
        threads,
        windows_per_sec: batch as f64 / wall,
        gflops: flop / wall / 1e9,
        fraction_of_peak: median(&mut ratios),
        cpu_ms_per_step: 1e3 * cpu,
        wall_ms_per_step: 1e3 * wall,
    };
    Ok((row, peaks))
}
