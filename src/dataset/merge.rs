//! Merges datasets: one list over the shards of several.

use robert_base::json;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::error::Error;
use super::manifest::{Episode, Manifest, ShardEntry, View};
use super::open::{Dataset, Verify};
use super::statistics::Statistics;
use super::view::{TEST_SHARE, drop_unused_shards, rebase_to, resolve, split};
use robert_base::fsio;

/// Seed of the split that [`merge`] fixes for inputs without one.
const SPLIT_SEED: u64 = 0;
/// Frames at the beginning by which trajectories are compared; no collector keeps shorter ones.
const TELLING: u64 = super::SHORTEST as u64;
/// Depth to which the views of merged inputs are kept, since JSON readers limit nesting.
const DEPTH: usize = 16;

/// Order of shards in a merge: spec, index within it, sha256.
type ShardKey = (String, u64, String);

/// Merges datasets of the same robot; the result does not depend on their order. All shards are
/// verified first. If only some inputs have a fixed split, the others get the usual one (5 % by
/// seed 0). With `equal`, every agent is reduced to the frames of the smallest. Shard paths of the
/// result are relative to `out`, which is not written.
///
/// # Errors
/// [`Error::Mismatch`], [`Error::Incomplete`] or [`Error::Shard`] with the shards to make again,
/// [`Error::Manifest`] when two inputs have the same trajectory, listed or recorded twice.
pub fn merge(inputs: &[PathBuf], out: &Path, equal: bool) -> Result<Manifest, Error> {
    let mut all: Vec<Manifest> = Vec::with_capacity(inputs.len());
    let mut owners: BTreeMap<u64, usize> = BTreeMap::new();
    for (i, input) in inputs.iter().enumerate() {
        let data = Dataset::open(input, Verify::Full)?;
        if let Some(first) = all.first() {
            same(first, data.manifest(), input)?;
        }
        for e in data.episodes() {
            let owner = *owners.entry(fingerprint(&data, e)).or_insert(i);
            // Copies within one input are on one side of its split.
            if owner != i {
                let other = inputs.get(owner).map_or(String::new(), |p| p.display().to_string());
                let shard = data.manifest().shards.get(e.shard).map_or(0, |s| s.index);
                return Err(Error::Manifest {
                    message: format!(
                        "the trajectory at frame {} of shard {shard} by {} is in two inputs (the other is {other}); merge each dataset only once (collections with one seed begin with the same motions)",
                        e.start, e.agent
                    ),
                    path: Manifest::path_of(input),
                });
            }
        }
        all.push(data.manifest().clone());
    }
    let is_split = |m: &Manifest| m.episodes.iter().any(|e| e.part.is_some());
    if all.iter().any(is_split) {
        for m in all.iter_mut().filter(|m| !is_split(m)) {
            split(m, SPLIT_SEED, TEST_SHARE)?;
        }
    }
    let of = histories(&mut all);
    let mut merged: Option<Manifest> = None;
    let mut shards: BTreeMap<ShardKey, ShardEntry> = BTreeMap::new();
    let mut episodes: BTreeMap<(ShardKey, u64), Vec<Episode>> = BTreeMap::new();
    let folder =
        resolve(out).map_err(|source| fsio::Error::Write { source, path: out.to_owned() })?;
    for (mut m, input) in all.into_iter().zip(inputs) {
        rebase_to(&mut m, &Manifest::path_of(input), &folder)?;
        for e in m.episodes.drain(..) {
            let Some(s) = m.shards.get(e.shard) else { continue };
            let key = (s.spec_sha256.clone(), s.index, s.sha256.clone());
            episodes.entry((key, e.start)).or_default().push(e);
        }
        for s in m.shards.drain(..) {
            shards.entry((s.spec_sha256.clone(), s.index, s.sha256.clone())).or_insert(s);
        }
        match &mut merged {
            None => merged = Some(m),
            // One by one: `append` would rebuild the whole map for each input.
            Some(first) => first.specs.extend(std::mem::take(&mut m.specs)),
        }
    }
    let Some(mut m) = merged else {
        return Err(Error::Argument {
            name: "datasets",
            must: "one or more",
            got: "none".to_owned(),
        });
    };
    let position: BTreeMap<_, usize> = shards.keys().cloned().zip(0..).collect();
    m.shards = shards.into_values().collect();
    m.episodes = episodes
        .into_iter()
        .flat_map(|((key, _), list)| {
            let shard = position[&key];
            list.into_iter().map(move |e| Episode { shard, ..e })
        })
        .collect();
    // The result has not been measured yet.
    m.statistics = Statistics::default();
    m.views = vec![View::Merge { inputs: inputs.len() as u64, equal, of }];
    if equal {
        level(&mut m);
    }
    drop_unused_shards(&mut m);
    Ok(m)
}

/// A hash of the beginning of a trajectory. It is the same for the same motion in shards of
/// different length, which two collections with one seed contain.
fn fingerprint(data: &Dataset, e: &Episode) -> u64 {
    let (qpos, _, ctrl) = data.frames(&Episode { length: e.length.min(TELLING), ..e.clone() });
    let shown = [bytemuck::cast_slice::<f32, u8>(qpos), bytemuck::cast_slice(ctrl)].concat();
    let hash = fsio::sha256_hex(&shown);
    hash.get(..16).and_then(|h| u64::from_str_radix(h, 16).ok()).unwrap_or(0)
}

/// Collects the views of the inputs of a merge. For an input that is only a merge, the views of its
/// own inputs are used, so that a dataset that grows by merging does not nest them.
fn histories(all: &mut [Manifest]) -> Vec<Vec<View>> {
    let mut of = Vec::new();
    for m in all {
        let mut views = std::mem::take(&mut m.views);
        match views.as_mut_slice() {
            [] => {}
            [View::Merge { equal: false, of: inner, .. }] => of.append(inner),
            _ => {
                forget(&mut views, DEPTH);
                of.push(views);
            }
        }
    }
    of.sort_by_cached_key(json::line);
    of
}

fn forget(views: &mut [View], depth: usize) {
    for view in views {
        let View::Merge { of, .. } = view else { continue };
        match depth.checked_sub(1) {
            Some(left) => of.iter_mut().for_each(|inner| forget(inner, left)),
            None => of.clear(),
        }
    }
}

/// Reduces every agent to the frames of the smallest. The kept trajectories are spread evenly, so
/// that early and late snapshots stay.
fn level(m: &mut Manifest) {
    let mut lists: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (i, e) in m.episodes.iter().enumerate() {
        lists.entry(&e.agent).or_default().push(i);
    }
    let length = |i: &usize| m.episodes.get(*i).map_or(0, |e| e.length);
    let smallest = lists.values().map(|l| l.iter().map(length).sum::<u64>()).min().unwrap_or(0);
    let mut keep = BTreeSet::new();
    for list in lists.values() {
        let all: u64 = list.iter().map(length).sum();
        let (mut seen, mut kept) = (0_u64, 0_u64);
        for &i in list {
            // As in Bresenham's line algorithm, a trajectory is kept whenever the kept frames would
            // otherwise be more than half of it behind their share.
            seen += length(&i);
            let want = u128::from(seen) * u128::from(smallest) / u128::from(all.max(1));
            if u128::from(kept + length(&i) / 2) <= want {
                kept += length(&i);
                keep.insert(i);
            }
        }
    }
    let mut at = 0;
    m.episodes.retain(|_| {
        at += 1;
        keep.contains(&(at - 1))
    });
}

fn same(a: &Manifest, b: &Manifest, path: &Path) -> Result<(), Error> {
    let differ = |field, left: &dyn ToString, right: &dyn ToString| {
        Err(Error::Mismatch {
            field,
            left: left.to_string(),
            right: right.to_string(),
            path: Manifest::path_of(path),
        })
    };
    if a.robot.id != b.robot.id {
        return differ("robot", &a.robot.id, &b.robot.id);
    }
    if a.robot.model_sha256 != b.robot.model_sha256 {
        return differ("robot model", &a.robot.model_sha256, &b.robot.model_sha256);
    }
    if a.robot != b.robot {
        return differ("robot description", &format!("{:?}", a.robot), &format!("{:?}", b.robot));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::manifest::Part;
    use super::super::manifest::tests::robot;
    use super::super::shard::tests::push;
    use super::super::shard::{Shard, ShardBuilder};
    use super::super::view::tests::dataset;
    use super::super::view::{Corruption, corrupt, rebase, shrink};
    use super::*;

    #[test]
    fn merge_does_not_depend_on_order() {
        let dir = tempfile::tempdir().unwrap();
        let (a, b) = (dir.path().join("a"), dir.path().join("b"));
        dataset(&a, 20, 1);
        dataset(&b, 30, 2);
        let out = dir.path().join("deep/out");
        let x = merge(&[a.clone(), b.clone()], &out, false).unwrap();
        let y = merge(&[b.clone(), a.clone()], &out, false).unwrap();
        assert_eq!(x, y);
        assert_eq!(x.totals.episodes, 50);
        x.save(&out).unwrap();
        assert_eq!(Dataset::open(&out, Verify::Full).unwrap().episodes().len(), 50);
        assert!(merge(&[a.clone(), a.clone()], &out, false).is_err());
        std::fs::write(a.join("shards/1-1.safetensors"), b"x").unwrap();
        let e = merge(&[b, a], &out, false).unwrap_err().to_string();
        assert!(e.contains("shard 1 has 1 bytes") && e.contains("1-1.safetensors"), "{e}");
    }

    #[test]
    fn no_trajectory_comes_from_two_inputs() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        dataset(&at("n1"), 20, 1);
        dataset(&at("n2"), 20, 2);
        let view = |from: &str, name: &str, change: &dyn Fn(&mut Manifest)| {
            let mut m = Manifest::load(&at(from)).unwrap();
            change(&mut m);
            rebase(&mut m, &Manifest::path_of(&at(from)), &at(name)).unwrap();
            Dataset::publish(m, &at(name)).unwrap();
        };
        view("n1", "s1", &|m| split(m, 1, 0.3).unwrap());
        view("n1", "s2", &|m| split(m, 2, 0.3).unwrap());
        let how = Corruption { share: 0.5, per_slot: false, seed: 1 };
        view("n1", "c1", &|m| corrupt(m, how).unwrap());
        for [x, y] in [["s1", "s2"], ["n1", "s1"], ["c1", "n1"], ["c1", "s2"]] {
            for pair in [[at(x), at(y)], [at(y), at(x)]] {
                let e = merge(&pair, &at("out"), false).unwrap_err().to_string();
                assert!(e.contains("two inputs"), "{x} {y}: {e}");
            }
        }
        // Copies within one input are allowed.
        let x = merge(&[at("c1"), at("n2")], &at("out"), false).unwrap();
        assert_eq!(x, merge(&[at("n2"), at("c1")], &at("out"), false).unwrap());
        assert_eq!(x.totals.episodes, 40);
        assert!(!at("out").exists());
        // The side of every trajectory is fixed, as one input's was.
        assert!(x.episodes.iter().all(|e| e.part.is_some()));
        let held = |spec: &str| {
            let of = |e: &&Episode| x.shards[e.shard].spec_sha256 == spec;
            x.episodes.iter().filter(of).filter(|e| e.part == Some(Part::Test)).count()
        };
        assert_eq!((held("spec1"), held("spec2")), (1, 1));
    }

    #[test]
    fn one_motion_in_two_collections_is_one_trajectory() {
        let dir = tempfile::tempdir().unwrap();
        let (a, b) = (dir.path().join("a"), dir.path().join("b"));
        let make = |dir: &Path, spec: &str, seeds: &[u64], frames: usize| {
            let mut m = Manifest::new(robot());
            let mut b = ShardBuilder::new(&m.robot, spec, 0);
            seeds.iter().for_each(|&seed| push(&mut b, "a", seed, frames));
            let entry = b.write(dir, Path::new("0.safetensors")).unwrap();
            let file = dir.join("0.safetensors");
            m.add(entry, &Shard::open(&file, 2, 1, None).unwrap());
            m.count();
            m.save(dir).unwrap();
        };
        make(&a, "short", &[1, 2], 60);
        make(&b, "long", &[3, 4, 2], 90);
        let e = merge(&[a.clone(), b.clone()], dir.path(), false).unwrap_err().to_string();
        assert!(e.contains("frame 180") && e.contains("one seed"), "{e}");
        make(&b, "long", &[3, 4, 5], 90);
        assert_eq!(merge(&[a, b], dir.path(), false).unwrap().totals.episodes, 5);
    }

    #[test]
    fn a_merge_keeps_what_was_done_to_its_inputs() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let save = |m: &mut Manifest, from: &str, name: &str| {
            rebase(m, &Manifest::path_of(&at(from)), &at(name)).unwrap();
            m.save(&at(name)).unwrap();
        };
        let mut third = dataset(&at("a"), 30, 1);
        shrink(&mut third, 3).unwrap();
        save(&mut third, "a", "third");
        let plain = ["b", "c"].map(|name| {
            dataset(&at(name), 8, u64::from(name.as_bytes()[0]));
            at(name)
        });
        let of = |m: &Manifest| match m.views.as_slice() {
            [View::Merge { of, .. }] => of.clone(),
            other => panic!("{other:?}"),
        };
        let m = merge(&plain, &at("bc"), false).unwrap();
        assert_eq!(of(&m), Vec::<Vec<View>>::new());
        m.save(&at("bc")).unwrap();
        let text = std::fs::read_to_string(at("bc/manifest.json")).unwrap();
        assert!(text.contains("\"equal\": false") && !text.contains("\"of\""), "{text}");
        let mut m = merge(&[at("bc"), at("third")], &at("m"), false).unwrap();
        assert_eq!(of(&m), [vec![View::Shrink { k: 3 }]]);
        m.save(&at("m")).unwrap();
        assert_eq!(Manifest::load(&at("m")).unwrap(), m);
        // Growing by merging keeps the lists flat; other views between do not grow for ever.
        for round in 0..3 * DEPTH as u64 {
            m.views.push(View::Split { seed: round, test_share: 0.5 });
            let mut all = [m.clone()];
            m.views = vec![View::Merge { inputs: 1, equal: false, of: histories(&mut all) }];
        }
        m.save(&at("m")).unwrap();
        assert_eq!(Manifest::load(&at("m")).unwrap(), m);
        let before = of(&m);
        assert_eq!(histories(&mut [m]), before);
    }

    #[test]
    fn equal_parts_are_equal() {
        let dir = tempfile::tempdir().unwrap();
        let (a, b) = (dir.path().join("a"), dir.path().join("b"));
        let mut m = dataset(&a, 40, 1);
        m.episodes.truncate(25);
        m.views.push(View::Only { part: Part::Train });
        m.save(&a).unwrap();
        dataset(&b, 60, 2);
        let out = merge(&[a, b], &dir.path().join("o"), true).unwrap();
        let mut frames: BTreeMap<&str, u64> = BTreeMap::new();
        for e in &out.episodes {
            *frames.entry(&e.agent).or_default() += e.length;
        }
        let (x, y) = (frames["a"] as f64, frames["b"] as f64);
        assert!((x / y - 1.0).abs() < 0.1, "{frames:?}");
    }
}
