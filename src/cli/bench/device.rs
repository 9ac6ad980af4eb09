//! `robert bench train --device gpu`: windows per second on a graphics card.

use std::time::Instant;

use serde::Serialize;

use super::clock::median;
use super::engine::{Size, Sizes, fill};
use crate::cli::failure::Outcome;
use crate::cli::out;
use crate::gpu::{Arithmetic, Device, GpuEngine, adapter};
use crate::net::{AdamConfig, Batch, Engine, Net, Setup};

#[derive(Serialize)]
struct Row {
    device: String,
    size: &'static str,
    batch: usize,
    /// Windows that the card computes at once.
    windows_at_once: usize,
    memory_mib: u64,
    windows_per_sec: f64,
    gflops: f64,
    wall_ms_per_step: f64,
}

/// Measures all sizes on the card of this number, or the first.
pub(super) fn run(
    on: (Option<usize>, Arithmetic),
    sizes: &Sizes,
    batch: Option<usize>,
    threads: usize,
    secs: f64,
    json: bool,
) -> Outcome {
    let mut rows = Vec::new();
    for size in sizes.iter() {
        rows.push(measure(on, size, batch.unwrap_or(size.batch()), threads, secs)?);
    }
    if json {
        return out::json(&serde_json::json!({"sizes": rows}));
    }
    let mut table =
        out::table(&["size", "batch", "at once", "MiB", "windows/s", "GFLOP/s", "ms/step"]);
    for r in &rows {
        table.add_row([
            r.size.to_owned(),
            r.batch.to_string(),
            r.windows_at_once.to_string(),
            r.memory_mib.to_string(),
            format!("{:.0}", r.windows_per_sec),
            format!("{:.0}", r.gflops),
            format!("{:.1}", r.wall_ms_per_step),
        ]);
    }
    out::line(&table.to_string())?;
    let name = rows.first().map(|r| r.device.clone()).unwrap_or_default();
    out::line(&format!("on {name}"))
}

fn measure(
    on: (Option<usize>, Arithmetic),
    size: Size,
    batch: usize,
    threads: usize,
    secs: f64,
) -> Outcome<Row> {
    let setup = Setup {
        net: Net::<f32>::init(size.config(), None, 1)?,
        adam: AdamConfig::default(),
        batch,
        threads,
        current_only: false,
        averages: false,
    };
    let mut engine = GpuEngine::new(Device::open(on.0, adapter::software_wanted(), on.1)?, &setup)?;
    let fill = |_: u64, w: usize, slot: usize, to: &mut Batch<f32>| fill(w, slot, to);
    let mut step = |index: u64| -> Outcome<f64> {
        let begin = Instant::now();
        let view = engine.gradient(&fill, index, Some(index + 1))?;
        engine.apply(1e-4, &view, 0.0)?;
        Ok(begin.elapsed().as_secs_f64())
    };
    step(0)?;
    let (begin, mut wall) = (Instant::now(), Vec::new());
    while begin.elapsed().as_secs_f64() < secs || wall.len() < 3 {
        wall.push(step(1 + wall.len() as u64)?);
    }
    let wall = median(&mut wall);
    let found = engine.device().unwrap_or_else(|| unreachable!("it is a card"));
    Ok(Row {
        device: found.name,
        size: size.name(),
        batch,
        windows_at_once: found.windows,
        memory_mib: found.bytes >> 20,
        windows_per_sec: batch as f64 / wall,
        gflops: 3.0 * size.forward_flop() * batch as f64 / wall / 1e9,
        wall_ms_per_step: 1e3 * wall,
    })
}
