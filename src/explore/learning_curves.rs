//! Learning curves of agents and baselines: reward and coverage over steps, on the same robot with
//! the same number of steps.

use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::agent::{Agent, AgentKind, Sums};
use super::babble::BabbleRule;
use super::collect::AgentSummary;
use super::describe::describe;
use super::env::{Env, Step};
use super::error::Error;
use super::noise::NoiseRule;
use super::parallel::for_each;
use super::policy::ExplorePolicy;
use super::preset::Preset;
use robert_base::progress::{Cancel, Progress};
use robert_base::rng::{Rng, Stream, draw};
use robert_dataset::Coverage;
use robert_robot::Robot;

/// Frames of a baseline's episode: the mean of the agents' training episodes.
const EPISODE_FRAMES: u64 = 350;

/// Trains each agent of `kinds` without writing files, runs the baselines for as many steps, and
/// returns all curves in the order of `kinds`.
///
/// # Errors
/// [`Error::Simulator`], [`Error::Cancelled`].
pub fn learning_curves(
    robot: &Arc<Robot>,
    kinds: &[AgentKind],
    preset: &Preset,
    seed: u64,
    threads: usize,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Vec<AgentSummary>, Error> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(vec![0_u64; kinds.len()]);
    let total = preset.steps * kinds.len() as u64;
    let tick = |i: usize, steps: u64, note: &str| {
        let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(mine) = done.get_mut(i) {
            *mine = steps.min(preset.steps);
        }
        progress.tick(done.iter().sum(), total, note);
    };
    let work = || -> Result<Vec<(usize, AgentSummary)>, Error> {
        let mut mine = Vec::new();
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(&kind) = kinds.get(i) else { return Ok(mine) };
            let tick = |steps: u64, note: &str| tick(i, steps, note);
            let summary = match Agent::new(robot, kind, preset, seed)? {
                Some(agent) => learner(agent, cancel, &tick)?,
                None => baseline(robot, kind, preset, seed, cancel, &tick)?,
            };
            mine.push((i, summary));
        }
    };
    let mut all = for_each(threads.min(kinds.len()), work)?;
    all.sort_by_key(|(i, _)| *i);
    Ok(all.into_iter().map(|(_, s)| s).collect())
}

fn stopped() -> Error {
    Error::Cancelled { path: std::path::PathBuf::from("(nothing is written)") }
}

fn learner(
    mut agent: Agent,
    cancel: &Cancel,
    tick: &dyn Fn(u64, &str),
) -> Result<AgentSummary, Error> {
    for nominal in agent.preset.snapshots() {
        while agent.ledger.step < nominal {
            if cancel.is_cancelled() {
                return Err(stopped());
            }
            agent.iterate(1)?;
            if agent.ledger.step.is_multiple_of(1024) {
                tick(agent.ledger.step, agent.kind.name());
            }
        }
        agent.snapshot(nominal);
    }
    let ledger = agent.ledger;
    Ok(AgentSummary {
        agent: agent.kind,
        curve: ledger.curve,
        steps: ledger.step,
        updates: ledger.updates,
        broken: ledger.broken,
    })
}

/// Steps of a baseline, with noise or uniform torque; its reward stays 0.
fn baseline(
    robot: &Arc<Robot>,
    kind: AgentKind,
    preset: &Preset,
    seed: u64,
    cancel: &Cancel,
    tick: &dyn Fn(u64, &str),
) -> Result<AgentSummary, Error> {
    let described = describe(robot);
    let policy = match kind {
        AgentKind::Noise => ExplorePolicy::Noise(NoiseRule::of(robot)),
        AgentKind::Babble => ExplorePolicy::Babble(BabbleRule::of(robot)?),
        _ => ExplorePolicy::Uniform,
    };
    let (s, a) = (robot.state_dim(), robot.action_dim());
    let mut env = Env::new(robot)?;
    let mut gravity = policy.weight(robot)?;
    let mut coverage = Coverage::new(&described);
    let (mut q, mut v, mut action) = (vec![0.0; s], vec![0.0; s], vec![0.0; a]);
    let mut obs = vec![0.0; 2 * s];
    let mut sums = Sums::default();
    let (mut step, mut episode, mut broken) = (0_u64, 0_u64, 0_u64);
    let mut curve = Vec::new();
    let mut snapshots = preset.snapshots().into_iter().peekable();
    while snapshots.peek().is_some() {
        if cancel.is_cancelled() {
            return Err(stopped());
        }
        let own = draw(seed ^ kind as u64, Stream::Reset, episode);
        episode += 1;
        env.reset(&mut Rng::new(own, Stream::Reset, 0))?;
        let mut actor = policy.begin(own, &mut []);
        env.observe(&mut obs[..s], &mut v);
        obs[s..].copy_from_slice(&v);
        for _ in 0..EPISODE_FRAMES {
            let weight = match &mut gravity {
                Some(gravity) => env.weight(gravity)?,
                None => Vec::new(),
            };
            actor.act(&obs, &weight, &[], &mut action);
            match env.step(&action) {
                Step::Ok => {}
                Step::Implausible => break,
                Step::Broken => {
                    broken += 1;
                    break;
                }
            }
            env.observe(&mut q, &mut v);
            obs[..s].copy_from_slice(&q);
            obs[s..].copy_from_slice(&v);
            coverage.add(&q, &v);
            sums.add_frame(&described, &q, env.self_contact());
            step += 1;
            if let Some(nominal) = snapshots.next_if(|&n| step >= n) {
                curve.push(sums.point(nominal, coverage.share(), broken));
                sums = Sums::default();
            }
        }
        tick(step, kind.name());
    }
    Ok(AgentSummary { agent: kind, curve, steps: step, updates: 0, broken })
}
