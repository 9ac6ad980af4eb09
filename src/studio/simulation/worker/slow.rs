//! Questions that may take long: settling poses, other robots, pictures.

use std::sync::Arc;
use std::sync::mpsc::Receiver;

use super::message::{
    CheckPoses, DescribeRobot, Envelope, LookAtRobot, PaintRequest, PickRequest, Refusal, Settle,
    WorkerRequest,
};
use super::out::{Out, grant_cpu};
use super::paint::Painter;
use super::query;
use robert_robot::Robot;

/// Answers until the parent hangs up.
pub(super) fn run(requests: &Receiver<Envelope>, out: &Out) {
    let mut robots = LastRobot::default();
    let mut painter = Painter::default();
    while let Ok(Envelope { id, request }) = requests.recv() {
        grant_cpu();
        match request {
            WorkerRequest::DescribeRobot(q) => out.answer::<DescribeRobot>(
                id,
                robots.get(&q.robot).map(|robot| query::facts(robot, &q.robot)),
            ),
            WorkerRequest::LookAtRobot(q) => {
                out.answer::<LookAtRobot>(id, robots.get(&q.robot).and_then(query::geometry));
            }
            WorkerRequest::Settle(q) => out.answer::<Settle>(
                id,
                robots.get(&q.robot).and_then(|robot| Ok(query::settle(robot, &q.q)?)),
            ),
            WorkerRequest::CheckPoses(q) => out.answer::<CheckPoses>(
                id,
                robots.get(&q.robot).and_then(|robot| {
                    q.poses.iter().map(|pose| Ok(query::check(robot, pose)?)).collect()
                }),
            ),
            WorkerRequest::PaintRequest(q) => out.answer::<PaintRequest>(
                id,
                robots.get(&q.robot).and_then(|robot| painter.paint(robot, &q)),
            ),
            WorkerRequest::PickRequest(q) => out.answer::<PickRequest>(
                id,
                robots
                    .get(&q.picture.robot)
                    .and_then(|robot| painter.pick(robot, &q.picture, q.at)),
            ),
            // The others go to the performer: see `WorkerRequest::is_slow`.
            _ => debug_assert!(false, "a quick question among the slow ones"),
        }
    }
}

/// The robot of the last question is kept, because compiling one takes a while.
#[derive(Default)]
struct LastRobot(Option<(String, Arc<Robot>)>);

impl LastRobot {
    fn get(&mut self, id: &str) -> Result<&Arc<Robot>, Refusal> {
        let last = self.0.take().filter(|(known, _)| known == id);
        let robot = match last {
            Some((_, robot)) => robot,
            None => query::resolve(id)?,
        };
        Ok(&self.0.insert((id.to_owned(), robot)).1)
    }
}
