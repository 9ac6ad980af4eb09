//! What runs in the child process: limits first, then two lanes.
//!
//! The fast lane owns the rollout and answers what a hand on the mouse waits for (poses,
//! inverse kinematics) between two frames. The slow lane settles poses and compiles other
//! robots. The main thread only reads, so that the parent can always ask whether we live.

use std::io::{self, Write as _};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use super::paint::Painter;
use super::{Answer, Ask, Dense, Frames, Report, Request, codec, query};
use crate::child::{self, Farewell, Rights};
use crate::clip::Command;
use crate::mujoco::Data;
use crate::robot::Robot;
use crate::rollout::{PolicyConfig, PolicyName, Rollout, RolloutConfig, Start};
use crate::{fsio, limits};

/// Frames are sent together when they come faster than this.
const BATCH: Duration = Duration::from_millis(8);

/// Serves the parent until it hangs up. Its socket is file descriptor 0: the safe way to
/// hand one over. Nothing here reads the standard input otherwise.
///
/// # Errors
/// When the socket is none.
pub fn run() -> io::Result<()> {
    confine()?;
    let socket = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    let out = Out(Arc::new(Mutex::new(socket.try_clone()?)));
    let (fast, fast_asks) = channel();
    let (slow, slow_asks) = channel();
    let lane = Lane::new(out.clone());
    std::thread::Builder::new().name("fast".into()).spawn(move || lane.run(&fast_asks))?;
    let slow_out = out.clone();
    std::thread::Builder::new()
        .name("slow".into())
        .spawn(move || slow_lane(&slow_asks, &slow_out))?;
    let mut input = io::BufReader::new(socket);
    while let Some(ask) = codec::read::<Ask>(&mut input)? {
        if matches!(ask.request, Request::Ping) {
            out.send(ask.id, Report::Pong)?;
            continue;
        }
        let lane: &Sender<Ask> = if ask.request.is_slow() { &slow } else { &fast };
        if lane.send(ask).is_err() {
            break;
        }
    }
    Ok(())
}

/// Takes away what a broken model could do harm with.
fn confine() -> io::Result<()> {
    // A lane that panics must end the process: the parent starts a fresh one, whereas a
    // half-dead child would only be silent.
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        usual(info);
        std::process::exit(101);
    }));
    child::follow_parent(Farewell::Now)?;
    // Graphics drivers keep compiled shaders in the user's cache and talk to devices.
    let scratch = std::env::current_dir()?;
    let cache = fsio::cache_dir();
    let caches = cache.parent().map_or_else(|| cache.clone(), std::path::Path::to_owned);
    child::confine(&Rights {
        memory_bytes: Some(limits::WORKER_MEMORY_BYTES),
        file_bytes: Some(limits::CHILD_FILE_BYTES),
        writes: Some(vec![scratch, caches, "/dev".into(), "/proc/self".into()]),
        ..Rights::default()
    })
}

/// Grants another share of processor time: an endless loop in one request ends the process,
/// many short requests do not.
fn grant_cpu() {
    let Ok(stat) = std::fs::read_to_string("/proc/self/stat") else { return };
    // After the name in parentheses the 12th and 13th fields are user and system ticks.
    let Some((_, fields)) = stat.rsplit_once(')') else { return };
    let ticks: u64 =
        fields.split_whitespace().skip(11).take(2).filter_map(|f| f.parse::<u64>().ok()).sum();
    let maximum = getrlimit(Resource::Cpu).maximum;
    let current = Some(ticks / 100 + limits::WORKER_CPU_SECS);
    setrlimit(Resource::Cpu, Rlimit { current, maximum }).ok();
}

#[derive(Clone)]
struct Out(Arc<Mutex<UnixStream>>);

impl Out {
    fn send(&self, id: u64, report: Report) -> io::Result<()> {
        let mut socket = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        codec::write(&mut *socket, &Answer { id, report })?;
        socket.flush()
    }

    /// A parent that is gone needs no answer; reading will notice.
    fn tell(&self, id: u64, report: Report) {
        self.send(id, report).ok();
    }
}

fn slow_lane(asks: &Receiver<Ask>, out: &Out) {
    let mut current: Option<(String, Arc<Robot>)> = None;
    let mut painter = Painter::default();
    while let Ok(Ask { id, request }) = asks.recv() {
        grant_cpu();
        let report = match request {
            Request::Facts { robot } => of_robot(&mut current, &robot, |r| {
                Ok(Report::Facts(Box::new(query::facts(r, &robot))))
            }),
            Request::Geometry { robot } => of_robot(&mut current, &robot, |r| {
                Ok(query::geometry(r).map_or_else(|e| *e, |g| Report::Geometry(Box::new(g))))
            }),
            Request::Settle { robot, q } => {
                of_robot(&mut current, &robot, |r| Ok(Report::Settled(query::settle(r, &q)?)))
            }
            Request::Check { robot, poses } => of_robot(&mut current, &robot, |r| {
                let checked = poses.iter().map(|q| query::check(r, q)).collect::<Result<_, _>>()?;
                Ok(Report::Checked(checked))
            }),
            Request::Paint(picture) => of_robot(&mut current, &picture.robot, |r| {
                Ok(painter.paint(r, &picture).unwrap_or_else(|refusal| *refusal))
            }),
            Request::Pick(picture, at) => of_robot(&mut current, &picture.robot, |r| {
                Ok(painter.pick(r, &picture, at).unwrap_or_else(|refusal| *refusal))
            }),
            _ => Report::Ok,
        };
        out.tell(id, report);
    }
}

/// Answers about a robot, compiling it unless it was the last one.
fn of_robot(
    current: &mut Option<(String, Arc<Robot>)>,
    id: &str,
    answer: impl FnOnce(&Arc<Robot>) -> Result<Report, crate::robot::Error>,
) -> Report {
    if current.as_ref().is_none_or(|(known, _)| known != id) {
        match query::resolve(id) {
            Ok(robot) => *current = Some((id.to_owned(), robot)),
            Err(e) => return query::refused(&e),
        }
    }
    let Some((_, robot)) = current else { return Report::Ok };
    answer(robot).unwrap_or_else(|e| query::refused(&e))
}

struct Lane {
    out: Out,
    robot: Option<(Arc<Robot>, Data)>,
    policy: PolicyConfig,
    seed: u64,
    show: Option<Show>,
}

/// A rollout and what of it has been sent.
struct Show {
    rollout: Rollout,
    command: Command,
    generation: u64,
    running: bool,
    batch: Frames,
    sent: Instant,
}

impl Lane {
    fn new(out: Out) -> Lane {
        Lane {
            out,
            robot: None,
            policy: PolicyConfig::new(PolicyName::ComputedTorque),
            seed: 0,
            show: None,
        }
    }

    fn run(mut self, asks: &Receiver<Ask>) {
        loop {
            let running = self.show.as_ref().is_some_and(|s| s.running);
            let first = if running {
                match asks.try_recv() {
                    Ok(ask) => Some(ask),
                    Err(TryRecvError::Empty) => None,
                    Err(TryRecvError::Disconnected) => return,
                }
            } else {
                match asks.recv() {
                    Ok(ask) => Some(ask),
                    Err(_) => return,
                }
            };
            match first {
                Some(first) => {
                    grant_cpu();
                    // An edit that another one has overtaken is not performed at all.
                    let mut waiting: Vec<Ask> = std::iter::once(first).collect();
                    waiting.extend(asks.try_iter());
                    let newest =
                        waiting.iter().rposition(|a| matches!(a.request, Request::Perform { .. }));
                    for (i, ask) in waiting.into_iter().enumerate() {
                        let old = matches!(ask.request, Request::Perform { .. });
                        if !old || Some(i) == newest {
                            self.answer(ask);
                        }
                    }
                }
                None => self.step(),
            }
        }
    }

    fn answer(&mut self, Ask { id, request }: Ask) {
        let report = match request {
            Request::Robot { robot } => self.take_robot(&robot),
            Request::Policy { policy, seed } => {
                (self.policy, self.seed, self.show) = (policy, seed, None);
                Report::Ok
            }
            Request::Perform { generation, command } => {
                self.perform(generation, command);
                return;
            }
            Request::Stop => {
                if let Some(show) = &mut self.show {
                    show.running = false;
                }
                Report::Ok
            }
            Request::Kinematics { poses } => self.with_robot(|robot, data| {
                let bodies = poses
                    .iter()
                    .map(|q| query::transforms(robot, data, q))
                    .collect::<Result<_, _>>()?;
                Ok(Report::Bodies(bodies))
            }),
            Request::Ik(request) => {
                self.with_robot(|robot, data| Ok(Report::Ik(query::ik(robot, data, &request)?)))
            }
            _ => Report::Ok,
        };
        self.out.tell(id, report);
    }

    fn with_robot(
        &mut self,
        answer: impl FnOnce(&Robot, &mut Data) -> Result<Report, crate::robot::Error>,
    ) -> Report {
        match &mut self.robot {
            Some((robot, data)) => answer(robot, data).unwrap_or_else(|e| query::refused(&e)),
            None => Report::Refused { message: "no robot is loaded".into(), exit: 3 },
        }
    }

    fn take_robot(&mut self, id: &str) -> Report {
        let load = || -> Result<(Arc<Robot>, Data), crate::robot::Error> {
            let robot = query::resolve(id)?;
            let data = Data::new(robot.model())?;
            Ok((robot, data))
        };
        match load() {
            Ok((robot, data)) => {
                let facts = query::facts(&robot, id);
                self.robot = Some((robot, data));
                self.show = None;
                Report::Facts(Box::new(facts))
            }
            Err(e) => query::refused(&e),
        }
    }

    fn perform(&mut self, generation: u64, dense: Dense) {
        let ended =
            |error: String| Report::Ended { generation, precision: None, error: Some(error) };
        let command = Command::from_dense(dense.joints, dense.start, dense.q, dense.visible);
        let Some((robot, _)) = &self.robot else {
            return self.out.tell(0, ended("no robot is loaded".into()));
        };
        let names: Vec<String> = robot.joints().iter().map(|j| j.name.clone()).collect();
        let Some(command) = command.and_then(|c| c.reordered(&names)) else {
            let message = format!("the clip does not have the joints of robot {}", robot.id());
            return self.out.tell(0, ended(message));
        };
        match self.take_up(command, generation) {
            Ok(()) => {}
            Err(e) => {
                self.show = None;
                self.out.tell(0, ended(e.to_string()));
            }
        }
    }

    /// Goes on with the last rollout where the new command allows it.
    fn take_up(&mut self, command: Command, generation: u64) -> Result<(), crate::rollout::Error> {
        let Some((robot, _)) = &self.robot else { return Ok(()) };
        let mut show = if let Some(mut show) = self.show.take() {
            show.rollout.set_command(&command)?;
            show
        } else {
            let policy = self.policy.build(robot)?;
            let config = RolloutConfig {
                seed: self.seed,
                guide: self.policy.guide,
                ..RolloutConfig::default()
            };
            Show {
                rollout: Rollout::new(robot, policy, &command, Start::Pose, config)?,
                command: command.clone(),
                generation,
                running: true,
                batch: Frames::default(),
                sent: Instant::now(),
            }
        };
        let resumed_at = show.rollout.frame();
        // Frames that were simulated but not sent yet are sent now.
        let unsent = show.batch.from;
        // The ghost of the command leans toward the next goal: it changes on frames, too,
        // that need no new simulation.
        let leans = command.first_changed_step(&show.command).unwrap_or(u32::MAX);
        let from = resumed_at.min(leans as usize).min(unsent);
        self.out.tell(0, Report::Started { generation, resumed_at });
        show.command = command;
        show.generation = generation;
        show.running = true;
        show.batch = Frames { generation, from, ..Frames::default() };
        show.sent = Instant::now().checked_sub(BATCH).unwrap_or_else(Instant::now);
        let first = show.rollout.frames_reached().map(Shot::of).skip(from).collect::<Vec<_>>();
        self.show = Some(show);
        for shot in first {
            self.add(&shot, 0.0)?;
        }
        if resumed_at == 0 {
            self.flush();
        }
        Ok(())
    }

    fn step(&mut self) {
        let Some(show) = &mut self.show else { return };
        let begin = Instant::now();
        let shot = match show.rollout.step() {
            Ok(Some(frame)) => Ok(Some(Shot::of(frame))),
            Ok(None) => Ok(None),
            Err(e) => Err(e),
        };
        let secs = begin.elapsed().as_secs_f64();
        let ended = match shot {
            Ok(Some(shot)) => match self.add(&shot, secs) {
                Ok(()) => {
                    let due = self.show.as_ref().is_some_and(|s| s.sent.elapsed() >= BATCH);
                    if due {
                        self.flush();
                    }
                    return;
                }
                Err(e) => Some(e.to_string()),
            },
            Ok(None) => None,
            Err(e) => Some(e.to_string()),
        };
        self.flush();
        let Some(show) = &mut self.show else { return };
        show.running = false;
        let generation = show.generation;
        let precision = ended.is_none().then(|| Box::new(show.rollout.precision()));
        self.out.tell(0, Report::Ended { generation, precision, error: ended });
    }

    /// Adds a frame to what is sent next.
    fn add(&mut self, shot: &Shot, secs: f64) -> Result<(), crate::rollout::Error> {
        let (Some((robot, data)), Some(show)) = (&mut self.robot, &mut self.show) else {
            return Ok(());
        };
        let bodies = query::transforms(robot, data, &shot.reached)?;
        let goal: Vec<f64> =
            show.command.interpolated(shot.frame as u32).into_iter().map(f64::from).collect();
        let goal_bodies = query::transforms(robot, data, &goal)?;
        let batch = &mut show.batch;
        batch.q.push(shot.reached.iter().map(|v| *v as f32).collect());
        batch.error.push(shot.error);
        batch.action.push(shot.action.clone());
        batch.bodies.push(bodies);
        batch.goal_bodies.push(goal_bodies);
        batch.secs += secs;
        Ok(())
    }

    fn flush(&mut self) {
        let Some(show) = &mut self.show else { return };
        if show.batch.q.is_empty() {
            return;
        }
        let next = show.batch.from + show.batch.q.len();
        let fresh = Frames { generation: show.generation, from: next, ..Frames::default() };
        let batch = std::mem::replace(&mut show.batch, fresh);
        show.sent = Instant::now();
        // Time is for one answer, and these frames are one.
        grant_cpu();
        self.out.tell(0, Report::Frames(batch));
    }
}

/// A frame, copied out of the rollout.
struct Shot {
    frame: usize,
    reached: Vec<f64>,
    action: Vec<f32>,
    error: Option<f64>,
}

impl Shot {
    fn of(frame: crate::rollout::Frame<'_>) -> Shot {
        Shot {
            frame: frame.frame,
            reached: frame.reached.to_vec(),
            action: frame.action.iter().map(|v| *v as f32).collect(),
            error: frame.error,
        }
    }
}
