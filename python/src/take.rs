//! Takes: made by a rollout, read from a file, drawn.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{IntoPyArray as _, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use robert::clip::Sight;
use robert::progress::Progress as _;
use robert::render::{CameraChoice, Motion, Overlay, RenderConfig, Renderer, Shot};
use robert::robot::{PlantConfig, Robot as LibRobot};
use robert::rollout::{Contenders, PolicyConfig, PolicyName, Rollout, RolloutConfig, Start};
use robert::take::viser::Recording;
use robert::take::{Provenance, Take as LibTake, html};
use robert::units::{FPS, Unit};

use crate::clip::Clip;
use crate::error::{raise, wrong};
use crate::jobs::listened;
use crate::robot::Robot;

/// A recorded rollout.
#[pyclass(frozen)]
pub(crate) struct Take {
    pub(crate) take: LibTake,
    pub(crate) robot: Arc<LibRobot>,
}

/// Performs a clip.
#[pyfunction]
#[pyo3(signature = (robot, clip, policy=None, seed=0, plant=None, progress=None))]
pub(crate) fn rollout(
    py: Python<'_>,
    robot: &Robot,
    clip: &Clip,
    policy: Option<&str>,
    seed: u64,
    plant: Option<&str>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Take> {
    let robot = Arc::clone(&robot.inner);
    let asked = policy.map(str::parse).transpose().map_err(raise)?;
    let asked: PolicyConfig = asked.unwrap_or_else(|| PolicyConfig::new(PolicyName::Auto));
    let plant: PlantConfig =
        plant.map_or_else(|| Ok(PlantConfig::default()), str::parse).map_err(raise)?;
    let command = clip.compiled(&robot)?;
    let clip = clip.inner.clone();
    let take = listened(py, progress, |listener, cancel| {
        let (policy, chosen) = if asked.is_tried() {
            let all = Contenders::new(&robot, &asked).map_err(raise)?;
            let threads = robert::parallel::cores();
            let chosen = all
                .perform(&command, &Start::Pose, seed, threads, listener, cancel)
                .map_err(raise)?;
            // They are compared on the nominal plant; on another one the best performs again.
            (chosen.policy.clone(), Some(chosen))
        } else {
            (asked, None)
        };
        let config = RolloutConfig { seed, guide: policy.guide, plant };
        let provenance = Provenance::new(&robot, &policy, &config).map_err(raise)?;
        let mut rollout = match chosen {
            Some(chosen) if config.plant == PlantConfig::default() => chosen.rollout,
            Some(chosen) => {
                chosen.again(&command, &Start::Pose, seed, config.plant).map_err(raise)?
            }
            None => {
                let built = policy.build(&robot).map_err(raise)?;
                Rollout::new(&robot, built, &command, Start::Pose, config).map_err(raise)?
            }
        };
        // The last frame's number, so that the end is told however fast it comes.
        let last = rollout.frames().saturating_sub(1) as u64;
        while let Some(frame) = rollout.step().map_err(raise)? {
            listener.tick(frame.frame as u64, last, "");
            if cancel.is_cancelled() {
                break;
            }
        }
        LibTake::record(&rollout, &command, Some(&clip), provenance).map_err(raise)
    })?;
    Ok(Take { take, robot })
}

#[pymethods]
impl Take {
    /// Reads a take; the robot is the take's own unless another is given.
    #[staticmethod]
    #[pyo3(signature = (path, robot=None))]
    fn load(path: PathBuf, robot: Option<&Robot>) -> PyResult<Take> {
        let take = LibTake::read(&path).map_err(raise)?;
        let robot = match robot {
            Some(robot) => Arc::clone(&robot.inner),
            None => Arc::new(LibRobot::load(&take.robot.id).map_err(raise)?),
        };
        take.check_robot(&robot).map_err(raise)?;
        Ok(Take { take, robot })
    }

    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| {
            let scene = self.take.scene(&self.robot).map_err(raise)?;
            self.take.write(&path, Some(&scene)).map_err(raise)
        })
    }

    /// The file of the take.
    fn mcap<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let scene = self.take.scene(&self.robot).map_err(raise)?;
        let bytes = py.detach(|| self.take.to_mcap(Some(&scene))).map_err(raise)?;
        Ok(PyBytes::new(py, &bytes))
    }

    #[getter]
    fn frames(&self) -> usize {
        self.take.frames()
    }

    #[getter]
    fn robot(&self) -> Robot {
        Robot { inner: Arc::clone(&self.robot) }
    }

    #[getter]
    fn policy(&self) -> &str {
        &self.take.provenance.policy
    }

    #[getter]
    fn bodies(&self) -> Vec<String> {
        self.take.robot.bodies.clone()
    }

    #[getter]
    fn clip(&self) -> PyResult<Option<Clip>> {
        let text = self.take.clip_text.as_deref();
        let parsed = text.map(robert::clip::Clip::parse).transpose().map_err(raise)?;
        Ok(parsed.map(|inner| Clip { inner }))
    }

    /// Precision and its kin, JSON.
    fn precision(&self) -> PyResult<String> {
        serde_json::to_string(&self.take.precision()).map_err(|e| wrong(e.to_string()))
    }

    /// One of the arrays, flat.
    fn array<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let values = match name {
            "q" => self.take.reached.clone(),
            "qd" => self.take.velocity.clone(),
            "ctrl" => self.take.ctrl.clone(),
            "effort" => self.take.effort.clone(),
            "action" => self.take.actions.clone(),
            "poses" => self.take.poses.clone(),
            // NaN where nothing is commanded.
            "error" => {
                let dim = self.take.state_dim();
                let cell = |i: usize| self.take.joint_error(i / dim, i % dim).unwrap_or(f64::NAN);
                (0..self.take.frames() * dim).map(cell).collect()
            }
            "command" => self.commanded().concat(),
            other => return Err(wrong(format!("no array {other:?}"))),
        };
        Ok(values.into_pyarray(py))
    }

    /// The page that plays the take.
    fn html<'py>(&self, py: Python<'py>, title: &str) -> PyResult<Bound<'py, PyBytes>> {
        let page = py.detach(|| {
            let client = html::client().map_err(raise)?;
            let recording = Recording::of(&self.take, &self.robot).map_err(raise)?;
            let recording = recording.to_bytes().map_err(raise)?;
            html::page(&client, title, &html::caption(&self.take), &recording).map_err(raise)
        })?;
        Ok(PyBytes::new(py, &page))
    }

    /// Pictures of frames: one after another, rows, columns, red green blue; flat.
    fn render<'py>(
        &self,
        py: Python<'py>,
        frames: Vec<usize>,
        width: u32,
        height: u32,
        overlay: &str,
        camera: &str,
    ) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let overlay = Overlay::parse(overlay).map_err(raise)?;
        let camera = CameraChoice::parse(camera);
        if let Some(beyond) = frames.iter().find(|f| **f >= self.take.frames()) {
            return Err(wrong(format!("frame {beyond} of {}", self.take.frames())));
        }
        let pixels = py.detach(|| {
            let config = RenderConfig { width, height, ..RenderConfig::default() };
            let mut renderer = Renderer::new(config).map_err(raise)?;
            let aspect = width as f32 / height as f32;
            let mut shot =
                Shot::new(&self.robot, self.motion(), overlay, &camera, aspect).map_err(raise)?;
            let mut pixels = Vec::with_capacity(frames.len() * (width * height * 3) as usize);
            for frame in frames {
                pixels.extend(shot.draw(&mut renderer, frame).map_err(raise)?.to_rgb());
            }
            Ok::<_, PyErr>(pixels)
        })?;
        Ok(pixels.into_pyarray(py))
    }
}

impl Take {
    /// Commanded rows; NaN where masked. (T, S)
    fn commanded(&self) -> Vec<Vec<f64>> {
        let command = &self.take.command;
        let frames = u32::try_from(self.take.frames()).unwrap_or(u32::MAX);
        (0..frames)
            .map(|f| {
                let masked = f >= command.frames() || command.sight(f) == Sight::Masked;
                let cell = |j: usize| {
                    let seen = !masked && command.sees(f, j);
                    if seen { f64::from(command.row(f)[j]) } else { f64::NAN }
                };
                (0..self.take.state_dim()).map(cell).collect()
            })
            .collect()
    }

    pub(crate) fn motion(&self) -> Motion {
        let clip = self.take.clip_text.as_ref();
        let clip = clip.and_then(|t| robert::clip::Clip::parse(t).ok());
        let rad = self.take.robot.units.contains(&Unit::Rad);
        Motion {
            name: clip.as_ref().map_or_else(String::new, |c| c.name.clone()),
            performer: Some(self.take.provenance.policy.clone()),
            fps: f64::from(FPS),
            commanded: self.commanded(),
            achieved: (0..self.take.frames()).map(|f| self.take.state(f).to_vec()).collect(),
            keys: clip.map_or_else(Vec::new, |c| c.keys.iter().map(|k| k.frame as usize).collect()),
            unit: if rad { "rad" } else { "m" }.to_owned(),
        }
    }
}
