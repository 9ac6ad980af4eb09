//! The compiled clip: one row per frame, and which of its values the policy may see.
//!
//! A command has one row per frame. The window of a rollout moves by one frame at a time, and
//! suites that are extracted from recorded data never were clips; both need rows instead of keys.

use super::document::Row;
use super::reach::Reached;
use super::tracks::Tracks;
use robert_base::units::FPS;

/// Frames that the policy sees ahead of the current one (paper, appendix A.1).
pub const LOOKAHEAD_FRAMES: u32 = 20;

const NEVER: u32 = u32::MAX;

/// Whether a frame has goals for all joints, for some, or for none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Sight {
    /// No joint.
    Masked,
    /// Some joints.
    Partial,
    /// Every joint.
    Full,
}

/// The origin of the values of a run of frames: of those of a key that is held, otherwise of the joint with the
/// strongest fill.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[derive(schemars::JsonSchema)]
pub enum SpanKind {
    /// A key and its hold.
    Key,
    /// A straight line between keys.
    Linear,
    /// A cubic between keys.
    Cubic,
    /// A key's value kept to the joint's next key.
    Hold,
    /// No goal, because nothing fills it.
    Open,
    /// No goal (for all joints), because a mask span hides it.
    Masked,
}

/// A run of frames of one kind: `[from, to)`. The spans of a command tile the clip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, schemars::JsonSchema)]
pub struct Span {
    /// First frame.
    pub from: u32,
    /// Frame after the last.
    pub to: u32,
    /// Its kind.
    pub kind: SpanKind,
}

/// A run of steps at which the policy sees no goal. Commands `after` and `before` are visible (or
/// are the ends of the clip), and none between them is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, schemars::JsonSchema)]
pub struct Blind {
    /// Last visible frame before; `None` at the start of the clip.
    pub after: Option<u32>,
    /// First visible frame after; `None` when the clip ends masked.
    pub before: Option<u32>,
    /// First blind step.
    pub from: u32,
    /// Step after the last blind one.
    pub to: u32,
}

/// A goal that the program adds because the window would contain none.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualKey {
    /// The frame of this goal: the last one of the window, index 50 of 51.
    pub frame: u32,
    /// Its value, in joint order.
    pub q: Vec<f32>,
}

/// Commanded joint positions and their masks.
///
/// ```
/// use robert_clip::{Clip, Key, RobotRef, compile};
///
/// let joints = vec!["x".to_owned(), "y".to_owned()];
/// let robot = RobotRef { id: "pointmass".to_owned(), joints, ..RobotRef::default() };
/// let mut clip = Clip::new(robot, 21);
/// clip.keys = vec![Key::new(20, &[0.3, -0.1])];
/// let command = compile(&clip)?;
/// assert_eq!(command.dim(), 2);
/// assert_eq!(command.filled().len(), command.frames() as usize * command.dim());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Command {
    joints: Vec<String>,
    frames: u32,
    q: Vec<f32>,              // (frames, dim)
    start: Vec<f32>,          // (dim)
    sight: Vec<Sight>,        // (frames)
    cells: Option<Vec<bool>>, // (frames, dim), only when some frame is partial
    next: Vec<u32>,           // (frames) first frame >= t with any goal
    prev: Vec<u32>,           // (frames) last frame <= t with any goal
    spans: Vec<Span>,
    reached: Vec<Reached>,
    keys: Vec<Option<Row>>, // of the clip's keys: values that end-effector goals led to
    tracks: Tracks,
}

impl Command {
    /// A command from dense rows.
    ///
    /// `q` is (frames, dim), `visible` likewise; `start` (dim) is held through the pre-roll.
    /// Masked values are set to 0, so that they cannot leak. `None` when the lengths
    /// disagree.
    pub fn from_dense(
        joints: Vec<String>,
        start: Vec<f32>,
        q: Vec<f32>,
        visible: Vec<bool>,
    ) -> Option<Command> {
        let dim = joints.len();
        if dim == 0
            || start.len() != dim
            || q.len() != visible.len()
            || !q.len().is_multiple_of(dim)
        {
            return None;
        }
        Some(Self::assemble(joints, start, q, visible))
    }

    /// As [`Command::from_dense`], for lengths that are known to agree.
    pub(super) fn assemble(
        joints: Vec<String>,
        start: Vec<f32>,
        mut q: Vec<f32>,
        visible: Vec<bool>,
    ) -> Command {
        let dim = joints.len().max(1);
        for (v, seen) in q.iter_mut().zip(&visible) {
            if !seen {
                *v = 0.0;
            }
        }
        let sight: Vec<Sight> = visible
            .chunks_exact(dim)
            .map(|row| match row.iter().filter(|v| **v).count() {
                0 => Sight::Masked,
                n if n == dim => Sight::Full,
                _ => Sight::Partial,
            })
            .collect();
        let frames = sight.len() as u32;
        let seen = |s: &Sight| *s != Sight::Masked;
        let next = scan(sight.iter().map(seen).enumerate().rev());
        let prev = scan(sight.iter().map(seen).enumerate());
        let cells = sight.contains(&Sight::Partial).then_some(visible);
        let mut spans: Vec<Span> = Vec::new();
        for (t, s) in (0..).zip(&sight) {
            let kind = if seen(s) { SpanKind::Key } else { SpanKind::Open };
            push_span(&mut spans, t, t + 1, kind);
        }
        Command {
            joints,
            frames,
            q,
            start,
            sight,
            cells,
            next,
            prev,
            spans,
            reached: Vec::new(),
            keys: Vec::new(),
            tracks: Tracks::default(),
        }
    }

    /// Joint names, the order of every row.
    pub fn joints(&self) -> &[String] {
        &self.joints
    }

    /// Joints.
    pub fn dim(&self) -> usize {
        self.joints.len()
    }

    /// Frames: 0..frames.
    pub fn frames(&self) -> u32 {
        self.frames
    }

    /// All values, (frames, dim); 0 where masked.
    pub fn q(&self) -> &[f32] {
        &self.q
    }

    /// The state before frame 0, (dim).
    pub fn start(&self) -> &[f32] {
        &self.start
    }

    /// The goals of each frame, (dim); NaN where there is none.
    pub fn goal_rows(&self) -> impl Iterator<Item = Vec<f32>> {
        (0..self.frames).map(|f| {
            let row = self.row(f).iter().enumerate();
            row.map(|(j, v)| if self.sees(f, j) { *v } else { f32::NAN }).collect()
        })
    }

    /// The row of a frame, (dim); empty beyond the end.
    pub fn row(&self, frame: u32) -> &[f32] {
        let at = frame as usize * self.dim();
        self.q.get(at..at + self.dim()).unwrap_or_default()
    }

    /// Whether this frame has goals for all joints, for some, or for none. Beyond the end the last
    /// command is held; see [`Command::held_end`].
    pub fn sight(&self, frame: u32) -> Sight {
        self.sight.get(frame as usize).copied().unwrap_or(Sight::Masked)
    }

    /// Whether this joint has a goal at this frame.
    pub fn sees(&self, frame: u32, joint: usize) -> bool {
        match self.sight(frame) {
            Sight::Masked => false,
            Sight::Full => joint < self.dim(),
            Sight::Partial => self
                .cells
                .as_ref()
                .and_then(|c| c.get(frame as usize * self.dim() + joint))
                .is_some_and(|v| *v),
        }
    }

    /// Whether some frame has goals for some joints only.
    pub fn is_partial(&self) -> bool {
        self.cells.is_some()
    }

    /// First frame >= `frame` with a goal.
    pub fn next_visible(&self, frame: u32) -> Option<u32> {
        self.next.get(frame as usize).copied().filter(|&f| f != NEVER)
    }

    /// Last frame <= `frame` with a goal; `frame` may be beyond the end.
    pub fn prev_visible(&self, frame: u32) -> Option<u32> {
        let frame = frame.min(self.frames.checked_sub(1)?);
        self.prev.get(frame as usize).copied().filter(|&f| f != NEVER)
    }

    /// Frames with a goal for every joint.
    pub fn full_frames(&self) -> u32 {
        self.sight.iter().filter(|s| **s == Sight::Full).count() as u32
    }

    /// The command beyond the end: per joint its last goal, else its start value. (dim)
    pub fn held_end(&self) -> Vec<f32> {
        self.held_at(self.frames.saturating_sub(1))
    }

    /// Per joint the last goal at or before this frame, else the start value. (dim)
    pub fn held_at(&self, frame: u32) -> Vec<f32> {
        self.start
            .iter()
            .enumerate()
            .map(|(j, start)| self.last_goal(frame, j).map_or(*start, |(_, v)| v))
            .collect()
    }

    /// The last goal of a joint at or before a frame: frame and value.
    pub fn last_goal(&self, frame: u32, joint: usize) -> Option<(u32, f32)> {
        let mut at = self.prev_visible(frame)?;
        while !self.sees(at, joint) {
            at = self.prev_visible(at.checked_sub(1)?)?;
        }
        self.row(at).get(joint).map(|v| (at, *v))
    }

    /// The next goal of a joint at or after a frame: frame and value.
    pub fn next_goal(&self, frame: u32, joint: usize) -> Option<(u32, f32)> {
        let mut at = self.next_visible(frame)?;
        while !self.sees(at, joint) {
            at = self.next_visible(at + 1)?;
        }
        self.row(at).get(joint).map(|v| (at, *v))
    }

    /// The straight line between the goals around a frame, (dim). The start pose counts as a goal
    /// at frame 0, where every rollout begins. After its last goal a joint is held.
    pub fn interpolated(&self, frame: u32) -> Vec<f32> {
        self.start
            .iter()
            .enumerate()
            .map(|(j, start)| {
                let before = self.last_goal(frame, j).unwrap_or((0, *start));
                between(before, self.next_goal(frame, j), frame)
            })
            .collect()
    }

    /// Every row of [`Command::interpolated`], in one pass; (frames, dim).
    pub fn filled(&self) -> Vec<f32> {
        let dim = self.dim();
        let mut q = self.q.clone();
        for (j, start) in self.start.iter().enumerate() {
            let mut before = (0, *start);
            let mut open = 0; // first frame that waits for the next goal
            for frame in 0..=self.frames {
                let goal = if frame == self.frames {
                    None
                } else if self.sees(frame, j) {
                    self.row(frame).get(j).map(|v| (frame, *v))
                } else {
                    continue;
                };
                for f in open..frame {
                    if let Some(slot) = q.get_mut(f as usize * dim + j) {
                        *slot = between(before, goal, f);
                    }
                }
                (before, open) = (goal.unwrap_or(before), frame + 1);
            }
        }
        q
    }

    /// The virtual key of step `step`, whose window contains commands `step+1..=step+20`. It exists
    /// only if none of them has a goal. Frames beyond the end are visible (the last command, held),
    /// so there is none near the end.
    ///
    /// Training keeps at least one frame of every window unmasked, so no policy has learned from a
    /// window without a goal. Therefore one frame at the far end of the window gets a goal, on the
    /// line from the last goal to the next.
    pub fn virtual_key(&self, step: u32) -> Option<VirtualKey> {
        let frame = step.checked_add(LOOKAHEAD_FRAMES)?;
        if frame >= self.frames {
            return None;
        }
        match self.next_visible(step + 1) {
            Some(next) if next <= frame => None,
            _ => Some(VirtualKey { frame, q: self.interpolated(frame) }),
        }
    }

    /// All runs of steps without a goal in sight.
    pub fn blind_spans(&self) -> Vec<Blind> {
        let mut blind = Vec::new();
        let mut after = None;
        let mut at = 0;
        loop {
            let before = self.next_visible(at);
            let (a, b) = (after.unwrap_or(0), before.unwrap_or(self.frames));
            if b.saturating_sub(a) > LOOKAHEAD_FRAMES {
                blind.push(Blind { after, before, from: a, to: b - LOOKAHEAD_FRAMES });
            }
            let Some(b) = before else { return blind };
            after = before;
            at = b + 1;
        }
    }

    pub(super) fn with_spans(self, spans: Vec<Span>) -> Command {
        Command { spans, ..self }
    }

    pub(super) fn with_solved(self, keys: Vec<Option<Row>>, reached: Vec<Reached>) -> Command {
        Command { reached, keys, ..self }
    }

    pub(super) fn with_tracks(self, tracks: Tracks) -> Command {
        Command { tracks, ..self }
    }

    /// For each key of the clip, the neighbouring keys of each joint; none if there was no clip.
    pub fn tracks(&self) -> &Tracks {
        &self.tracks
    }

    /// The joint values of the clip's key `index`, if end-effector goals decide over them.
    pub fn key_row(&self, index: usize) -> Option<&Row> {
        self.keys.get(index).and_then(Option::as_ref)
    }

    /// How closely the clip's end-effector goals are met: one entry for each goal of a key, and one
    /// for the worst frame of a path between keys that is not met.
    pub fn reached(&self) -> &[Reached] {
        &self.reached
    }

    /// The kinds of all frames, for the timeline; the spans tile 0..frames.
    pub fn spans(&self) -> &[Span] {
        &self.spans
    }

    /// First frame whose goal differs (in value, mask or existence); `Some(0)` if the start or the
    /// joints differ.
    pub fn first_changed_frame(&self, other: &Command) -> Option<u32> {
        if self.joints != other.joints || bits(&self.start).ne(bits(&other.start)) {
            return Some(0);
        }
        let dim = self.dim();
        let common = self.frames.min(other.frames);
        for t in 0..common {
            let same = self.sight(t) == other.sight(t)
                && bits(self.row(t)).eq(bits(other.row(t)))
                && (self.sight(t) != Sight::Partial
                    || (0..dim).all(|j| self.sees(t, j) == other.sees(t, j)));
            if !same {
                return Some(t);
            }
        }
        (self.frames != other.frames).then_some(common)
    }

    /// First step whose goals can differ when this command replaces `old`. It is 20 frames before
    /// the first changed frame, or the start of the blind span that ends there, because the virtual
    /// keys of that span depend on the changed goal.
    pub fn first_changed_step(&self, old: &Command) -> Option<u32> {
        let f = self.first_changed_frame(old)?;
        let usual = f.saturating_sub(LOOKAHEAD_FRAMES);
        let before = f.checked_sub(1).and_then(|t| self.prev_visible(t)).unwrap_or(0);
        let mut step = usual.min(before);
        if self.is_partial() || old.is_partial() {
            // A joint's line may begin at an earlier goal.
            for j in 0..self.dim() {
                let own = f.checked_sub(1).and_then(|t| self.last_goal(t, j)).map_or(0, |g| g.0);
                step = step.min(own);
            }
        }
        Some(step)
    }

    /// The same command in another joint order. `None` when a joint is missing.
    #[must_use]
    pub fn reordered(&self, joints: &[String]) -> Option<Command> {
        if joints == self.joints {
            return Some(self.clone());
        }
        let from: Vec<usize> = joints
            .iter()
            .map(|name| self.joints.iter().position(|j| j == name))
            .collect::<Option<_>>()?;
        let start = from.iter().filter_map(|&j| self.start.get(j).copied()).collect();
        let (mut q, mut visible) = (Vec::new(), Vec::new());
        for t in 0..self.frames {
            let row = self.row(t);
            q.extend(from.iter().filter_map(|&j| row.get(j).copied()));
            visible.extend(from.iter().map(|&j| self.sees(t, j)));
        }
        let tracks = self.tracks.reordered(&from);
        let command = Command::assemble(joints.to_vec(), start, q, visible);
        Some(command.with_spans(self.spans.clone()).with_tracks(tracks))
    }

    /// Length in seconds.
    pub fn secs(&self) -> f64 {
        f64::from(self.frames) / f64::from(FPS)
    }
}

/// The value at `frame` on the line from one goal to the next, both (frame, value). Without a next
/// goal the value is held.
fn between((a, from): (u32, f32), next: Option<(u32, f32)>, frame: u32) -> f32 {
    match next {
        Some((b, to)) if b > a && frame > a => {
            let s = f64::from(frame - a) / f64::from(b - a);
            (f64::from(from) + s * (f64::from(to) - f64::from(from))) as f32
        }
        _ => from,
    }
}

fn bits(row: &[f32]) -> impl Iterator<Item = u32> + '_ {
    row.iter().map(|v| v.to_bits())
}

/// For every frame the last visible one so far, in the order given.
fn scan(order: impl ExactSizeIterator<Item = (usize, bool)>) -> Vec<u32> {
    let mut found = vec![NEVER; order.len()];
    let mut last = NEVER;
    for (t, visible) in order {
        if visible {
            last = t as u32;
        }
        if let Some(slot) = found.get_mut(t) {
            *slot = last;
        }
    }
    found
}

/// Appends a span, joining it to an equal neighbour unless both are keys.
pub(super) fn push_span(spans: &mut Vec<Span>, from: u32, to: u32, kind: SpanKind) {
    if from >= to {
        return;
    }
    match spans.last_mut() {
        Some(last) if last.kind == kind && kind != SpanKind::Key && last.to == from => last.to = to,
        _ => spans.push(Span { from, to, kind }),
    }
}
