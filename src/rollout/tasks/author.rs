//! Generates task clips from formulas and pose tables: the trial clips, and in `tests/tasks` the
//! shipped ones of three suites.

use robert_base::units::CTRL_DT;
use robert_clip::{Clip, Key, RobotRef};
use robert_robot::Robot;

/// A task clip with its name and suite.
#[derive(Clone, Debug)]
pub struct Authored {
    /// File name without suffix.
    pub name: &'static str,
    /// One of [`super::SUITES`].
    pub suite: &'static str,
    /// The document.
    pub clip: Clip,
}

/// An empty clip for this robot; `frames` counts the commands after frame 0.
pub fn blank(robot: &Robot, title: &str, notes: &str, frames: u32) -> Clip {
    let joints = robot.joints();
    let reference = RobotRef {
        id: robot.id().to_owned(),
        model: None,
        model_sha256: Some(robot.model_sha256().to_owned()),
        joints: joints.iter().map(|j| j.name.clone()).collect(),
        units: joints.iter().map(|j| j.unit).collect(),
    };
    let mut clip = Clip::new(reference, frames + 1);
    title.clone_into(&mut clip.name);
    notes.clone_into(&mut clip.notes);
    clip
}

/// A key at every frame: `q` gives the pose at a time in seconds.
pub fn dense(
    robot: &Robot,
    title: &str,
    notes: &str,
    frames: u32,
    q: impl Fn(f64) -> Vec<f64>,
) -> Clip {
    let mut clip = blank(robot, title, notes, frames);
    clip.keys = (0..=frames).map(|f| Key::new(f, &q(f64::from(f) * CTRL_DT))).collect();
    clip
}

/// The same motion with a key every `step` frames and at the end, masked between.
pub fn thinned(clip: &Clip, step: u32, title: &str, notes: &str) -> Clip {
    let mut thin = clip.clone();
    title.clone_into(&mut thin.name);
    notes.clone_into(&mut thin.notes);
    thin.keys.retain(|k| k.frame % step == 0 || k.frame + 1 == clip.length);
    thin
}

/// Poses one after another. The first one is at frame 0; before each of the others `gap` frames are
/// masked, and each is held for `hold` frames.
pub fn sequence(clip: &mut Clip, start: &str, steps: &[(&str, u32, u32)]) {
    clip.keys = vec![Key::posed(0, start)];
    let mut frame = 1;
    for &(pose, gap, hold) in steps {
        clip.keys.push(Key::posed(frame + gap, pose).held(hold));
        frame += gap + hold;
    }
    clip.length = frame;
}

/// Only the middle frame of each hold stays visible; the clip ends as it did.
pub fn middles(clip: &Clip, title: &str, notes: &str) -> Clip {
    let mut sparse = clip.clone();
    title.clone_into(&mut sparse.name);
    notes.clone_into(&mut sparse.notes);
    for key in sparse.keys.iter_mut().skip(1) {
        key.frame += key.hold / 2;
        key.hold = 1;
    }
    sparse
}
