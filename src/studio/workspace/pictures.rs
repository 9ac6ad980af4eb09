//! Pictures for the page: the playhead, poses, examples; a child process draws them.
//!
//! The painter starts with the first picture and ends after a while without requests. Its pictures
//! are kept in memory within a limit. Pictures of examples, which never change, are also kept in
//! the state folder, so that the second start shows them at once.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::body::Bytes;

use super::gallery;
use crate::protocol::{Error, MeanError, WorkerState};
use crate::simulation::RolloutStore;
use crate::simulation::worker::{
    Dense, PaintRequest, PickRequest, Picture, Question, SimulationEvent, Subject, WorkerHandle,
    WorkerSink,
};
use robert_base::fsio;
use robert_base::limits;
use robert_clip as clip;
use robert_clip::Command;
use robert_rollout::shipped;

/// The painter ends after this time without work.
const REST: Duration = Duration::from_secs(45);

/// Bytes of pictures kept in memory.
const KEPT_BYTES: usize = 12 << 20;

/// Pictures that may wait.
const WAITING: usize = 128;

/// Pixels along an edge, at least.
const SMALLEST_PX: u32 = 16;

/// What an example's picture shows besides the robot.
const CARD_OVERLAY: &str = "ghost,error,trail";

/// Size of an example's picture, pixels.
const CARD_PX: (u32, u32) = (480, 300);

/// Size of a pose's picture, pixels.
const POSE_PX: (u32, u32) = (152, 114);

/// Part of the names of kept files: increased when pictures of the same content look different.
const LOOK: u32 = 2;

/// The painter, and what it has painted.
#[derive(Debug)]
pub(crate) struct Pictures {
    painter: WorkerHandle,
    kept: Mutex<Kept>,
    waiting: AtomicUsize,
    dir: PathBuf,
}

/// The content of a still.
#[derive(Clone, Debug)]
pub(crate) struct Shown {
    /// The solid robot.
    pub(crate) achieved: bool,
    /// The translucent command, coloured by error.
    pub(crate) command: bool,
    /// The keys around the frame.
    pub(crate) ghosts: bool,
    /// Instead of the reached motion: a pose that is not a key yet.
    pub(crate) pose: Option<Vec<f32>>,
}

impl Default for Shown {
    fn default() -> Self {
        Shown { achieved: true, command: true, ghosts: false, pose: None }
    }
}

impl Shown {
    /// The overlays that the painter draws. In the still viewport the page itself shows captions,
    /// so they are left out.
    fn overlay(&self, draft: bool) -> String {
        let words = [
            (!(self.achieved || self.pose.is_some()), "bare"),
            (self.command, "ghost,error"),
            (self.ghosts, "onion"),
            (self.achieved, "trail"),
            (!draft, "caption"),
        ];
        let words: Vec<&str> = words.iter().filter(|w| w.0).map(|w| w.1).collect();
        if words.is_empty() { "none".to_owned() } else { words.join(",") }
    }
}

/// The newest last.
#[derive(Debug, Default)]
struct Kept {
    list: VecDeque<(String, Bytes)>,
    bytes: usize,
}

/// Ignores the painter's events; a question gets its own answer.
struct NullSink;

impl WorkerSink for NullSink {
    fn event(&self, _event: SimulationEvent) {}
    fn state(&self, state: &WorkerState) {
        tracing::debug!("the painter: {state:?}");
    }
}

impl Pictures {
    /// Makes the handle. The painter starts at the first request.
    ///
    /// # Errors
    /// If the operating system cannot start the thread.
    pub(crate) fn new(binary: PathBuf, state_dir: &Path) -> std::io::Result<Pictures> {
        Ok(Pictures {
            painter: WorkerHandle::start_resting(binary, Arc::new(NullSink), REST)?,
            kept: Mutex::default(),
            waiting: AtomicUsize::new(0),
            dir: state_dir.join("pictures"),
        })
    }

    /// The painter ends with the studio.
    pub(crate) fn shutdown(&self) {
        self.painter.shutdown();
    }

    fn known(&self, name: &str) -> Option<Bytes> {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.list.iter().find(|(n, _)| n == name).map(|(_, b)| b.clone())
    }

    fn keep(&self, name: String, jpeg: &Bytes) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.bytes += jpeg.len();
        kept.list.push_back((name, jpeg.clone()));
        while kept.bytes > KEPT_BYTES {
            let Some((_, old)) = kept.list.pop_front() else { break };
            kept.bytes -= old.len();
        }
    }

    async fn paint(
        &self,
        name: String,
        picture: PaintRequest,
    ) -> Result<(Bytes, Option<MeanError>), Error> {
        let size = (picture.width, picture.height);
        let Picture { jpeg, error } = self.ask(picture, size).await?;
        let jpeg = Bytes::from(jpeg);
        self.keep(name, &jpeg);
        Ok((jpeg, error))
    }

    /// Asks the painter for a picture of this size.
    async fn ask<Q: Question>(&self, question: Q, size: (u32, u32)) -> Result<Q::Answer, Error> {
        check_size(size)?;
        if self.waiting.fetch_add(1, Ordering::SeqCst) >= WAITING {
            self.waiting.fetch_sub(1, Ordering::SeqCst);
            return Err(Error::Full { what: "pictures at once", cap: WAITING });
        }
        let waiting = Waiting(&self.waiting);
        let answer = self.painter.ask(question).await;
        drop(waiting);
        answer
    }

    /// The body that the still of a frame shows at a point (0 to 1 from its top left corner).
    ///
    /// # Errors
    /// [`Error::NoDocument`].
    pub(crate) async fn body_at(
        &self,
        rollout: &RolloutStore,
        frame: usize,
        size: (u32, u32),
        at: (f32, f32),
    ) -> Result<Option<String>, Error> {
        let picture = still(rollout, frame, size, true, &Shown::default())?.1;
        let at = [2.0 * at.0 - 1.0, 1.0 - 2.0 * at.1];
        self.ask(PickRequest { picture, at }, size).await
    }

    /// The robot at a frame of the live rollout; beyond what is simulated, the command.
    ///
    /// # Errors
    /// [`Error::NoDocument`], [`Error::Simulation`] with what to install where there is no
    /// graphics driver.
    pub(crate) async fn still(
        &self,
        rollout: &RolloutStore,
        frame: usize,
        size: (u32, u32),
        draft: bool,
        shown: &Shown,
    ) -> Result<Bytes, Error> {
        let (name, picture) = still(rollout, frame, size, draft, shown)?;
        match self.known(&name) {
            Some(known) => Ok(known),
            None => Ok(self.paint(name, picture).await?.0),
        }
    }

    /// A pose of a robot.
    ///
    /// # Errors
    /// As [`Pictures::still`].
    pub(crate) async fn pose(&self, robot: String, q: Vec<f64>) -> Result<Bytes, Error> {
        let (width, height) = POSE_PX;
        let bits: Vec<u8> = q.iter().flat_map(|v| v.to_le_bytes()).collect();
        let name = format!("pose {robot} {}", fsio::sha256_hex(&bits));
        if let Some(known) = self.known(&name) {
            return Ok(known);
        }
        let (subject, overlay) = (Subject::Pose(q), "none".to_owned());
        let draft = false;
        let ask = PaintRequest { robot, subject, frame: 0, width, height, overlay, draft };
        Ok(self.paint(name, ask).await?.0)
    }

    /// The picture of an example that is performed first.
    ///
    /// # Errors
    /// As [`Pictures::still`], [`Error::NotFound`].
    pub(crate) async fn example(&self, id: &str) -> Result<Bytes, Error> {
        let clip = gallery::open(id)?;
        let name = example_name(&clip);
        if let Some(known) = self.known(&name) {
            return Ok(known);
        }
        if let Ok(bytes) = fsio::read_capped(&self.dir.join(&name), 4 << 20) {
            let jpeg = Bytes::from(bytes);
            self.keep(name, &jpeg);
            return Ok(jpeg);
        }
        Ok(self.perform(&clip, name).await?.0)
    }

    /// The mean error of an example's performance; `None` if nothing is commanded.
    ///
    /// # Errors
    /// As [`Pictures::example`].
    pub(crate) async fn example_error(&self, id: &str) -> Result<Option<MeanError>, Error> {
        let clip = gallery::open(id)?;
        let name = example_name(&clip);
        let noted = fsio::read_capped(&self.dir.join(noted(&name)), 64).ok();
        if let Some(error) = noted.and_then(|text| serde_json::from_slice(&text).ok()) {
            return Ok(error);
        }
        Ok(self.perform(&clip, name).await?.1)
    }

    async fn perform(
        &self,
        clip: &clip::Clip,
        name: String,
    ) -> Result<(Bytes, Option<MeanError>), Error> {
        let (path, note) = (self.dir.join(&name), self.dir.join(noted(&name)));
        let command = clip::compile(clip).map_err(|e| Error::request(e.to_string()))?;
        let (width, height) = CARD_PX;
        let picture = PaintRequest {
            robot: clip.robot.id.clone(),
            frame: telling(clip, &command),
            subject: Subject::Clip {
                name: clip.name.clone(),
                command: Dense::of(&command),
                keys: clip.keys.iter().map(|k| k.frame as usize).collect(),
            },
            width,
            height,
            overlay: CARD_OVERLAY.to_owned(),
            draft: false,
        };
        let (jpeg, error) = self.paint(name, picture).await?;
        let (kept, text) = (jpeg.clone(), serde_json::json!(error).to_string());
        // A picture that cannot be kept is drawn again next time. A client that gets the picture
        // asks for its error next, which must be stored by then.
        let noted = tokio::task::spawn_blocking(move || {
            fsio::write_atomic(&note, text.as_bytes()).ok();
            fsio::write_atomic(&path, &kept).ok();
        });
        noted.await.ok();
        Ok((jpeg, error))
    }
}

/// The name of an example's picture; it changes with the model.
fn example_name(clip: &clip::Clip) -> String {
    let models = shipped::all().unwrap_or_default();
    let of_robot = models.iter().filter(|m| m.robot == clip.robot.id);
    let models: Vec<String> =
        of_robot.map(|m| format!("{} {} {}", m.name, m.bytes, m.card.training.step)).collect();
    let seed = format!("{LOOK} {} {models:?} {}", env!("CARGO_PKG_VERSION"), clip.to_text());
    format!("example-{}.jpg", fsio::sha256_hex(seed.as_bytes()))
}

/// The name of the file with the error beside a picture, as JSON.
fn noted(name: &str) -> String {
    format!("{name}.json")
}

/// The name of a still, and the request for the painter.
fn still(
    rollout: &RolloutStore,
    frame: usize,
    (width, height): (u32, u32),
    draft: bool,
    shown: &Shown,
) -> Result<(String, PaintRequest), Error> {
    let (mut stamp, robot, mut motion) = rollout.motion(frame).ok_or(Error::NoDocument)?;
    if let (Some(q), Some(row)) = (&shown.pose, motion.achieved.get_mut(frame)) {
        if q.len() != row.len() {
            let (got, joints) = (q.len(), row.len());
            return Err(Error::request(format!("{got} values for the {joints} joints")));
        }
        row.clone_from(q);
        // Another motion: the painter distinguishes motions by their stamps.
        let bits: Vec<u8> = q.iter().flat_map(|v| v.to_le_bytes()).collect();
        let hash = fsio::sha256_hex(&[&bits[..], &stamp.to_le_bytes()].concat());
        let short = hash.get(..16).unwrap_or_default();
        stamp = u64::from_str_radix(short, 16).unwrap_or_default();
    }
    let overlay = shown.overlay(draft);
    let name = format!("still {robot} {stamp} {frame} {width}x{height} {draft} {overlay}");
    let subject = Subject::Motion { stamp, motion: Box::new(motion) };
    Ok((name, PaintRequest { robot, subject, frame, width, height, overlay, draft }))
}

/// The frame that represents a clip: the one whose command is farthest from the start.
fn telling(clip: &clip::Clip, command: &Command) -> usize {
    let start = command.start();
    let far = |frame: u32| -> f64 {
        let row = command.interpolated(frame);
        row.iter().zip(start).map(|(a, b)| f64::from((a - b).abs())).sum()
    };
    clip.keys
        .iter()
        .map(|k| k.frame.min(clip.length.saturating_sub(1)))
        .max_by(|a, b| far(*a).total_cmp(&far(*b)))
        .map_or(0, |f| f as usize)
}

struct Waiting<'a>(&'a AtomicUsize);

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Refuses a picture that nobody could see or that would take too long.
fn check_size((width, height): (u32, u32)) -> Result<(), Error> {
    let sane = SMALLEST_PX..=limits::STILL_PX;
    if sane.contains(&width) && sane.contains(&height) {
        return Ok(());
    }
    Err(Error::request(format!(
        "a picture of {width}x{height} px; edges go from {SMALLEST_PX} to {}",
        limits::STILL_PX
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_have_a_smallest_and_a_largest_edge() {
        let (least, most) = (SMALLEST_PX, limits::STILL_PX);
        assert!(check_size((least, most)).is_ok() && check_size((most, least)).is_ok());
        for bad in [(least - 1, most), (least, most + 1), (most + 1, least), (0, 0)] {
            assert!(check_size(bad).is_err(), "{bad:?}");
        }
    }
}
