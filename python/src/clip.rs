//! A clip: keys, masks, what stands between.

use std::path::PathBuf;

use numpy::{IntoPyArray as _, PyArray1};
use pyo3::prelude::*;
use robert::clip::{self as lib, Editor, Fill, Key, Mask, Op, compile_for};
use robert::robot::Robot as LibRobot;
use robert::rollout::{ClipFacts as _, tasks};

use crate::error::{InvalidInput, raise, wrong};
use crate::robot::Robot;

type Compiled<'py> = (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<bool>>, usize);

/// A clip. Edits are checked as a whole: a clip that an edit would break stays as it was.
#[pyclass]
pub(crate) struct Clip {
    pub(crate) inner: lib::Clip,
}

#[pymethods]
impl Clip {
    #[new]
    fn new(robot: &Robot, frames: u32) -> PyResult<Clip> {
        let inner = lib::Clip::new(robot.inner.clip_ref(), frames);
        inner.validate().map_err(|e| InvalidInput::new_err(e.to_string()))?;
        Ok(Clip { inner })
    }

    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Clip> {
        Ok(Clip { inner: lib::Clip::load(&path).map_err(raise)? })
    }

    #[staticmethod]
    fn parse(text: &str) -> PyResult<Clip> {
        Ok(Clip { inner: lib::Clip::parse(text).map_err(raise)? })
    }

    #[staticmethod]
    #[pyo3(signature = (name, robot=None))]
    fn task(name: &str, robot: Option<&str>) -> PyResult<Clip> {
        Ok(Clip { inner: tasks::find(name, robot).map_err(raise)? })
    }

    /// The clips of a suite of a robot, with their names.
    #[staticmethod]
    fn suite(robot: &str, suite: &str) -> PyResult<Vec<(String, Clip)>> {
        let clips = tasks::suite(robot, suite).map_err(raise)?;
        Ok(clips.into_iter().map(|(name, inner)| (name, Clip { inner })).collect())
    }

    fn text(&self) -> String {
        self.inner.to_text()
    }

    /// Writes the file whole or not at all.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        robert::fsio::write_atomic(&path, self.inner.to_text().as_bytes()).map_err(raise)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    #[setter]
    fn set_name(&mut self, name: String) -> PyResult<()> {
        self.edit(|clip| clip.name = name)
    }

    #[getter]
    fn robot(&self) -> &str {
        &self.inner.robot.id
    }

    #[getter]
    fn joints(&self) -> Vec<String> {
        self.inner.robot.joints.clone()
    }

    #[getter]
    fn frames(&self) -> u32 {
        self.inner.length
    }

    /// Frames of the keys.
    #[getter]
    fn keys(&self) -> Vec<u32> {
        self.inner.keys.iter().map(|k| k.frame).collect()
    }

    /// Sets a key; NaN says nothing about a joint. One that stands at the frame is replaced.
    fn key(&mut self, frame: u32, q: Vec<f64>, hold: u32, fill: Option<&str>) -> PyResult<()> {
        let row = q.iter().map(|v| (!v.is_nan()).then_some(*v)).collect();
        let fill = fill.map(fill_word).transpose()?;
        let key = Key { hold, fill, ..Key::with(frame, lib::Goal::Q(row)) };
        self.edit(|clip| {
            clip.keys.retain(|k| k.frame != frame);
            clip.keys.push(key);
        })
    }

    fn mask(&mut self, from: u32, to: u32, joints: Option<Vec<String>>) -> PyResult<()> {
        self.edit(|clip| clip.masks.push(Mask { from, to, joints }))
    }

    fn fill(&mut self, word: &str) -> PyResult<()> {
        let fill = fill_word(word)?;
        self.edit(|clip| clip.fill = fill)
    }

    /// A key a row: what was dense becomes a clip that says the same; NaN is open.
    #[staticmethod]
    fn dense(robot: &Robot, q: Vec<Vec<f64>>, tolerance: f64) -> PyResult<Clip> {
        let rows = q.iter().enumerate().map(|(frame, row)| {
            let row = row.iter().map(|v| (!v.is_nan()).then_some(*v)).collect();
            (frame as f64 * robert::units::CTRL_DT, row)
        });
        let rows: Vec<_> = rows.collect();
        let joints = robot.inner.state_dim();
        if let Some(frame) = q.iter().position(|r| r.len() != joints) {
            return Err(wrong(format!(
                "row {frame} has {} values for {joints} joints",
                q[frame].len()
            )));
        }
        let mut inner = lib::formats::from_samples(&rows, &robot.inner.clip_ref(), Fill::Mask)
            .map_err(raise)?;
        if tolerance > 0.0 {
            lib::thin(&mut inner, tolerance);
        }
        Ok(Clip { inner })
    }

    /// Whether only the robot knows what some keys command, since they have end-effector goals.
    #[getter]
    fn has_reach(&self) -> bool {
        self.inner.keys.iter().any(|k| !k.reach.is_empty())
    }

    /// One edit of `robert clip apply`, as JSON. The robot solves end-effector goals and mirrors.
    #[pyo3(signature = (edit, robot=None))]
    fn apply(&mut self, edit: &str, robot: Option<&Robot>) -> PyResult<()> {
        let op: Op = serde_json::from_str(edit).map_err(|e| wrong(e.to_string()))?;
        let table = robot.map(|r| r.inner.joint_table());
        let refused = |e: String| InvalidInput::new_err(format!("{}: {e}", op.name()));
        let mut editor =
            Editor::new(self.inner.clone(), table).map_err(|e| refused(e.to_string()))?;
        editor.apply(&op).map_err(|e| refused(e.to_string()))?;
        self.inner = editor.clip().clone();
        Ok(())
    }

    /// The pose before frame 0, (S).
    #[pyo3(signature = (robot=None))]
    fn start<'py>(
        &self,
        py: Python<'py>,
        robot: Option<&Robot>,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let table = robot.map(|r| r.inner.joint_table());
        let command = compile_for(&self.inner, table.as_ref())
            .map_err(|e| InvalidInput::new_err(e.to_string()))?;
        Ok(command.start().to_vec().into_pyarray(py))
    }

    /// What is commanded: values (T * S), whether each counts (T * S), frames T.
    #[pyo3(signature = (robot=None))]
    fn command<'py>(&self, py: Python<'py>, robot: Option<&Robot>) -> PyResult<Compiled<'py>> {
        let table = robot.map(|r| r.inner.joint_table());
        let command = compile_for(&self.inner, table.as_ref())
            .map_err(|e| InvalidInput::new_err(e.to_string()))?;
        let (mut q, mut seen) = (Vec::new(), Vec::new());
        for f in 0..command.frames() {
            q.extend_from_slice(command.row(f));
            seen.extend((0..command.dim()).map(|j| command.sees(f, j)));
        }
        Ok((q.into_pyarray(py), seen.into_pyarray(py), command.frames() as usize))
    }
}

impl Clip {
    /// Its command for a rollout, as the command line compiles it: end-effector goals solved, joints
    /// in the robot's order. Joints that the robot does not have are refused by the rollout.
    pub(crate) fn compiled(&self, robot: &LibRobot) -> PyResult<lib::Command> {
        let command =
            robot.compile(&self.inner).map_err(|e| InvalidInput::new_err(e.to_string()))?;
        let names: Vec<String> = robot.joints().iter().map(|j| j.name.clone()).collect();
        Ok(command.reordered(&names).unwrap_or(command))
    }

    fn edit(&mut self, change: impl FnOnce(&mut lib::Clip)) -> PyResult<()> {
        let mut changed = self.inner.clone();
        change(&mut changed);
        changed.normalize();
        changed.validate().map_err(|e| InvalidInput::new_err(e.to_string()))?;
        self.inner = changed;
        Ok(())
    }
}

fn fill_word(word: &str) -> PyResult<Fill> {
    match word {
        "mask" => Ok(Fill::Mask),
        "linear" => Ok(Fill::Linear),
        "cubic" => Ok(Fill::Cubic),
        "hold" => Ok(Fill::Hold),
        _ => Err(wrong(format!("a fill is mask, linear, cubic or hold, not {word:?}"))),
    }
}
