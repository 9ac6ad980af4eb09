//! Views: other lists of trajectories over the same shard files.
//!
//! A trajectory keeps its identity (shard hash, first frame) through every view, and the split is a
//! ranking of those identities. So copies made by [`corrupt`] stay on their original's side, and
//! nothing held out leaks into training. [`super::merge`] refuses a trajectory that comes from two
//! inputs, because it could be on both sides.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use super::error::Error;
use super::manifest::{Episode, Manifest, Part, View};
use robert_base::fsio;
use robert_base::rng::{Rng, Stream, draw};

/// Default share that is held out (the paper's 95/5).
pub(super) const TEST_SHARE: f64 = 0.05;

/// Identity of a trajectory: shard sha256 and first frame.
type Identity = (String, u64);

fn identity(m: &Manifest, e: &Episode) -> Identity {
    (m.shards.get(e.shard).map_or(String::new(), |s| s.sha256.clone()), e.start)
}

/// Fixes the part of each trajectory: `test_share` of the distinct trajectories (at least
/// one if there are two) are held out, ranked by a draw of `seed` and their identity.
///
/// # Errors
/// [`Error::Argument`] unless 0 < `test_share` < 1.
pub fn split(m: &mut Manifest, seed: u64, test_share: f64) -> Result<(), Error> {
    if !(test_share > 0.0 && test_share < 1.0) {
        return Err(Error::Argument {
            name: "test share",
            must: "between 0 and 1",
            got: test_share.to_string(),
        });
    }
    let test = held_out(m, seed, test_share);
    let parts: Vec<Part> = m
        .episodes
        .iter()
        .map(|e| if test.contains(&identity(m, e)) { Part::Test } else { Part::Train })
        .collect();
    for (e, part) in m.episodes.iter_mut().zip(parts) {
        e.part = Some(part);
    }
    m.views.push(View::Split { seed, test_share });
    Ok(())
}

fn held_out(m: &Manifest, seed: u64, test_share: f64) -> BTreeSet<Identity> {
    let distinct: BTreeSet<Identity> = m.episodes.iter().map(|e| identity(m, e)).collect();
    let count = match distinct.len() {
        0 | 1 => 0,
        n => ((n as f64 * test_share).round() as usize).clamp(1, n - 1),
    };
    let mut ranked: Vec<(u64, Identity)> = distinct
        .into_iter()
        .map(|id| {
            // The first 16 hex digits of its hash identify the shard.
            let shard = id.0.get(..16).and_then(|h| u64::from_str_radix(h, 16).ok()).unwrap_or(0);
            (draw(seed ^ shard, Stream::Split, id.1), id)
        })
        .collect();
    ranked.sort();
    ranked.into_iter().take(count).map(|(_, id)| id).collect()
}

/// Positions of the trajectories of one part; a fixed split takes precedence over `seed`.
pub(super) fn part(m: &Manifest, part: Part, seed: u64) -> Vec<usize> {
    let test = if m.episodes.iter().any(|e| e.part.is_some()) {
        None
    } else {
        Some(held_out(m, seed, TEST_SHARE))
    };
    let side = |e: &Episode| match (&test, e.part) {
        (_, Some(p)) => p,
        (Some(t), None) if t.contains(&identity(m, e)) => Part::Test,
        _ => Part::Train,
    };
    m.episodes.iter().enumerate().filter(|(_, e)| side(e) == part).map(|(i, _)| i).collect()
}

/// Keeps every k-th trajectory (the first of each k). If a split is fixed, only the training part
/// shrinks, so that all sizes are measured on the same held-out trajectories.
///
/// # Errors
/// [`Error::Argument`] for k = 0.
pub fn shrink(m: &mut Manifest, k: u64) -> Result<(), Error> {
    if k == 0 {
        return Err(Error::Argument { name: "K", must: "1 or more", got: k.to_string() });
    }
    let mut at = 0_u64;
    m.episodes.retain(|e| {
        if e.part == Some(Part::Test) {
            return true;
        }
        at += 1;
        (at - 1).is_multiple_of(k)
    });
    m.views.push(View::Shrink { k });
    drop_unused_shards(m);
    Ok(())
}

/// Keeps the trajectories of these agents (all if none is named), evenly thinned to `frames`, so
/// that datasets of different agents can be compared at equal size.
///
/// # Errors
/// [`Error::Argument`] for an agent that has no trajectory here.
pub fn pick(m: &mut Manifest, agents: &[String], frames: Option<u64>) -> Result<(), Error> {
    if let Some(missing) = agents.iter().find(|a| m.episodes.iter().all(|e| e.agent != **a)) {
        let known: BTreeSet<&str> = m.episodes.iter().map(|e| e.agent.as_str()).collect();
        let must = "an agent of this dataset";
        let got = format!("{missing} (it has {})", Vec::from_iter(known).join(", "));
        return Err(Error::Argument { name: "agent", must, got });
    }
    m.episodes.retain(|e| agents.is_empty() || agents.contains(&e.agent));
    if let Some(most) = frames {
        let all: u64 = m.episodes.iter().map(|e| e.length).sum();
        let (mut seen, mut kept) = (0_u64, 0_u64);
        m.episodes.retain(|e| {
            seen += e.length;
            // The number of frames that should be kept up to this point of the list.
            let due = u128::from(seen) * u128::from(most) / u128::from(all.max(1));
            let keep = all <= most || u128::from(kept + e.length) <= due;
            kept += if keep { e.length } else { 0 };
            keep
        });
    }
    m.views.push(View::Pick { agents: agents.to_vec(), frames });
    drop_unused_shards(m);
    Ok(())
}

/// The way in which a dataset is corrupted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corruption {
    /// Share of the train trajectories to overwrite, 0 to 1.
    pub share: f64,
    /// Draw another source for every slot (the paper's wording allows both readings).
    pub per_slot: bool,
    /// Seed of the choice, and of the split if none is fixed yet.
    pub seed: u64,
}

/// Replaces a share of the training trajectories by copies of one randomly drawn training
/// trajectory. The split is fixed first if necessary.
///
/// # Errors
/// [`Error::Argument`] unless 0 <= share <= 1.
pub fn corrupt(m: &mut Manifest, how: Corruption) -> Result<(), Error> {
    let Corruption { share, per_slot, seed } = how;
    if !(0.0..=1.0).contains(&share) {
        return Err(Error::Argument { name: "P", must: "0 to 1", got: share.to_string() });
    }
    if m.episodes.iter().all(|e| e.part.is_none()) {
        split(m, seed, TEST_SHARE)?;
    }
    let train = part(m, Part::Train, seed);
    let mut rng = Rng::new(seed, Stream::Corrupt, 0);
    let source = |rng: &mut Rng| {
        train.get(rng.below(train.len() as u64) as usize).and_then(|&i| m.episodes.get(i)).cloned()
    };
    let one = source(&mut rng);
    let slots = rng.subset((share * train.len() as f64).round() as usize, train.len());
    let copies: Vec<(usize, Episode)> = slots
        .into_iter()
        .filter_map(|slot| {
            let copy = if per_slot { source(&mut rng) } else { one.clone() };
            Some((*train.get(slot)?, copy?))
        })
        .collect();
    for (slot, copy) in copies {
        if let Some(e) = m.episodes.get_mut(slot) {
            *e = copy;
        }
    }
    m.views.push(View::Corrupt { share, per_slot, seed });
    drop_unused_shards(m);
    Ok(())
}

/// Rewrites shard paths so that they are relative to the folder `out` (which need not exist yet)
/// instead of the folder of the manifest `from`.
///
/// # Errors
/// [`Error::File`] when a folder cannot be resolved.
pub fn rebase(m: &mut Manifest, from: &Path, out: &Path) -> Result<(), Error> {
    let out = resolve(out).map_err(|source| fsio::Error::Write { source, path: out.to_owned() })?;
    rebase_to(m, from, &out)
}

/// As [`rebase`], to a folder whose path is canonical already.
pub(super) fn rebase_to(m: &mut Manifest, from: &Path, out: &Path) -> Result<(), Error> {
    let from = from.parent().unwrap_or(Path::new("."));
    let from =
        resolve(from).map_err(|source| fsio::Error::Read { source, path: from.to_owned() })?;
    for s in &mut m.shards {
        s.file = relative(&from.join(&s.file), out);
    }
    Ok(())
}

/// The canonical path of a folder, also if it does not exist yet.
pub(super) fn resolve(path: &Path) -> std::io::Result<PathBuf> {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    let path = std::path::absolute(path)?;
    for there in path.ancestors() {
        let mut real = match there.canonicalize() {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => continue,
            found => found?,
        };
        // The rest does not exist, so its ".." cannot lead through a link.
        for c in path.strip_prefix(there).into_iter().flat_map(Path::components) {
            match c {
                Component::ParentDir => {
                    real.pop();
                }
                c => real.push(c),
            }
        }
        return Ok(real);
    }
    Ok(path)
}

/// `path` relative to `base`; both absolute.
fn relative(path: &Path, base: &Path) -> PathBuf {
    let mut clean = PathBuf::new();
    for c in path.components() {
        match c {
            Component::ParentDir => {
                clean.pop();
            }
            Component::CurDir => {}
            c => clean.push(c),
        }
    }
    let common = clean.components().zip(base.components()).take_while(|(a, b)| a == b).count();
    let mut out = PathBuf::new();
    base.components().skip(common).for_each(|_| out.push(".."));
    clean.components().skip(common).for_each(|c| out.push(c));
    out
}

/// Drops shards without trajectories and recounts.
pub(super) fn drop_unused_shards(m: &mut Manifest) {
    let used: BTreeSet<usize> = m.episodes.iter().map(|e| e.shard).collect();
    let new: BTreeMap<usize, usize> = used.iter().copied().zip(0..).collect();
    let mut at = 0;
    m.shards.retain(|_| {
        at += 1;
        used.contains(&(at - 1))
    });
    for e in &mut m.episodes {
        e.shard = new[&e.shard];
    }
    m.count();
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::manifest::tests::robot;
    use super::super::shard::ShardBuilder;
    use super::super::shard::tests::push;
    use super::*;

    /// A dataset of `n` trajectories of 60-90 frames in two shards, by agents "a" and "b".
    pub(crate) fn dataset(dir: &Path, n: u64, spec: u64) -> Manifest {
        let mut m = Manifest::new(robot());
        for half in 0..2 {
            let mut b = ShardBuilder::new(&m.robot, &format!("spec{spec}"), half);
            for i in (half * n / 2)..((half + 1) * n / 2) {
                let agent = if half == 0 { "a" } else { "b" };
                push(&mut b, agent, spec * 1000 + i, 60 + (i % 31) as usize);
            }
            let file = PathBuf::from(format!("shards/{spec}-{half}.safetensors"));
            let entry = b.write(dir, &file).unwrap();
            let shard = super::super::shard::Shard::open(&dir.join(&file), 2, 1, Some(entry.bytes))
                .unwrap();
            m.add(entry, &shard);
        }
        m.count();
        m.save(dir).unwrap();
        m
    }

    #[test]
    fn split_is_by_trajectory_and_seed() {
        let dir = tempfile::tempdir().unwrap();
        let m = dataset(dir.path(), 200, 1);
        let (train, test) = (part(&m, Part::Train, 1), part(&m, Part::Test, 1));
        assert_eq!((train.len(), test.len()), (190, 10));
        assert!(train.iter().all(|i| !test.contains(i)));
        assert_ne!(test, part(&m, Part::Test, 2));
        let mut fixed = m.clone();
        split(&mut fixed, 1, 0.05).unwrap();
        assert_eq!(part(&fixed, Part::Test, 99), test);
    }

    #[test]
    fn pick_keeps_agents_and_thins_evenly() {
        let dir = tempfile::tempdir().unwrap();
        let m = dataset(dir.path(), 30, 1);
        let mut a = m.clone();
        pick(&mut a, &["a".to_owned()], None).unwrap();
        assert!(a.episodes.iter().all(|e| e.agent == "a"));
        assert!(!a.episodes.is_empty() && a.episodes.len() < m.episodes.len());
        let mut few = m.clone();
        pick(&mut few, &[], Some(800)).unwrap();
        assert!((700..=800).contains(&few.totals.frames), "{}", few.totals.frames);
        let last = |m: &Manifest| m.episodes.last().map(|e| (m.shards[e.shard].index, e.start));
        let first = few.episodes.first().map(|e| e.start);
        assert!(first < Some(400) && last(&few) > Some((1, 400)), "from end to end");
        let mut all = m.clone();
        pick(&mut all, &[], Some(1 << 40)).unwrap();
        assert_eq!(all.episodes, m.episodes);
        assert!(pick(&mut all, &["z".to_owned()], None).unwrap_err().to_string().contains('z'));
    }

    #[test]
    fn shrink_keeps_every_kth() {
        let dir = tempfile::tempdir().unwrap();
        let m = dataset(dir.path(), 20, 1);
        let mut s = m.clone();
        shrink(&mut s, 7).unwrap();
        let seeds: Vec<u64> = s.episodes.iter().map(|e| e.seed).collect();
        assert_eq!(seeds, [1000, 1007, 1014]);
        let mut s = m.clone();
        shrink(&mut s, 12).unwrap();
        assert_eq!((s.shards.len(), s.episodes.len()), (2, 2));
        assert!(shrink(&mut s, 0).is_err());
    }

    #[test]
    fn corruption_overwrites_train_only() {
        let dir = tempfile::tempdir().unwrap();
        let m = dataset(dir.path(), 100, 1);
        let mut c = m.clone();
        corrupt(&mut c, Corruption { share: 0.5, per_slot: false, seed: 4 }).unwrap();
        let mut counts: BTreeMap<u64, usize> = BTreeMap::new();
        for e in &c.episodes {
            *counts.entry(e.seed).or_default() += 1;
        }
        let most = counts.values().max().copied().unwrap();
        assert!((47..=49).contains(&most), "{most} copies of round(0.5 * 95) = 48 slots");
        let test = part(&m, Part::Test, 4);
        for &i in &test {
            assert_eq!(c.episodes[i].seed, m.episodes[i].seed);
            assert_eq!(c.episodes[i].part, Some(Part::Test));
        }
        let mut per_slot = m.clone();
        corrupt(&mut per_slot, Corruption { share: 0.5, per_slot: true, seed: 4 }).unwrap();
        let distinct: BTreeSet<u64> = per_slot.episodes.iter().map(|e| e.seed).collect();
        assert!(distinct.len() > counts.len());
        let mut again = m.clone();
        corrupt(&mut again, Corruption { share: 0.5, per_slot: false, seed: 4 }).unwrap();
        assert_eq!(again, c);
    }
}
