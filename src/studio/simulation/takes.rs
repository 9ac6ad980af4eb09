//! Takes: performed motion that is kept for comparison.
//!
//! A take never changes: it is the clip, the policy's settings and the resulting motion. Every
//! finished rollout of the document is a take; performing the same clip in the same way again adds
//! none. During editing, two takes of each policy are kept: the one before these edits, and the
//! current one. The last [`limits::TAKES`] are kept, and pinned ones until they are removed
//! (`take_files`), whatever clip is opened meanwhile. Takes are shown with clips of their robot.

use std::sync::Arc;

use crate::protocol::{Error, RolloutSettings, TakeCard, TakesView};
use robert_base::limits;
use robert_base::units::CTRL_DT;
use robert_clip::{Clip, Command};

/// The source of a take: clip, robot and settings.
#[derive(Clone, Debug)]
pub(crate) struct Source {
    /// The source from which its robot is loaded.
    pub(crate) robot: String,
    pub(crate) clip: Arc<Clip>,
    pub(crate) settings: RolloutSettings,
}

/// The reached motion.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    /// (frames, S).
    pub(crate) q: Vec<Vec<f32>>,
    /// By frame, rad or m; `None` where masked.
    pub(crate) error: Vec<Option<f64>>,
    /// Body transforms by frame; (nbody, 7).
    pub(crate) bodies: Vec<Arc<[f32]>>,
}

/// A take.
#[derive(Clone, Debug)]
pub(crate) struct Take {
    pub(crate) id: u64,
    pub(crate) name: String,
    pub(crate) source: Source,
    pub(crate) command: Arc<Command>,
    pub(crate) policy: String,
    pub(crate) rev: u64,
    pub(crate) mae: Option<f64>,
    pub(crate) motion: Arc<Motion>,
    pub(crate) pinned: bool,
    pub(crate) quality: Quality,
}

/// The figures of a take beside the mean error.
#[derive(Clone, Debug, Default)]
pub(crate) struct Quality {
    /// The joint with the largest mean absolute error over its goals, and that error, rad or m.
    pub(crate) worst: Option<(usize, f64)>,
    /// Root mean square of the third differences of the motion per step, over all joints,
    /// rad/s³ or m/s³. `None` for fewer than four frames.
    pub(crate) jerk: Option<f64>,
}

impl Quality {
    pub(super) fn of(command: &Command, q: &[Vec<f32>]) -> Quality {
        let mut worst: Option<(usize, f64)> = None;
        for joint in 0..command.joints().len() {
            let (mut sum, mut goals) = (0.0, 0_u32);
            for (frame, row) in (0..command.frames()).zip(q) {
                if command.sees(frame, joint) {
                    sum += f64::from((row[joint] - command.row(frame)[joint]).abs());
                    goals += 1;
                }
            }
            let mean = sum / f64::from(goals.max(1));
            if goals > 0 && worst.is_none_or(|(_, most)| mean > most) {
                worst = Some((joint, mean));
            }
        }
        let thirds = q.windows(4).flat_map(|w| {
            (0..w[0].len()).map(|j| {
                let at = |k: usize| f64::from(w[k][j]);
                at(3) - 3.0 * at(2) + 3.0 * at(1) - at(0)
            })
        });
        let (sum, count) = thirds.fold((0.0, 0_u32), |(s, n), d| (s + d * d, n + 1));
        let jerk = (count > 0).then(|| (sum / f64::from(count)).sqrt() / CTRL_DT.powi(3));
        Quality { worst, jerk }
    }
}

impl Take {
    pub(super) fn bytes(&self) -> usize {
        let q: usize = self.motion.q.iter().map(|row| 4 * row.len() + 24).sum();
        let bodies: usize = self.motion.bodies.iter().map(|row| 4 * row.len() + 16).sum();
        q + bodies + 16 * self.motion.error.len()
    }

    /// Whether another take is the same performance.
    fn is(&self, other: &Take) -> bool {
        let performed = |t: &Take| RolloutSettings { auto: true, ..t.source.settings.clone() };
        self.source.robot == other.source.robot
            && performed(self) == performed(other)
            && self.command == other.command
            && self.motion.q == other.motion.q
    }

    /// Whether this take is of the same document and performed in the same way, before an edit.
    fn precedes(&self, other: &Take) -> bool {
        let performed = |t: &Take| RolloutSettings { auto: true, ..t.source.settings.clone() };
        self.source.robot == other.source.robot
            && self.source.clip.name == other.source.clip.name
            && performed(self) == performed(other)
            && self.rev < other.rev
            && self.command != other.command
    }
}

/// Takes of all robots, the oldest first.
#[derive(Debug, Default)]
pub(crate) struct Takes {
    kept: Vec<Take>,
    compared: Vec<u64>,
    last: u64,
}

impl Takes {
    /// Begins with the takes that were kept on disk, the oldest first.
    pub(super) fn of(kept: Vec<Take>) -> Takes {
        let last = kept.iter().map(|t| t.id).max().unwrap_or(0);
        Takes { kept, last, compared: Vec::new() }
    }

    /// The pinned takes, the oldest first.
    pub(super) fn pinned(&self) -> Vec<Take> {
        self.kept.iter().filter(|t| t.pinned).cloned().collect()
    }

    /// Keeps a take and returns its number; the same take again moves to the front.
    pub(crate) fn keep(&mut self, mut take: Take) -> u64 {
        if let Some(at) = self.kept.iter().position(|t| t.is(&take)) {
            let mut known = self.kept.remove(at);
            // The title and the version may have changed since; the motion has not.
            (known.source.clip, known.rev) = (take.source.clip, take.rev);
            let id = known.id;
            self.kept.push(known);
            return id;
        }
        take.quality = Quality::of(&take.command, &take.motion.q);
        let passing = |t: &Take| !t.pinned && !self.compared.contains(&t.id) && t.precedes(&take);
        let mut before = (0..self.kept.len()).rev().filter(|i| passing(&self.kept[*i]));
        let (newest, older) = (before.next(), before.next());
        if let (Some(at), Some(_)) = (newest, older) {
            let passed = self.kept.remove(at);
            (take.id, take.name) = (passed.id, passed.name);
        } else {
            self.last += 1;
            take.id = self.last;
            take.name = format!("take {}", self.last);
        }
        let id = take.id;
        self.kept.push(take);
        loop {
            let bytes: usize = self.kept.iter().map(Take::bytes).sum();
            if self.kept.len() <= limits::TAKES && bytes <= limits::TAKES_BYTES {
                break;
            }
            let shown = |t: &Take| t.pinned || self.compared.contains(&t.id);
            let Some(at) = self.kept.iter().position(|t| !shown(t)) else { break };
            self.kept.remove(at);
        }
        id
    }

    /// The takes that a client of this robot sees; `now` is the command that is performed.
    pub(crate) fn view(&self, robot: Option<&str>, now: Option<&Command>) -> TakesView {
        let mine = || self.kept.iter().filter(|t| robot == Some(t.source.robot.as_str()));
        let card = |t: &Take| TakeCard {
            id: t.id,
            name: t.name.clone(),
            clip: t.source.clip.name.clone(),
            rev: t.rev,
            policy: t.policy.clone(),
            seed: t.source.settings.seed,
            mae: t.mae,
            frames: t.motion.q.len(),
            worst_joint: t.quality.worst.map(|(j, _)| t.command.joints()[j].clone()),
            worst: t.quality.worst.map(|(_, error)| error),
            jerk: t.quality.jerk,
            pinned: t.pinned,
            same_goals: now == Some(t.command.as_ref()),
        };
        let compared = self.compared.iter().copied().filter(|id| mine().any(|t| t.id == *id));
        TakesView {
            takes: mine().rev().map(card).collect(),
            compared: compared.collect(),
            skipped: Vec::new(),
        }
    }

    pub(crate) fn get(&self, id: u64) -> Option<&Take> {
        self.kept.iter().find(|t| t.id == id)
    }

    /// The take that is compared in the viewport, if it is of this robot.
    pub(crate) fn beside(&self, robot: &str) -> Option<&Take> {
        let of = |id: &u64| self.get(*id).filter(|t| t.source.robot == robot);
        self.compared.iter().rev().find_map(of)
    }

    fn take(&mut self, id: u64) -> Result<&mut Take, Error> {
        let missing = || Error::NotFound { what: format!("take {id}") };
        self.kept.iter_mut().find(|t| t.id == id).ok_or_else(missing)
    }

    /// Keeps it for good, or no longer.
    pub(crate) fn pin(&mut self, id: u64, pinned: bool) -> Result<(), Error> {
        let others = self.kept.iter().filter(|t| t.pinned && t.id != id).count();
        // One place stays free for the current motion.
        if pinned && others + 1 >= limits::TAKES {
            return Err(Error::Full { what: "pinned takes", cap: limits::TAKES - 1 });
        }
        let stays = |t: &&Take| t.pinned || t.id == id;
        let bytes: usize = self.kept.iter().filter(stays).map(Take::bytes).sum();
        if pinned && bytes > limits::TAKES_PINNED_BYTES {
            let cap = limits::TAKES_PINNED_BYTES;
            return Err(Error::Full { what: "bytes of pinned takes", cap });
        }
        self.take(id)?.pinned = pinned;
        Ok(())
    }

    /// Names a take and pins it, since a person who names a take wants to keep it.
    pub(crate) fn name(&mut self, id: u64, name: &str) -> Result<(), Error> {
        let name = name.trim();
        if name.is_empty() || name.len() > limits::NAME_BYTES || name.contains(char::is_control) {
            return Err(Error::request("a name has 1 to 256 bytes and no control characters"));
        }
        self.take(id)?;
        self.pin(id, true)?;
        name.clone_into(&mut self.take(id)?.name);
        Ok(())
    }

    /// Draws these takes beside the current motion.
    pub(crate) fn compare(&mut self, ids: &[u64]) -> Result<(), Error> {
        if ids.len() > limits::TAKES_COMPARED {
            return Err(Error::Full { what: "takes drawn at once", cap: limits::TAKES_COMPARED });
        }
        for id in ids {
            self.take(*id)?;
        }
        self.compared = ids.to_vec();
        Ok(())
    }

    /// Forgets it.
    pub(crate) fn remove(&mut self, id: u64) -> Result<(), Error> {
        self.take(id)?;
        self.kept.retain(|t| t.id != id);
        self.compared.retain(|c| *c != id);
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use robert_clip::{Key, RobotRef, compile};

    /// Ten frames of one joint.
    pub(in super::super) fn take(value: f32, bodies: usize) -> Take {
        let joints = vec!["a".to_owned()];
        let mut clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 10);
        clip.keys.push(Key::new(0, &[0.0]));
        let command = Arc::new(compile(&clip).unwrap());
        let settings = RolloutSettings::default();
        Take {
            id: 0,
            name: String::new(),
            source: Source { robot: "r".into(), clip: Arc::new(clip), settings },
            command,
            policy: "pd".into(),
            rev: 1,
            mae: Some(0.1),
            motion: Arc::new(Motion {
                q: vec![vec![value]; 10],
                error: vec![None; 10],
                bodies: vec![vec![0.0; bodies].into(); 10],
            }),
            pinned: false,
            quality: Quality::default(),
        }
    }

    /// As another edit leaves it.
    fn edited(rev: u64, goal: f64) -> Take {
        let mut made = take(rev as f32, 7);
        let mut clip = made.source.clip.as_ref().clone();
        clip.keys = vec![Key::new(0, &[goal])];
        made.command = Arc::new(compile(&clip).unwrap());
        (made.source.clip, made.rev) = (Arc::new(clip), rev);
        made
    }

    #[test]
    fn editing_keeps_what_was_before_and_what_is_now() {
        let mut takes = Takes::default();
        for rev in 1..30 {
            takes.keep(edited(rev, 0.01 * rev as f64));
        }
        let revs = |takes: &Takes| takes.kept.iter().map(|t| t.rev).collect::<Vec<_>>();
        assert_eq!(revs(&takes), [1, 29], "before the edits, and now");
        let now = takes.kept[1].id;
        takes.pin(now, true).unwrap();
        for rev in 30..40 {
            takes.keep(edited(rev, 0.01 * rev as f64));
        }
        assert_eq!(revs(&takes), [1, 29, 39], "a pinned one is not passed over");
        let mut other = edited(40, 0.5);
        other.source.settings.seed = 7;
        takes.keep(other);
        assert_eq!(revs(&takes).len(), 4, "another performance is a take of its own");
    }

    #[test]
    fn the_worst_joint_and_the_jerk_are_those_of_the_motion() {
        let joints = vec!["a".to_owned(), "b".to_owned()];
        let mut clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 6);
        clip.keys.push(Key::new(0, &[0.0, 0.0]).held(2));
        let command = compile(&clip).unwrap();
        // b is off by .2 and .4 at its two goals; both move by t^3, whose third difference is 6.
        let q: Vec<Vec<f32>> =
            [0.0_f32, 1.0, 8.0, 27.0, 64.0, 125.0].iter().map(|v| vec![*v * 1e-3; 2]).collect();
        let mut off = q.clone();
        (off[0][1], off[1][1]) = (0.2, 0.4);
        let (joint, error) = Quality::of(&command, &off).worst.unwrap();
        assert!(joint == 1 && (error - 0.3).abs() < 1e-6, "{joint} {error}");
        let jerk = Quality::of(&command, &q).jerk.unwrap();
        assert!((jerk * CTRL_DT.powi(3) - 6e-3).abs() < 1e-7, "{jerk}");
        assert!(Quality::of(&command, &q[..3]).jerk.is_none());
    }

    #[test]
    fn the_same_performance_is_one_take_and_the_pinned_outlive_the_rest() {
        let mut takes = Takes::default();
        let first = takes.keep(take(0.0, 7));
        takes.name(first, " before ").unwrap();
        assert_eq!(takes.keep(take(0.0, 7)), first);
        for n in 1..100 {
            takes.keep(take(n as f32, 7));
        }
        let view = takes.view(Some("r"), Some(&take(0.0, 7).command));
        assert_eq!(view.takes.len(), limits::TAKES);
        assert_eq!(view.takes[0].id, 100, "the newest first");
        let kept = view.takes.last().unwrap();
        assert!(kept.pinned && kept.same_goals && kept.name == "before" && kept.id == first);
        assert!(takes.view(Some("other"), None).takes.is_empty());
    }

    #[test]
    fn as_many_takes_are_pinned_and_compared_as_the_limits_say() {
        let mut takes = Takes::default();
        let ids: Vec<u64> = (0..limits::TAKES).map(|n| takes.keep(take(n as f32, 7))).collect();
        let (last, pinned) = ids.split_last().unwrap();
        for id in pinned {
            takes.pin(*id, true).unwrap();
        }
        assert!(matches!(takes.pin(*last, true), Err(Error::Full { what: "pinned takes", .. })));
        takes.compare(&ids[..limits::TAKES_COMPARED]).unwrap();
        let more = takes.compare(&ids[..=limits::TAKES_COMPARED]);
        assert!(matches!(more, Err(Error::Full { cap: limits::TAKES_COMPARED, .. })));
    }

    #[test]
    fn memory_is_bounded_and_names_are_checked() {
        let mut takes = Takes::default();
        let rows = limits::TAKES_BYTES / 4 / 10 / 3;
        for n in 0..5 {
            takes.keep(take(n as f32, rows));
        }
        let view = takes.view(Some("r"), None);
        assert!((1..=3).contains(&view.takes.len()), "{}", view.takes.len());
        let id = view.takes[0].id;
        takes.pin(id, true).unwrap();
        let full = takes.pin(view.takes[1].id, true);
        assert!(
            matches!(full, Err(Error::Full { cap: limits::TAKES_PINNED_BYTES, .. })),
            "{full:?}"
        );
        for bad in ["", "  ", "a\nb", &"x".repeat(257)] {
            assert!(takes.name(id, bad).is_err(), "{bad:?}");
        }
        assert!(takes.compare(&[id, 999]).is_err());
        takes.compare(&[id]).unwrap();
        assert_eq!(takes.beside("r").map(|t| t.id), Some(id));
        takes.remove(id).unwrap();
        assert!(takes.beside("r").is_none() && takes.pin(id, true).is_err());
    }
}
