//! Parts of a clip, which a search improves one after another.
//!
//! Whatever moves a goal of a long clip may change every contact after it a little, and somewhere in the
//! rest of a minute an error grows. Judged by the whole clip, a way around an obstacle is then refused. A part
//! is judged by itself and the second before it, and the parts after it begin where it ends.

use std::ops::Range;

use super::goals::Goals;
use super::window::COMMAND;

/// The longest clip that is one part, in frames (20 s), and the longest part.
const WHOLE: usize = 400;
/// The shortest part, in frames (8 s).
const LEAST: usize = 160;

/// The parts of a clip: adjacent ranges of frames from 1 on. They end where the goals have rested longest,
/// or else at a frame with goals.
pub(super) fn parts(goals: &Goals) -> Vec<Range<usize>> {
    let (mut found, mut from) = (Vec::new(), 1);
    while goals.frames() > from + WHOLE {
        let last = (from + WHOLE).min(goals.frames() - LEAST);
        let quality = |&f: &usize| (goals.any_visible(f), rest(goals, from, f));
        let Some(end) = (from + LEAST..last).max_by_key(quality) else { break };
        found.push(from..end + 1);
        from = end + 1;
    }
    found.push(from..goals.frames());
    found
}

/// The frames whose errors count in a part: those, and the ones before them at which a policy sees their goals.
pub(super) fn counted(part: &Range<usize>) -> Range<usize> {
    part.start.saturating_sub(COMMAND).max(1)..part.end
}

/// The number of frames from `from` on and before `f` with the same goals as at `f`, of the joints that have one.
fn rest(goals: &Goals, from: usize, f: usize) -> usize {
    let same = |a: usize, b: usize| {
        (0..goals.dim()).all(|j| {
            let seen = goals.is_visible(a, j);
            seen == goals.is_visible(b, j) && (!seen || goals.row(a)[j] == goals.row(b)[j])
        })
    };
    (from..f).rev().take_while(|&before| same(f, before)).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_clip::Command;

    /// A joint that moves at the frames of `moves` and rests at all others.
    fn clip(frames: usize, moves: impl Fn(usize) -> bool) -> Goals {
        let mut at = 0.0;
        let mut value = |f: usize| {
            at += if moves(f) { 0.1 } else { 0.0 };
            at
        };
        let q = (0..frames).map(&mut value).collect();
        let seen = vec![true; frames];
        Goals::new(&Command::from_dense(vec!["a".into()], vec![0.0], q, seen).unwrap())
    }

    /// First and last frames.
    fn ends(goals: &Goals) -> Vec<(usize, usize)> {
        parts(goals).into_iter().map(|part| (part.start, part.end - 1)).collect()
    }

    #[test]
    fn a_clip_of_twenty_seconds_is_one_part() {
        assert_eq!(ends(&clip(401, |_| false)), [(1, 400)]);
        assert_eq!(ends(&clip(2, |_| false)), [(1, 1)]);
    }

    #[test]
    fn parts_end_with_the_longest_rest() {
        // It rests from 250 to 299 and from 500 to 519.
        let goals = clip(720, |f| !(251..300).contains(&f) && !(501..520).contains(&f));
        assert_eq!(ends(&goals), [(1, 299), (300, 519), (520, 719)]);
    }

    #[test]
    fn parts_join_and_are_neither_short_nor_long() {
        for frames in [401, 402, 561, 562, 800, 1201, 6000] {
            for goals in [clip(frames, |_| true), clip(frames, |f| f % 97 < 40)] {
                let found = parts(&goals);
                assert_eq!((found[0].start, found.last().unwrap().end), (1, frames));
                assert!(found.windows(2).all(|p| p[0].end == p[1].start));
                let few = found.len() == 1;
                assert!(found.iter().all(|p| (few || p.len() >= LEAST) && p.len() <= WHOLE + 1));
            }
        }
    }
}
