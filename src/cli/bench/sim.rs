//! `robert bench sim`.

use std::sync::Arc;
use std::sync::Barrier;
use std::time::Instant;

use serde::Serialize;

use super::clock::{median, thread_cpu};
use crate::cli::failure::{Failure, Outcome};
use crate::cli::global::thread_count;
use crate::cli::out;
use crate::mujoco::{BareLoop, Data};
use crate::rng::{Rng, Stream};
use crate::robot::Robot;
use crate::units::SUBSTEPS;

/// Control steps between resets: the length of an episode.
const EPISODE: usize = 200;

#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  robert bench sim --json")]
pub(super) struct Args {
    /// Robots [default: all built-in ones].
    #[arg(long, value_delimiter = ',')]
    robot: Vec<String>,
    /// Thread counts.
    #[arg(long, value_delimiter = ',', default_values_t = [1, 2], value_parser = thread_count())]
    threads: Vec<usize>,
    /// Seconds per robot and thread count.
    #[arg(long, default_value_t = 3.0)]
    secs: f64,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    episode_control_steps: usize,
    substeps: usize,
    robots: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    id: String,
    threads: usize,
    /// Wall rate of all threads together.
    control_steps_per_sec: f64,
    /// Rate in wall time, divided by that of the first thread count given.
    scaling: f64,
    /// Rate in processor time, divided by that of the C loop, median over turns.
    ratio_to_c_loop: f64,
}

pub(super) fn run(args: &Args) -> Outcome {
    if !(0.1..=600.0).contains(&args.secs) {
        return Err(Failure::usage("--secs takes 0.1 to 600"));
    }
    let ids: Vec<String> = if args.robot.is_empty() {
        Robot::builtin_ids().map(str::to_owned).collect()
    } else {
        args.robot.clone()
    };
    let mut robots = Vec::new();
    for id in &ids {
        let robot = Arc::new(Robot::builtin(id)?);
        let mut single = None;
        for &threads in &args.threads {
            let (rate, ratio) = measure(&robot, threads, args.secs)?;
            let base = *single.get_or_insert(rate);
            robots.push(Row {
                id: id.clone(),
                threads,
                control_steps_per_sec: rate.round(),
                scaling: rate / base,
                ratio_to_c_loop: ratio,
            });
        }
    }
    let report = Report { episode_control_steps: EPISODE, substeps: SUBSTEPS, robots };
    if args.json {
        return out::json(&report);
    }
    let mut table = out::table(&["robot", "threads", "control steps/s", "scaling", "of a C loop"]);
    for r in &report.robots {
        table.add_row([
            r.id.clone(),
            r.threads.to_string(),
            format!("{:.0}", r.control_steps_per_sec),
            format!("{:.2}", r.scaling),
            format!("{:.3}", r.ratio_to_c_loop),
        ]);
    }
    out::line(&table.to_string())
}

/// (control steps a second of wall time, ratio to the C loop in processor time).
fn measure(robot: &Arc<Robot>, threads: usize, secs: f64) -> Outcome<(f64, f64)> {
    let barrier = Barrier::new(threads);
    let workers = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..threads)
            .map(|i| {
                let barrier = &barrier;
                scope.spawn(move || work(robot, i as u64, secs, barrier))
            })
            .collect();
        handles.into_iter().map(std::thread::ScopedJoinHandle::join).collect::<Vec<_>>()
    });
    let (mut rate, mut ratios) = (0.0, Vec::new());
    for worker in workers {
        let worker = worker
            .unwrap_or_else(|_| Err(Failure::with(crate::exit::Exit::Failed, "a worker died")))?;
        rate += worker.rate;
        ratios.push(worker.ratio);
    }
    Ok((rate, median(&mut ratios)))
}

struct Worked {
    rate: f64,
    ratio: f64,
}

fn work(robot: &Arc<Robot>, index: u64, secs: f64, barrier: &Barrier) -> Outcome<Worked> {
    let mut data = Data::new(robot.model())?;
    let actions = robot.action_dim();
    let mut rng = Rng::new(1, Stream::Noise, index);
    // Smooth torques at half range: what collection looks like, not a shaking hand.
    let mut table = vec![0.0; EPISODE * actions];
    let mut now = vec![0.0_f64; actions];
    for row in table.chunks_exact_mut(actions) {
        for (v, out) in now.iter_mut().zip(row) {
            *v = (0.9 * *v + 0.15 * rng.normal()).clamp(-0.5, 0.5);
            *out = *v;
        }
    }
    let ctrl: Vec<f64> = table
        .chunks_exact(actions)
        .map(|row| robot.ctrl_of(row))
        .collect::<Result<Vec<_>, _>>()?
        .concat();
    let bare = |data: &mut Data, steps: usize| {
        data.bare_loop(
            &ctrl,
            BareLoop { control_steps: steps, substeps: SUBSTEPS, reset_every: EPISODE },
        )
    };
    let ours = |data: &mut Data, steps: usize| -> Outcome {
        let mut state = vec![0.0; robot.state_dim()];
        for i in 0..steps {
            let at = i % EPISODE;
            if at == 0 {
                data.reset()?;
            }
            data.set_ctrl(&ctrl[at * actions..(at + 1) * actions])?;
            data.step(SUBSTEPS)?;
            robot.read_state(data, &mut state);
        }
        std::hint::black_box(&state);
        Ok(())
    };
    // The number of steps that takes about a twelfth of the time.
    let begin = Instant::now();
    bare(&mut data, EPISODE)?;
    let per_step = begin.elapsed().as_secs_f64() / EPISODE as f64;
    let episodes = (secs / 24.0 / (per_step * EPISODE as f64)).ceil().max(1.0) as usize;
    let steps = episodes * EPISODE;
    let (mut ratios, mut own_wall, mut own_steps) = (Vec::new(), 0.0, 0);
    barrier.wait();
    let begin = Instant::now();
    while begin.elapsed().as_secs_f64() < secs || ratios.len() < 3 {
        let (t0, wall) = (thread_cpu(), Instant::now());
        ours(&mut data, steps)?;
        own_wall += wall.elapsed().as_secs_f64();
        own_steps += steps;
        let t1 = thread_cpu();
        bare(&mut data, steps)?;
        let t2 = thread_cpu();
        ratios.push((t2 - t1).as_secs_f64() / (t1 - t0).as_secs_f64().max(1e-9));
    }
    Ok(Worked { rate: own_steps as f64 / own_wall, ratio: median(&mut ratios) })
}
