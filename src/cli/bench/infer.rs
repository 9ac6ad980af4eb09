//! `robert bench infer`: one action at batch 1, features and linear skip included, on one
//! thread and on two.

use serde::Serialize;

use super::clock::{median, process_cpu, thread_cpu};
use super::engine::{Size, Sizes, peak};
use crate::cli::failure::{Failure, Outcome};
use crate::cli::out;
use crate::net::token::RIDGE_HEADS;
use crate::net::{
    CURRENT, Encoder, Facts, JointFacts, Net, NetConfig, NetPolicy, NetPolicyConfig, Normaliser,
    Ridge, SkipKind, Threads, TokenConfig, Tokeniser, WINDOW,
};

#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  robert bench infer --json")]
pub(super) struct Args {
    #[command(flatten)]
    sizes: Sizes,
    /// Seconds per size.
    #[arg(long, default_value_t = 4.0)]
    secs: f64,
    /// Threads that share one action, 1 or 2.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=2))]
    threads: u8,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    peak_gflops: f64,
    sizes: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    size: &'static str,
    batch: usize,
    threads: usize,
    /// Median wall time of one action.
    ms: f64,
    /// Median processor time of it, all threads together.
    cpu_ms: f64,
    /// Median processor time of one action on one thread.
    one_thread_ms: f64,
    /// The part of it for features and linear prediction.
    encode_ms: f64,
    /// Rate and share of the peak on one thread.
    gflops: f64,
    fraction_of_peak: f64,
}

pub(super) fn run(args: &Args) -> Outcome {
    if !(0.1..=600.0).contains(&args.secs) {
        return Err(Failure::usage("--secs takes 0.1 to 600"));
    }
    let peak = peak(1, 1.0).0;
    let rows: Vec<Row> = args
        .sizes
        .iter()
        .map(|s| measure(s, usize::from(args.threads), args.secs, peak))
        .collect::<Outcome<_>>()?;
    let report = Report { peak_gflops: peak / 1e9, sizes: rows };
    if args.json {
        return out::json(&report);
    }
    let mut table = out::table(&[
        "size",
        "threads",
        "ms/action",
        "ms, one thread",
        "features",
        "GFLOP/s",
        "of peak",
    ]);
    for r in &report.sizes {
        table.add_row([
            r.size.to_owned(),
            r.threads.to_string(),
            format!("{:.3}", r.ms),
            format!("{:.3}", r.one_thread_ms),
            format!("{:.3}", r.encode_ms),
            format!("{:.0}", r.gflops),
            format!("{:.0} %", 100.0 * r.fraction_of_peak),
        ]);
    }
    out::line(&table.to_string())
}

fn measure(size: Size, threads: usize, secs: f64, peak: f64) -> Outcome<Row> {
    let actions = size.config().actions;
    let joint = JointFacts { hinge: true, range: Some([-3.0, 3.0]) };
    let facts = Facts { joints: vec![joint; actions], actions };
    let one = |x: f64| vec![x; actions];
    let norm = Normaliser { mean: one(0.0), std: one(1.0), std_d1: one(0.1), std_d2: one(0.1) };
    let tokens = Tokeniser::new(TokenConfig::for_robot(&facts), facts, &norm)?;
    let inputs = tokens.ridge_inputs();
    let ridge = Ridge::new(inputs, actions, vec![0.01; RIDGE_HEADS * inputs * actions])?;
    let encoder = Encoder::new(tokens, Some(ridge))?;
    let skip = SkipKind::Gated;
    let cfg = NetConfig { inputs: encoder.inputs(), skip, ..size.config() };
    let mut batch = crate::net::Batch::<f32>::zeros(&cfg, 1);
    let net = Net::init(cfg, None, 1)?;
    let of = if threads > 1 { Threads::Two } else { Threads::One };
    let shared = NetPolicyConfig { threads: of, ..NetPolicyConfig::default() };
    let mut shared = NetPolicy::new(net.clone(), encoder.clone(), shared)?;
    let mut policy = NetPolicy::new(net, encoder, NetPolicyConfig::default())?;

    let q: Vec<f32> = (0..WINDOW * actions).map(|i| (i as f32 * 0.01).sin()).collect();
    let mut visible = vec![true; q.len()];
    visible[(CURRENT + 1) * actions..(CURRENT + 15) * actions].fill(false);
    let mut scratch = policy.encoder().scratch();
    let (mut wall, mut cpu, mut all, mut encode) = (vec![], vec![], vec![], vec![]);
    let begin = std::time::Instant::now();
    let mut step = 0;
    while begin.elapsed().as_secs_f64() < secs || all.len() < 5 {
        // Asking the clock costs a microsecond: ten actions at a time.
        let (w0, c0) = (std::time::Instant::now(), process_cpu());
        for _ in 0..10 {
            std::hint::black_box(shared.act(&q, &visible, step));
        }
        wall.push(w0.elapsed().as_secs_f64() / 10.0);
        cpu.push((process_cpu() - c0).as_secs_f64() / 10.0);
        let t0 = thread_cpu();
        for _ in 0..10 {
            std::hint::black_box(policy.act(&q, &visible, step));
            step += 1;
        }
        let t1 = thread_cpu();
        for _ in 0..10 {
            policy.encoder().encode(&q, &visible, &[], &mut scratch, &mut batch, 0);
        }
        let t2 = thread_cpu();
        all.push((t1 - t0).as_secs_f64() / 10.0);
        encode.push((t2 - t1).as_secs_f64() / 10.0);
    }
    let seconds = median(&mut all);
    let rate = used_flop(size) / seconds.max(1e-9);
    Ok(Row {
        size: size.name(),
        batch: 1,
        threads,
        ms: 1e3 * median(&mut wall),
        cpu_ms: 1e3 * median(&mut cpu),
        one_thread_ms: 1e3 * seconds,
        encode_ms: 1e3 * median(&mut encode),
        gflops: rate / 1e9,
        fraction_of_peak: rate / peak.max(1.0),
    })
}

/// Floating-point operations of one action: all layers but the last in full, and of the last one
/// keys and values of all tokens and the rest of the current token only.
fn used_flop(size: Size) -> f64 {
    let cfg = size.config();
    let (d, n, t) = (cfg.width as f64, cfg.layers as f64, WINDOW as f64);
    size.forward_flop() * (n - 1.0) / n + 4.0 * d * d * t + 20.0 * d * d
}
