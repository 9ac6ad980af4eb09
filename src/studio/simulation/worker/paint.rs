//! The painter: a child process that draws pictures of robots.
//!
//! Opening a graphics device takes a fifth of a second, so it stays open as long as the child
//! lives. The last motion also stays loaded, for scrubbing.

use std::sync::Arc;

use super::message::{Dense, MotionRows, PaintRequest, Picture, Refusal, Subject};
use crate::protocol::MeanError;
use robert_base::units::{FPS, Unit};
use robert_clip::Command;
use robert_render::{
    CameraChoice, Error, Motion, Overlay, Quality, RenderConfig, Renderer, Shot, encode,
};
use robert_robot::Robot;
use robert_rollout::{PolicyConfig, Rollout, RolloutConfig, Start};

/// JPEG quality, percent.
const JPEG: u8 = 88;

/// The renderer and scene that are kept between two pictures.
#[derive(Default)]
pub(crate) struct Painter {
    draft: Option<Renderer>,
    export: Option<Renderer>,
    shot: Option<(Known, Shot)>,
}

/// The request that a shot was made for.
#[derive(PartialEq)]
struct Known {
    robot: String,
    stamp: u64,
    overlay: String,
    aspect: f32,
}

impl Painter {
    /// Paints a picture, or says why not.
    pub(crate) fn paint(
        &mut self,
        robot: &Arc<Robot>,
        ask: &PaintRequest,
    ) -> Result<Picture, Refusal> {
        let (known, mut shot, error) = self.shot(robot, ask)?;
        let renderer = self.renderer(ask)?;
        let drawn = renderer
            .resize(ask.width, ask.height)
            .and_then(|()| shot.draw(renderer, ask.frame))
            .and_then(|picture| encode::jpeg(&picture, JPEG));
        self.keep(known, shot);
        match drawn {
            Ok(jpeg) => Ok(Picture { jpeg, error }),
            Err(e) => {
                // A device that has been lost must not be used again.
                *self.slot(ask) = None;
                Err(e.into())
            }
        }
    }

    /// The body that a picture would show at a point, or the reason why there is none.
    pub(crate) fn pick(
        &mut self,
        robot: &Arc<Robot>,
        ask: &PaintRequest,
        at: [f32; 2],
    ) -> Result<Option<String>, Refusal> {
        let (known, mut shot, _) = self.shot(robot, ask)?;
        let found = shot.body_at(ask.frame, at.into(), aspect(ask));
        let found = found.map(|name| name.map(str::to_owned)).map_err(Refusal::from);
        self.keep(known, shot);
        found
    }

    fn keep(&mut self, known: Option<Known>, shot: Shot) {
        if let Some(known) = known {
            self.shot = Some((known, shot));
        }
    }

    /// The requested motion with its camera; the last one is kept. Also the mean error if the
    /// motion was performed for this picture.
    fn shot(
        &mut self,
        robot: &Arc<Robot>,
        ask: &PaintRequest,
    ) -> Result<(Option<Known>, Shot, Option<MeanError>), Refusal> {
        let aspect = aspect(ask);
        let make = |motion: Motion| -> Result<Shot, Refusal> {
            let overlay = Overlay::parse(&ask.overlay).map_err(Refusal::from)?;
            Shot::new(robot, motion, overlay, &CameraChoice::Fit, aspect).map_err(Refusal::from)
        };
        Ok(match &ask.subject {
            Subject::Motion { stamp, motion } => {
                let known = Known {
                    robot: ask.robot.clone(),
                    stamp: *stamp,
                    overlay: ask.overlay.clone(),
                    aspect,
                };
                match self.shot.take().filter(|(k, _)| *k == known) {
                    Some((_, shot)) => (Some(known), shot, None),
                    None => (Some(known), make(rows(robot, motion))?, None),
                }
            }
            Subject::Pose(q) => (None, make(pose(robot, q))?, None),
            Subject::Clip { name, command, keys } => {
                let (motion, error) = performed(robot, name, command, keys)?;
                (None, make(motion)?, error)
            }
        })
    }

    fn slot(&mut self, ask: &PaintRequest) -> &mut Option<Renderer> {
        if ask.draft { &mut self.draft } else { &mut self.export }
    }

    fn renderer(&mut self, ask: &PaintRequest) -> Result<&mut Renderer, Refusal> {
        let quality = if ask.draft { Quality::Preview } else { Quality::Export };
        let slot = self.slot(ask);
        if slot.is_none() {
            let config = RenderConfig {
                width: ask.width,
                height: ask.height,
                quality,
                ..RenderConfig::default()
            };
            *slot = Some(Renderer::new(config).map_err(Refusal::from)?);
        }
        slot.as_mut().ok_or_else(|| Error::NoFrames.into())
    }
}

fn aspect(ask: &PaintRequest) -> f32 {
    ask.width as f32 / ask.height as f32
}

fn unit(robot: &Robot) -> String {
    robot.joints().first().map_or("rad", |j| j.unit.symbol()).to_owned()
}

fn wide(rows: &[Vec<f32>]) -> Vec<Vec<f64>> {
    rows.iter().map(|r| r.iter().map(|v| f64::from(*v)).collect()).collect()
}

fn rows(robot: &Robot, m: &MotionRows) -> Motion {
    Motion {
        name: m.name.clone(),
        performer: m.performer.clone(),
        fps: f64::from(FPS),
        commanded: wide(&m.commanded),
        achieved: wide(&m.achieved),
        keys: m.keys.clone(),
        unit: unit(robot),
    }
}

fn pose(robot: &Robot, q: &[f64]) -> Motion {
    Motion {
        achieved: vec![q.to_vec()],
        fps: f64::from(FPS),
        unit: unit(robot),
        ..Motion::default()
    }
}

fn performed(
    robot: &Arc<Robot>,
    name: &str,
    dense: &Dense,
    keys: &[usize],
) -> Result<(Motion, Option<MeanError>), Refusal> {
    let names: Vec<String> = robot.joints().iter().map(|j| j.name.clone()).collect();
    let Dense { joints, start, q, visible } = dense.clone();
    let command = Command::from_dense(joints, start, q, visible).and_then(|c| c.reordered(&names));
    let Some(command) = command else {
        let message = format!("the clip does not have the joints of robot {}", robot.id());
        return Err(Refusal::invalid(message));
    };
    let policy = PolicyConfig::default_for(robot)?;
    let config = RolloutConfig { guide: policy.guide, ..RolloutConfig::default() };
    let built = policy.build(robot)?;
    let mut rollout = Rollout::new(robot, built, &command, Start::Pose, config)?;
    while rollout.step()?.is_some() {}
    let commanded =
        command.goal_rows().map(|row| row.into_iter().map(f64::from).collect()).collect();
    let motion = Motion {
        name: name.to_owned(),
        performer: Some(policy.label()),
        fps: f64::from(FPS),
        commanded,
        achieved: rollout.reached().chunks_exact(robot.state_dim()).map(<[f64]>::to_vec).collect(),
        keys: keys.to_vec(),
        unit: unit(robot),
    };
    let unit = robot.joints().first().map_or(Unit::Rad, |j| j.unit);
    let error = rollout.precision().precision.map(|value| MeanError { value, unit });
    Ok((motion, error))
}
