//! The thread that performs the rollout and answers questions during a drag.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::time::{Duration, Instant};

use super::message::{
    Dense, Envelope, Frames, Kinematics, LoadRobot, Refusal, SetPolicy, SimulationEvent, Stop,
    Trace, WorkerRequest,
};
use super::out::{Out, grant_cpu};
use super::{query, trace};
use crate::protocol::{IkRequest, RobotFacts};
use robert_clip::Command;
use robert_mujoco::Data;
use robert_robot::{self as robot, Robot};
use robert_rollout::{Choice, LiveRollout, PolicyConfig, PolicyName, Stage};

/// Frames are sent together when they come faster than this.
const BATCH: Duration = Duration::from_millis(8);
/// While the other contenders perform and nothing is sent, the limit of processor time is renewed
/// this often.
const BEAT: Duration = Duration::from_millis(200);

/// The thread that performs.
pub(super) struct Performer {
    out: Out,
    robot: Option<(Arc<Robot>, Data)>,
    policy: PolicyConfig,
    seed: u64,
    show: Option<Show>,
}

/// A rollout, and the frames of it that have been sent.
struct Show {
    rollout: LiveRollout,
    command: Command,
    generation: u64,
    /// Whether all contenders perform, and the best one is shown at the end.
    compare: bool,
    running: bool,
    batch: Frames,
    sent: Instant,
    /// The stage of improvement that was sent last.
    stage: Option<Stage>,
}

impl Performer {
    pub(super) fn new(out: Out) -> Performer {
        Performer {
            out,
            robot: None,
            policy: PolicyConfig::new(PolicyName::ComputedTorque),
            seed: 0,
            show: None,
        }
    }

    /// Answers questions and performs until the parent hangs up.
    pub(super) fn run(mut self, requests: &Receiver<Envelope>) {
        loop {
            let running = self.show.as_ref().is_some_and(|s| s.running);
            let first = if running {
                match requests.try_recv() {
                    Ok(ask) => Some(ask),
                    Err(TryRecvError::Empty) => None,
                    Err(TryRecvError::Disconnected) => return,
                }
            } else {
                match requests.recv() {
                    Ok(ask) => Some(ask),
                    Err(_) => return,
                }
            };
            match first {
                Some(first) => {
                    grant_cpu();
                    // An edit that a newer one has replaced is not performed at all.
                    let mut waiting: Vec<Envelope> = std::iter::once(first).collect();
                    waiting.extend(requests.try_iter());
                    let newest = waiting
                        .iter()
                        .rposition(|a| matches!(a.request, WorkerRequest::Perform(_)));
                    for (i, ask) in waiting.into_iter().enumerate() {
                        let old = matches!(ask.request, WorkerRequest::Perform(_));
                        if !old || Some(i) == newest {
                            self.answer(ask);
                        }
                    }
                }
                None => self.step(),
            }
        }
    }

    fn answer(&mut self, Envelope { id, request }: Envelope) {
        let out = self.out.clone();
        match request {
            WorkerRequest::LoadRobot(q) => out.answer::<LoadRobot>(id, self.load_robot(&q.robot)),
            WorkerRequest::SetPolicy(q) => {
                (self.policy, self.seed, self.show) = (q.policy, q.seed, None);
                out.answer::<SetPolicy>(id, Ok(()));
            }
            WorkerRequest::Perform(q) => self.perform(q.generation, q.compare, q.command),
            WorkerRequest::Stop(_) => {
                self.stop();
                out.answer::<Stop>(id, Ok(()));
            }
            WorkerRequest::Kinematics(q) => out.answer::<Kinematics>(
                id,
                self.robot().and_then(|(robot, data)| {
                    let row = |pose: &Vec<f64>| Ok(query::transforms(robot, data, pose)?);
                    q.poses.iter().map(row).collect()
                }),
            ),
            WorkerRequest::IkRequest(q) => out.answer::<IkRequest>(
                id,
                self.robot().and_then(|(robot, data)| Ok(query::ik(robot, data, &q)?)),
            ),
            WorkerRequest::Trace(q) => out.answer::<Trace>(
                id,
                self.robot().and_then(|(robot, data)| Ok(trace::trace(robot, data, &q)?)),
            ),
            // The others go to the slow thread: see `WorkerRequest::is_slow`.
            _ => debug_assert!(false, "a slow question among the quick ones"),
        }
    }

    fn robot(&mut self) -> Result<(&Robot, &mut Data), Refusal> {
        match &mut self.robot {
            Some((robot, data)) => Ok((&**robot, data)),
            None => Err(Refusal::invalid("no robot is loaded")),
        }
    }

    fn load_robot(&mut self, id: &str) -> Result<RobotFacts, Refusal> {
        let robot = query::resolve(id)?;
        let data = Data::new(robot.model()).map_err(robot::Error::from)?;
        let facts = query::facts(&robot, id);
        self.robot = Some((robot, data));
        self.show = None;
        Ok(facts)
    }

    fn perform(&mut self, generation: u64, compare: bool, dense: Dense) {
        let ended = |error: String| SimulationEvent::Ended {
            generation,
            precision: None,
            choice: None,
            error: Some(error),
        };
        let command = Command::from_dense(dense.joints, dense.start, dense.q, dense.visible);
        let Some((robot, _)) = &self.robot else {
            return self.out.tell(ended("no robot is loaded".into()));
        };
        let names: Vec<String> = robot.joints().iter().map(|j| j.name.clone()).collect();
        let Some(command) = command.and_then(|c| c.reordered(&names)) else {
            let message = format!("the clip does not have the joints of robot {}", robot.id());
            return self.out.tell(ended(message));
        };
        match self.take_up(command, generation, compare) {
            Ok(()) => {}
            Err(e) => {
                self.show = None;
                self.out.tell(ended(e.to_string()));
            }
        }
    }

    /// Continues the last rollout if the new command allows it.
    fn take_up(
        &mut self,
        command: Command,
        generation: u64,
        compare: bool,
    ) -> Result<(), robert_rollout::Error> {
        let Some((robot, _)) = &self.robot else { return Ok(()) };
        let (mut show, resumed_at) = if let Some(mut show) = self.show.take() {
            let stands = show.rollout.set_command(&command)?;
            (show, stands)
        } else {
            let show = Show {
                rollout: LiveRollout::new(robot, &self.policy, self.seed, &command)?,
                command: command.clone(),
                generation,
                compare,
                running: true,
                stage: None,
                batch: Frames::default(),
                sent: Instant::now(),
            };
            (show, 0)
        };
        // Frames that were simulated but not sent yet are sent now.
        let unsent = show.batch.from;
        // The ghost of the command leans toward the next goal, so it also changes in frames that
        // need no new simulation.
        let leans = command.first_changed_step(&show.command).unwrap_or(u32::MAX);
        let from = resumed_at.min(leans as usize).min(unsent);
        self.out.tell(SimulationEvent::Started { generation, resumed_at });
        show.command = command;
        (show.generation, show.compare, show.running) = (generation, compare, true);
        show.stage = None;
        show.batch = Frames { generation, from, ..Frames::default() };
        show.sent = Instant::now().checked_sub(BATCH).unwrap_or_else(Instant::now);
        self.show = Some(show);
        self.add_from(from)?;
        if resumed_at == 0 {
            self.flush();
        }
        Ok(())
    }

    /// Adds the frames that the shown rollout has reached, from this one on.
    fn add_from(&mut self, frame: usize) -> Result<(), robert_rollout::Error> {
        let Some(show) = &self.show else { return Ok(()) };
        let reached = show.rollout.shown().frames_reached().skip(frame);
        for shot in reached.map(Shot::of).collect::<Vec<_>>() {
            self.add(&shot, 0.0)?;
        }
        Ok(())
    }

    /// Simulates one frame: of the shown rollout, then of the other contenders.
    fn step(&mut self) {
        match self.step_shown() {
            Ok(true) => {
                if self.show.as_ref().is_some_and(|s| s.sent.elapsed() >= BATCH) {
                    self.flush();
                }
            }
            Ok(false) => self.compare(),
            Err(_) if self.show.as_ref().is_some_and(|s| s.compare) => self.compare(),
            Err(e) => self.end(None, Some(e)),
        }
    }

    /// Simulates one frame of the shown rollout. False at its end.
    fn step_shown(&mut self) -> Result<bool, robert_rollout::Error> {
        let Some(show) = &mut self.show else { return Ok(false) };
        let begin = Instant::now();
        let Some(shot) = show.rollout.step()?.map(Shot::of) else { return Ok(false) };
        self.add(&shot, begin.elapsed().as_secs_f64())?;
        Ok(true)
    }

    /// The shown rollout has ended: another contender takes a step, or the best one is shown.
    fn compare(&mut self) {
        self.flush();
        let Some(show) = &mut self.show else { return };
        if !show.compare {
            return self.end(None, None);
        }
        if show.rollout.step_another() {
            if show.sent.elapsed() >= BEAT {
                show.sent = Instant::now();
                grant_cpu();
            }
            let (stage, generation) = (show.rollout.stage(), show.generation);
            if stage != std::mem::replace(&mut show.stage, stage)
                && let Some(stage) = stage
            {
                self.out.tell(SimulationEvent::Improving { generation, stage });
            }
            if show.rollout.show_best_so_far()
                && let Err(e) = self.show_again()
            {
                self.end(None, Some(e));
            }
            return;
        }
        self.choose();
    }

    /// Stops. While a motion is being improved, the best one so far is shown with its figures.
    fn stop(&mut self) {
        let Some(show) = &mut self.show else { return };
        if show.running && show.rollout.stage().is_some() {
            return self.choose();
        }
        show.running = false;
    }

    /// Shows the best motion and ends.
    fn choose(&mut self) {
        let Some(show) = &mut self.show else { return };
        match show.rollout.choose() {
            Ok(choice) => {
                let shown = if choice.changed { self.show_again() } else { Ok(()) };
                self.end((choice.tried.len() > 1).then(|| Box::new(choice)), shown.err());
            }
            Err(e) => self.end(None, Some(e)),
        }
    }

    /// Sends all frames of the rollout that is shown from now on.
    fn show_again(&mut self) -> Result<(), robert_rollout::Error> {
        let Some(show) = &mut self.show else { return Ok(()) };
        let generation = show.generation;
        show.batch = Frames { generation, ..Frames::default() };
        self.out.tell(SimulationEvent::Started { generation, resumed_at: 0 });
        self.add_from(0)?;
        self.flush();
        Ok(())
    }

    fn end(&mut self, choice: Option<Box<Choice>>, error: Option<robert_rollout::Error>) {
        self.flush();
        let Some(show) = &mut self.show else { return };
        show.running = false;
        let generation = show.generation;
        let precision = error.is_none().then(|| Box::new(show.rollout.shown().precision()));
        let error = error.map(|e| e.to_string());
        self.out.tell(SimulationEvent::Ended { generation, precision, choice, error });
    }

    /// Adds a frame to what is sent next.
    fn add(&mut self, shot: &Shot, secs: f64) -> Result<(), robert_rollout::Error> {
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
        self.out.tell(SimulationEvent::Frames(batch));
    }
}

/// A frame, copied out of the rollout.
struct Shot {
    frame: usize,
    reached: Vec<f64>,
    error: Option<f64>,
}

impl Shot {
    fn of(frame: robert_rollout::Frame<'_>) -> Shot {
        Shot { frame: frame.frame, reached: frame.reached.to_vec(), error: frame.error }
    }
}
