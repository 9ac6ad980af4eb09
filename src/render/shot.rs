//! A motion as pictures: overlays at each frame, and the camera.
//!
//! Between keyframes there is no command to
//! show, so the ghost shows the next goal in the window, fainter the later it is. It shows the next
//! goal without suggesting that the robot should be there already.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::camera_path::CameraPath;
use super::caption::Captioner;
use super::frame::{FrameInput, Ghost, Glyph, Mark, Trail, sun_for};
use super::instances::{AXIS, CONTACT, FUTURE, PAST, tint};
use super::motion::SIGHT_FRAMES;
use super::{
    Camera, CameraChoice, Caption, Error, Key, Motion, Picture, Pose, Renderer, Stage, Swatch,
    View, pick,
};
use robert_plot::palette;
use robert_robot::Robot;

/// Colour of the command in a legend; it looks like the lit ghost.
const COMMAND_COLOR: palette::Rgb = [56, 152, 226];
/// Frames that are sampled to find a camera for all of them.
const FIT_FRAMES: usize = 48;
/// Frames of a trail if there are several (fingertips); a single trail is complete.
const TRAIL_FRAMES: usize = 30;
/// Onion skins on each side.
const ONIONS: usize = 1;
/// Pieces between two frames of a path.
const PIECES: usize = 4;
/// The most crosses to draw.
const MARKS: usize = 400;

/// The overlays; each can be switched separately.
#[allow(clippy::struct_excessive_bools)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overlay {
    /// The commanded pose.
    pub ghost: bool,
    /// Tint the ghost by the error of each link.
    pub error: bool,
    /// Poses of the keyframes before and after.
    pub onion: bool,
    /// Without the solid robot.
    pub bare: bool,
    /// Paths of fingertips or end effector, with crosses at commanded keyframes.
    pub trail: bool,
    /// Title, time, Precision, legend.
    pub caption: bool,
    /// Joint axes.
    pub axes: bool,
    /// Contacts.
    pub contacts: bool,
}

impl Default for Overlay {
    fn default() -> Self {
        Overlay {
            ghost: true,
            error: true,
            onion: false,
            bare: false,
            trail: true,
            caption: true,
            axes: false,
            contacts: false,
        }
    }
}

impl Overlay {
    /// Names as they are typed.
    pub const NAMES: &'static str =
        "ghost, error, onion, bare, trail, caption, axes, contacts, none";

    /// From a comma-separated list.
    ///
    /// # Errors
    /// [`Error::Unknown`] with the existing names.
    pub fn parse(text: &str) -> Result<Overlay, Error> {
        let mut o = Overlay {
            ghost: false,
            error: false,
            onion: false,
            bare: false,
            trail: false,
            caption: false,
            axes: false,
            contacts: false,
        };
        for word in text.split(',').map(str::trim).filter(|w| !w.is_empty()) {
            match word {
                "ghost" | "command" => o.ghost = true,
                "error" => (o.ghost, o.error) = (true, true),
                "onion" => o.onion = true,
                "bare" => o.bare = true,
                "trail" => o.trail = true,
                "caption" => o.caption = true,
                "axes" => o.axes = true,
                "contacts" => o.contacts = true,
                "none" => {}
                other => {
                    return Err(Error::Unknown {
                        kind: "overlay",
                        name: other.to_owned(),
                        known: Overlay::NAMES.to_owned(),
                    });
                }
            }
        }
        Ok(o)
    }
}

impl CameraChoice {
    /// Refuses a body or camera that the robot does not have, before anything is performed.
    ///
    /// # Errors
    /// [`Error::Unknown`]; as [`Stage::new`].
    pub fn check(&self, robot: &Arc<Robot>) -> Result<(), Error> {
        match self {
            CameraChoice::Named(name) => Stage::new(robot)?.model_camera(name).map(drop),
            CameraChoice::Follow(body) => Stage::new(robot)?.scene().body(body).map(drop),
            _ => Ok(()),
        }
    }
}

/// A motion ready to be drawn frame by frame.
#[derive(Debug)]
pub struct Shot {
    stage: Stage,
    motion: Motion,
    overlay: Overlay,
    path: CameraPath,
    /// The points of a fitted camera, and its direction; `None` if nothing is fitted.
    points: Vec<Vec3>,
    fitted: Option<(View, f32)>,
    sun: Vec3,
    /// Path of each tip; (tips, frames).
    tips: Vec<Vec<Vec3>>,
    /// Colour of each path: that of the tip itself, if it has one.
    colors: Vec<[f32; 3]>,
    /// Commanded places of the first tips at keyframes: (tip, frame, place).
    marks: Vec<(usize, usize, Vec3)>,
    /// Unit of the captions: one for the whole film, chosen by its last figure.
    unit: (f64, String),
    /// Error at which a link is completely red, metres.
    full_m: f32,
    /// Whether title and legend were drawn already.
    brief: bool,
    /// Captions are for a strip.
    large: bool,
    /// As wide as the line of any frame.
    widest: String,
}

impl Shot {
    /// Processes the motion once, to find the paths of the tips and the camera.
    ///
    /// # Errors
    /// [`Error::Robot`] for states that do not fit the robot, [`Error::Unknown`] for a camera
    /// or body, [`Error::NoFrames`].
    pub fn new(
        robot: &Arc<Robot>,
        motion: Motion,
        overlay: Overlay,
        camera: &CameraChoice,
        aspect: f32,
    ) -> Result<Shot, Error> {
        let mut stage = Stage::new(robot)?;
        if motion.achieved.is_empty() {
            return Err(Error::NoFrames);
        }
        let sites = if overlay.trail { stage.tips() } else { Vec::new() };
        let mut tips = vec![Vec::with_capacity(motion.frames()); sites.len()];
        for state in &motion.achieved {
            for (path, site) in tips.iter_mut().zip(&sites) {
                path.push(stage.site(state, *site)?);
            }
        }
        let mut marks = Vec::new();
        for &key in motion.keys.iter().take(MARKS / sites.len().max(1)) {
            let Some(command) = motion.command(key, key.min(motion.frames() - 1)) else { continue };
            for (tip, site) in sites.iter().enumerate() {
                marks.push((tip, key, stage.site(&command, *site)?));
            }
        }
        let mut points = points(&mut stage, &motion, overlay, &tips, &marks)?;
        if *camera == CameraChoice::Top {
            // A plan shows the whole robot, also an arm that stands still.
            let poses = stage.poses(&motion.achieved[0])?;
            points.extend(stage.still_corners(&poses, &points));
        }
        let path = CameraPath::new(&mut stage, &motion, camera, &points, aspect)?;
        let fitted = match camera {
            CameraChoice::Fit | CameraChoice::Orbit => Some((stage.view(), aspect)),
            CameraChoice::Top => Some((View::top(), aspect)),
            CameraChoice::Fixed | CameraChoice::Follow(_) | CameraChoice::Named(_) => None,
        };
        let colors = sites.iter().enumerate().map(|(i, s)| stage.accent(*s, i)).collect();
        let typical = motion.precision(motion.frames()).unwrap_or(0.0);
        // Angles in degrees, as on the page of the studio.
        let unit = match motion.unit.as_str() {
            "rad" => (1_f64.to_degrees(), "\u{b0}".to_owned()),
            unit => robert_base::units::short_unit(unit, typical),
        };
        let sun = Vec3::Z;
        let mut shot = Shot {
            stage,
            motion,
            overlay,
            path,
            full_m: full_error(&points),
            points,
            fitted,
            sun,
            tips,
            colors,
            marks,
            unit,
            brief: false,
            large: false,
            widest: String::new(),
        };
        shot.widest = shot.widest_line();
        // Computed once, so that the light does not move while a camera orbits.
        shot.sun = sun_for(&shot.camera(0));
        Ok(shot)
    }

    /// Gives all shots of one robot the same camera and the same scale of errors, so that they can
    /// be compared side by side.
    pub fn share_camera(shots: &mut [Shot]) {
        let ids: Vec<String> = shots.iter().map(|s| s.stage.robot().id().to_owned()).collect();
        for (i, id) in ids.iter().enumerate() {
            // Once for each robot with more than one shot.
            if ids.iter().position(|k| k == id) != Some(i)
                || ids.iter().filter(|k| *k == id).count() < 2
            {
                continue;
            }
            let same = || ids.iter().enumerate().filter(|(_, k)| *k == id).map(|(k, _)| k);
            let points: Vec<Vec3> =
                same().filter_map(|k| shots.get(k)).flat_map(|s| s.points.clone()).collect();
            for k in same() {
                if let Some(shot) = shots.get_mut(k) {
                    shot.hold(&points);
                }
            }
        }
    }

    fn hold(&mut self, points: &[Vec3]) {
        self.full_m = full_error(points);
        match (&mut self.path, &self.fitted) {
            (CameraPath::Still(camera), Some((view, aspect))) => {
                *camera = Camera::fit(points, view, *aspect);
            }
            (CameraPath::Orbit { points: own, .. }, _) => *own = points.to_vec(),
            _ => {}
        }
        self.sun = sun_for(&self.camera(0));
    }

    /// The motion.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// Reduces the following captions to frame, time and Precision; title and legend are on another
    /// picture of the same strip.
    pub fn be_brief(&mut self) {
        self.brief = true;
    }

    /// Gives the following captions large letters, because a strip is shown smaller than it is
    /// drawn.
    pub fn be_large(&mut self) {
        self.large = true;
    }

    /// Whether pictures of this size are too small for the legend, and have none.
    pub fn drops_legend(&self, width: u32, height: u32) -> bool {
        let caption = self.overlay.caption.then(|| self.caption(0));
        caption.is_some_and(|c| Captioner::default().drops_legend(width, height, &c))
    }

    /// The eye at a frame.
    pub fn camera(&self, frame: usize) -> Camera {
        self.path.at(frame, self.motion.frames())
    }

    /// Draws one frame; frames beyond the end are the last one.
    ///
    /// # Errors
    /// As [`Renderer::draw`].
    pub fn draw(&mut self, renderer: &mut Renderer, frame: usize) -> Result<Picture, Error> {
        let frame = frame.min(self.motion.frames() - 1);
        let state = self.motion.achieved[frame].clone();
        let poses = self.stage.poses(&state)?;
        let mut glyphs = Vec::new();
        let scale = self.full_m * 10.0;
        if self.overlay.axes {
            let axes = self.stage.joint_axes();
            glyphs.extend(axes.iter().map(|&(anchor, axis)| Glyph::JointAxis {
                anchor,
                axis,
                length: 0.16 * scale,
            }));
        }
        if self.overlay.contacts {
            let touches = self.stage.contacts(&state)?;
            glyphs.extend(touches.iter().map(|&(at, normal)| Glyph::Contact {
                at,
                normal,
                length: 0.10 * scale,
            }));
        }
        let (command, opacity) = self.command_poses(frame)?;
        let error = match &command {
            // There is an error only if there is a goal now.
            Some(c) if self.overlay.error && self.motion.has_goal(frame) => {
                Stage::error(&poses, c, self.full_m)
            }
            _ => Vec::new(),
        };
        let onions = self.onion_poses(frame)?;
        let mut ghosts = Vec::new();
        if let Some(c) = &command {
            ghosts.push(Ghost { error: &error, opacity, ..Ghost::command(c) });
        }
        ghosts.extend(onions.iter().map(|(p, past)| Ghost::onion(p, *past)));
        let one = self.tips.len() == 1;
        let from = if one { 0 } else { frame.saturating_sub(TRAIL_FRAMES) };
        let paths: Vec<Vec<Vec3>> =
            self.tips.iter().filter_map(|p| p.get(from..=frame)).map(rounded).collect();
        let trails: Vec<Trail> = paths
            .iter()
            .enumerate()
            .map(|(i, p)| Trail::new(p, self.colors.get(i).copied().unwrap_or([1.0; 3])))
            .collect();
        let marks: Vec<Mark> = self
            .marks
            .iter()
            .filter(|(_, key, _)| one || key.abs_diff(frame) <= TRAIL_FRAMES)
            .map(|(_, _, at)| Mark { at: *at, color: palette::unit(palette::BLUE), size: 6.0 })
            .collect();
        let caption = self.overlay.caption.then(|| self.caption(frame));
        let input = FrameInput {
            bare: self.overlay.bare,
            ghosts: &ghosts,
            trails: &trails,
            marks: &marks,
            glyphs: &glyphs,
            sun: Some(self.sun),
            caption: caption.as_ref(),
            ..FrameInput::new(&poses, self.camera(frame))
        };
        renderer.draw(self.stage.scene(), &input)
    }

    /// The body at a point of a frame's picture (-1 to 1, y up); `None` for the floor or the sky.
    /// Ghosts are ignored.
    ///
    /// # Errors
    /// [`Error::Robot`].
    pub fn body_at(&mut self, frame: usize, at: Vec2, aspect: f32) -> Result<Option<&str>, Error> {
        let frame = frame.min(self.motion.frames() - 1);
        let state = self.motion.achieved[frame].clone();
        let poses = self.stage.poses(&state)?;
        let camera = self.camera(frame);
        let scene = self.stage.scene();
        let geom = pick::geom_at(scene, &poses, &camera, at, aspect);
        let body = geom.and_then(|g| scene.geoms().get(g)).map(|g| g.body);
        Ok(body.and_then(|b| scene.body_name(b)))
    }

    fn command_poses(&mut self, frame: usize) -> Result<(Option<Vec<Pose>>, f32), Error> {
        if !self.overlay.ghost {
            return Ok((None, 0.0));
        }
        let Some(goal) = self.motion.goal(frame) else { return Ok((None, 0.0)) };
        let Some(state) = self.motion.command(goal, frame) else { return Ok((None, 0.0)) };
        let near = 1.0 - (goal - frame) as f32 / (SIGHT_FRAMES + 1) as f32;
        Ok((Some(self.stage.poses(&state)?), 0.18 + 0.37 * near))
    }

    fn onion_poses(&mut self, frame: usize) -> Result<Vec<(Vec<Pose>, bool)>, Error> {
        if !self.overlay.onion {
            return Ok(Vec::new());
        }
        let before = self.motion.keys.iter().rev().filter(|k| **k < frame).take(ONIONS);
        let after = self.motion.keys.iter().filter(|k| **k > frame).take(ONIONS);
        let keys: Vec<(usize, bool)> =
            before.map(|k| (*k, true)).chain(after.map(|k| (*k, false))).collect();
        let mut out = Vec::new();
        for (key, past) in keys {
            if let Some(state) = self.motion.command(key, frame) {
                out.push((self.stage.poses(&state)?, past));
            }
        }
        Ok(out)
    }

    /// Frame, time and Precision in words.
    fn moment(&self, frame: usize) -> String {
        let secs = frame as f64 / self.motion.fps.max(1e-9);
        let (factor, unit) = &self.unit;
        // Without a simulation there is no error to tell.
        let precision = self.motion.performer.as_ref().and(self.motion.precision(frame));
        let precision = precision.map(|p| (p * factor, unit.as_str()));
        Caption::moment(frame as u32, secs, precision)
    }

    fn with_performer(&self, moment: &str) -> String {
        let performer = self.motion.performer.as_deref().unwrap_or("not simulated");
        format!("{moment} · {performer}")
    }

    /// The last line with wide digits, and one digit more: Precisions differ by that.
    fn widest_line(&self) -> String {
        let last = self.moment(self.motion.frames().saturating_sub(1));
        let wide = last.replace(|c: char| c.is_ascii_digit(), "8");
        self.with_performer(&format!("{wide}8"))
    }

    fn caption(&self, frame: usize) -> Caption {
        let m = &self.motion;
        let (line, widest, large) = (self.moment(frame), self.widest.clone(), self.large);
        if self.brief {
            return Caption { line, large, widest, ..Caption::default() };
        }
        let line = self.with_performer(&line);
        let mut legend = Vec::new();
        let mut add = |swatch, color, text: &str| {
            legend.push(Key { swatch, color, text: text.to_owned() });
        };
        let o = self.overlay;
        if o.ghost || o.onion || o.trail {
            add(Swatch::Solid, [208, 212, 218], "achieved");
        }
        if o.ghost {
            // The same for all frames of a film: a legend that changes its size draws the eye.
            let text = match (m.shows_next_goals(), o.error) {
                (true, true) => "command or next goal, small error",
                (true, false) => "command or next goal",
                (false, true) => "command, small error",
                (false, false) => "command",
            };
            add(Swatch::Ghost, COMMAND_COLOR, text);
            if o.error {
                add(Swatch::Ghost, tint(1.0), "command, large error");
            }
        }
        if o.onion {
            add(Swatch::Ghost, PAST, "key before");
            add(Swatch::Ghost, FUTURE, "key after");
        }
        if let (true, Some(color)) = (o.trail, self.colors.first()) {
            add(Swatch::Line, color.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8), "path");
        }
        if o.trail && !self.marks.is_empty() {
            add(Swatch::Cross, COMMAND_COLOR, "keyframe");
        }
        if o.axes {
            add(Swatch::Line, AXIS, "joint axis");
        }
        if o.contacts {
            add(Swatch::Line, CONTACT, "contact");
        }
        Caption { title: m.name.clone(), line, legend, large, widest }
    }
}

/// The points that the camera must show: moving links over the whole motion, and the parts that
/// they are attached to.
fn points(
    stage: &mut Stage,
    motion: &Motion,
    overlay: Overlay,
    tips: &[Vec<Vec3>],
    marks: &[(usize, usize, Vec3)],
) -> Result<Vec<Vec3>, Error> {
    let stride = motion.frames().div_ceil(FIT_FRAMES).max(1);
    let mut points = Vec::new();
    for frame in (0..motion.frames()).step_by(stride) {
        if let Some(state) = motion.achieved.get(frame) {
            let poses = stage.poses(state)?;
            points.extend(stage.moving_corners(&poses));
        }
        if overlay.ghost
            && let Some(state) = motion.goal(frame).and_then(|goal| motion.command(goal, frame))
        {
            let poses = stage.poses(&state)?;
            points.extend(stage.moving_corners(&poses));
        }
    }
    points.extend(tips.iter().flatten().copied());
    points.extend(marks.iter().map(|m| m.2));
    Ok(points)
}

/// Error at which a link is completely red, metres: a tenth of the size of the shown parts.
fn full_error(points: &[Vec3]) -> f32 {
    let low = points.iter().fold(Vec3::INFINITY, |a, p| a.min(*p));
    let high = points.iter().fold(Vec3::NEG_INFINITY, |a, p| a.max(*p));
    0.10 * low.distance(high).clamp(0.01, 100.0)
}

/// A smooth curve through all points of a path (Catmull and Rom, 1974).
fn rounded(path: &[Vec3]) -> Vec<Vec3> {
    let at = |i: usize| path.get(i.min(path.len().saturating_sub(1))).copied().unwrap_or_default();
    let mut out = Vec::with_capacity(path.len() * PIECES);
    for i in 0..path.len().saturating_sub(1) {
        let (a, b, c, d) = (at(i.saturating_sub(1)), at(i), at(i + 1), at(i + 2));
        for k in 0..PIECES {
            let t = k as f32 / PIECES as f32;
            let (t2, t3) = (t * t, t * t * t);
            out.push(
                b + 0.5 * (c - a) * t
                    + (a - 2.5 * b + 2.0 * c - 0.5 * d) * t2
                    + (1.5 * (b - c) + 0.5 * (d - a)) * t3,
            );
        }
    }
    out.extend(path.last());
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rounded_path_goes_through_its_frames() {
        let path: Vec<Vec3> =
            (0..9).map(|i| Vec3::new(i as f32, (i * i % 5) as f32, 1.0)).collect();
        let round = rounded(&path);
        assert_eq!(round.len(), 8 * PIECES + 1);
        for (i, p) in path.iter().enumerate() {
            assert!(round[i * PIECES].distance(*p) < 1e-5, "{i}");
        }
        assert!(rounded(&[]).is_empty());
        assert_eq!(rounded(&[Vec3::X]), [Vec3::X]);
        // A straight line stays one.
        let line = rounded(&[Vec3::ZERO, Vec3::X, 2.0 * Vec3::X]);
        assert!(line.iter().all(|p| p.y == 0.0 && p.z == 0.0));
    }

    fn shot(robot: &str, reach: f64, overlay: &str) -> Shot {
        let robot = Arc::new(Robot::builtin(robot).unwrap());
        let home = robot.home();
        let away: Vec<f64> = home.iter().map(|q| q + reach).collect();
        let motion = Motion {
            fps: 20.0,
            commanded: vec![home.clone(), away.clone()],
            achieved: vec![home, away],
            keys: vec![1],
            ..Motion::default()
        };
        let overlay = Overlay::parse(overlay).unwrap();
        Shot::new(&robot, motion, overlay, &CameraChoice::Fit, 1.0).unwrap()
    }

    #[test]
    fn shots_of_one_robot_share_their_camera() {
        let shots = [("pointmass", 0.02), ("ur5e", 0.1), ("pointmass", 0.2)];
        let mut shots = shots.map(|(robot, reach)| shot(robot, reach, "ghost,trail"));
        let alone = [0, 1, 2].map(|i| shots[i].camera(0));
        assert!(alone[0] != alone[2]);
        Shot::share_camera(&mut shots);
        let shared = [0, 1, 2].map(|i| shots[i].camera(0));
        assert_eq!(shared[0], shared[2]);
        assert_eq!(shared[1], alone[1], "the only one of its robot");
        assert_eq!(shots[0].full_m, shots[2].full_m);
    }

    #[test]
    fn angles_are_in_degrees_as_on_the_page() {
        let robot = Arc::new(Robot::builtin("ur5e").unwrap());
        let home = robot.home();
        let off: Vec<f64> = home.iter().map(|q| q + 0.01).collect();
        let motion = Motion {
            fps: 20.0,
            unit: "rad".to_owned(),
            performer: Some("pd".to_owned()),
            commanded: vec![home.clone(); 2],
            achieved: vec![home, off],
            ..Motion::default()
        };
        let line = |motion: Motion| {
            let overlay = Overlay::parse("caption").unwrap();
            let shot = Shot::new(&robot, motion, overlay, &CameraChoice::Fit, 1.0).unwrap();
            shot.caption(1).line
        };
        assert_eq!(line(motion.clone()), "frame 1 · 0.05 s · Precision 0.573\u{b0} · pd");
        let still = Motion { performer: None, ..motion };
        assert_eq!(line(still), "frame 1 · 0.05 s · not simulated");
    }

    #[test]
    fn the_legend_names_every_sign() {
        let keys = |overlay: &str, frame| -> Vec<(Swatch, palette::Rgb, String)> {
            let legend = shot("pointmass", 0.1, overlay).caption(frame).legend;
            legend.into_iter().map(|k| (k.swatch, k.color, k.text)).collect()
        };
        let texts =
            |overlay: &str| -> Vec<String> { keys(overlay, 1).into_iter().map(|k| k.2).collect() };
        assert_eq!(texts("caption,ghost"), ["achieved", "command"]);
        let error = keys("caption,error", 1);
        let (small, large) = (&error[1], &error[2]);
        assert!(small.2.contains("small error") && large.2.contains("large error"));
        assert_eq!((small.1, large.1), (COMMAND_COLOR, palette::VERMILION));
        assert_eq!(texts("caption,trail"), ["achieved", "path", "keyframe"]);
        let signs = keys("caption,axes,contacts", 1);
        assert_eq!(
            signs.iter().map(|k| k.2.as_str()).collect::<Vec<_>>(),
            ["joint axis", "contact"]
        );
        assert!(signs[0].1 != signs[1].1);
    }

    #[test]
    fn the_legend_is_the_same_for_all_frames() {
        let mut shot = shot("pointmass", 0.1, "caption,error");
        let [home, away] = [0, 1].map(|f| shot.motion.commanded[f].clone());
        let none = vec![f64::NAN; 2];
        shot.motion.achieved = vec![home.clone(); 4];
        // A goal, one ahead, one now, and none any more.
        shot.motion.commanded = vec![home, none.clone(), away, none];
        assert_eq!([0, 1, 2, 3].map(|f| shot.motion.goal(f)), [Some(0), Some(2), Some(2), None]);
        let texts = |frame| -> Vec<String> {
            shot.caption(frame).legend.into_iter().map(|k| k.text).collect()
        };
        assert!(texts(0)[1].contains("next goal"));
        for frame in 1..4 {
            assert_eq!(texts(frame), texts(0), "frame {frame}");
        }
    }

    #[test]
    fn overlays_are_named() {
        let o = Overlay::parse("error, trail").unwrap();
        assert!(o.ghost && o.error && o.trail && !o.caption);
        let text = Overlay::parse("gost").unwrap_err().to_string();
        assert!(text.contains("ghost"), "{text}");
    }
}
