//! Rule: masks hide no key, and keys cut no hold short.

use crate::lint::finder::{Finder, some_of};
use crate::lint::finding::{Fix, Level, Lint, Rule};
use crate::op::{KeysHold, MaskSet, Op};

impl Finder<'_> {
    pub(in crate::lint) fn hidden(&mut self) {
        for i in 0..self.clip.keys.len() {
            let lints = [self.masked(i), self.cut_short(i)];
            lints.into_iter().flatten().for_each(|lint| self.push(lint));
        }
    }

    /// The joints that key `i` has a value for, and the first frame at which each is no longer held.
    fn holds(&self, i: usize) -> impl Iterator<Item = (usize, u32)> + '_ {
        let (clip, tracks) = (self.clip, self.command.tracks());
        let row = self.command.key_row(i).or_else(|| clip.row(clip.keys.get(i)?));
        let own = row.into_iter().flatten().enumerate().filter(|(_, value)| value.is_some());
        own.map(move |(j, _)| (j, tracks.hold_end(clip, i, j)))
    }

    /// The finding that no value of key `i` is seen.
    fn masked(&self, i: usize) -> Option<Lint> {
        let key = self.clip.keys.get(i)?;
        let sees = |(j, end): (usize, u32)| (key.frame..end).any(|t| self.command.sees(t, j));
        if self.holds(i).any(sees) {
            return None;
        }
        let end = self.clip.hold_end(i);
        let set = MaskSet { from: key.frame, to: end, joints: None, masked: false };
        Some(Lint {
            level: Level::Info,
            rule: Rule::Hidden,
            message: format!("the key at frame {} is hidden by a mask", key.frame),
            frames: Some([key.frame, end]),
            joints: Vec::new(),
            pointer: format!("/keys/{i}"),
            fixes: vec![Fix { title: "Unmask the key".to_owned(), op: Op::MaskSet(set) }],
            settled: None,
            unlisted: 0,
        })
    }

    /// The finding that the hold of key `i` ends early, for all of its joints or for some.
    fn cut_short(&self, i: usize) -> Option<Lint> {
        let (clip, key) = (self.clip, self.clip.keys.get(i)?);
        // Nearly every key is of one frame.
        if key.hold <= 1 {
            return None;
        }
        let ends: Vec<(usize, u32)> = self.holds(i).collect();
        let is_cut = |end: u32| end - key.frame < key.hold;
        let first = ends.iter().map(|e| e.1).min().filter(|end| is_cut(*end))?;
        let last = ends.iter().map(|e| e.1).max()?;
        let cut = ends.iter().filter(|(_, end)| *end == first);
        let joints: Vec<String> = cut.map(|(j, _)| clip.robot.joints[*j].clone()).collect();
        let (hold, frame) = (key.hold, key.frame);
        let at = |end: u32| match clip.key(end) {
            Some(_) => format!("at the key at frame {end}"),
            None => "at the end of the clip".to_owned(),
        };
        let (message, joints, fixes) = if is_cut(last) {
            let held = last - frame;
            let op = Op::KeysHold(KeysHold { frames: vec![frame], hold: held });
            let fix = Fix { title: format!("Hold {held} frames"), op };
            let message = format!(
                "the hold of {hold} frames at frame {frame} ends after {held}, {}",
                at(last)
            );
            (message, Vec::new(), vec![fix])
        } else {
            let message = format!(
                "the hold of {hold} frames at frame {frame} ends earlier for {}, {}",
                some_of(&joints),
                at(first)
            );
            (message, joints, Vec::new())
        };
        Some(Lint {
            level: Level::Info,
            rule: Rule::Hidden,
            message,
            frames: Some([frame, if is_cut(last) { last } else { first }]),
            joints,
            pointer: format!("/keys/{i}/hold"),
            fixes,
            settled: None,
            unlisted: 0,
        })
    }
}
