//! Random valid clips and plausible edits, a pure function of a seed.

use std::collections::BTreeMap;

use robert::clip::*;
use robert::rng::{Rng, Stream};

pub(crate) fn rng(seed: u64, index: u64) -> Rng {
    Rng::new(seed, Stream::Test, index)
}

fn value(r: &mut Rng) -> f64 {
    match r.below(8) {
        0 => 0.0,
        1 => -1.5,
        2 => round(r.range(-1e5, 1e5)),
        _ => round(r.range(-3.0, 3.0)),
    }
}

pub(crate) fn row(r: &mut Rng, dim: usize, open: bool) -> Row {
    // Some rows are of a few joints only.
    let share = if r.below(3) == 0 { 2 } else { 6 };
    let mut row: Row =
        (0..dim).map(|_| if open && r.below(share) == 0 { None } else { Some(value(r)) }).collect();
    if row.iter().all(Option::is_none) {
        row[r.below(dim as u64) as usize] = Some(0.25);
    }
    row
}

fn word(r: &mut Rng) -> String {
    let words = ["rest", "six", "a \"b\"", "größe", "x/y~z", "\u{1F916}", "tab", "rock", "q", "up"];
    words[r.below(words.len() as u64) as usize].to_owned()
}

fn fill(r: &mut Rng) -> Option<Fill> {
    [None, Some(Fill::Mask), Some(Fill::Linear), Some(Fill::Cubic), Some(Fill::Hold)]
        [r.below(5) as usize]
}

fn goal(r: &mut Rng, clip: &Clip) -> Goal {
    let names: Vec<&String> = clip.poses.keys().collect();
    if !names.is_empty() && r.below(3) == 0 {
        return Goal::Pose(names[r.below(names.len() as u64) as usize].clone());
    }
    Goal::Q(row(r, clip.dim(), true))
}

pub(crate) fn key(r: &mut Rng, clip: &Clip, frame: u32) -> Key {
    let note = if r.below(9) == 0 { word(r) } else { String::new() };
    let hold = match r.below(6) {
        0 => 1 + r.below(30) as u32,
        1 => 1 + r.below(150) as u32,
        _ => 1,
    };
    Key {
        hold,
        fill: fill(r),
        tangents: tangents(r, clip),
        note,
        ..Key::with(frame, goal(r, clip))
    }
}

fn tangent(r: &mut Rng) -> Tangent {
    match r.below(4) {
        0 => Tangent::FLAT,
        1 => Tangent::LINEAR,
        2 => Tangent::Slope(value(r)),
        _ => Tangent::corner(round(r.range(-3.0, 0.0)), round(r.range(0.5, 3.0))),
    }
}

fn tangents(r: &mut Rng, clip: &Clip) -> BTreeMap<String, Tangent> {
    let joints = if r.below(4) == 0 { some_joints(r, clip) } else { None };
    joints.into_iter().flatten().map(|joint| (joint, tangent(r))).collect()
}

fn span(r: &mut Rng, length: u32) -> (u32, u32) {
    let from = r.below(u64::from(length)) as u32;
    (from, from + 1 + r.below(u64::from(length - from)) as u32)
}

fn some_joints(r: &mut Rng, clip: &Clip) -> Option<Vec<String>> {
    let n = r.below(clip.dim() as u64 + 1) as usize;
    (n > 0).then(|| {
        r.subset(n, clip.dim()).into_iter().map(|j| clip.robot.joints[j].clone()).collect()
    })
}

fn offset(r: &mut Rng, clip: &Clip, frame: u32) -> Offset {
    let joints = some_joints(r, clip).unwrap_or_else(|| vec![clip.robot.joints[0].clone()]);
    Offset {
        frame,
        add: joints.into_iter().map(|j| (j, value(r))).collect(),
        fade_in: r.below(30) as u32,
        hold: 1 + r.below(5) as u32,
        fade_out: r.below(30) as u32,
    }
}

/// A valid clip.
pub(crate) fn clip(seed: u64) -> Clip {
    let r = &mut rng(seed, 0);
    let dim = 1 + r.below(4) as usize;
    let joints = ["FFJ4", "time", "a, b", "t"][..dim].iter().map(|j| (*j).to_owned()).collect();
    let length = 1 + r.below(300) as u32;
    let robot = RobotRef { id: "arm".into(), joints, ..RobotRef::default() };
    let mut clip = Clip::new(robot, length);
    clip.fill = fill(r).unwrap_or_default();
    if r.below(2) == 0 {
        clip.name = word(r);
        clip.notes = format!("{}\n{}", word(r), word(r));
        clip.robot.model = Some("m.xml".into());
        clip.robot.model_sha256 = Some("0123456789abcdef".repeat(4));
        clip.robot.units = vec![robert::units::Unit::Rad; dim];
    }
    for _ in 0..r.below(4) {
        clip.poses.insert(word(r), row(r, dim, true));
    }
    let keys = r.below(u64::from(length).min(12) + 1) as usize;
    for frame in r.subset(keys, length as usize) {
        let key = key(r, &clip, frame as u32);
        clip.keys.push(key);
    }
    for _ in 0..r.below(4) {
        let (from, to) = span(r, length);
        let joints = some_joints(r, &clip);
        clip.masks.push(Mask { from, to, joints });
    }
    let markers = r.below(u64::from(length).min(3) + 1) as usize;
    for frame in r.subset(markers, length as usize) {
        let frame = frame as u32;
        let to = (r.below(3) == 0).then(|| (frame + 1 + r.below(40) as u32).min(length));
        clip.markers.push(Marker { frame, name: word(r), to });
    }
    let offsets = r.below(u64::from(length).min(3) + 1) as usize;
    for frame in r.subset(offsets, length as usize) {
        let offset = offset(r, &clip, frame as u32);
        clip.offsets.push(offset);
    }
    clip.masks.sort();
    clip.masks.dedup();
    match r.below(3) {
        0 => clip.start = Some(Start::Q((0..dim).map(|_| value(r)).collect())),
        1 => {
            let full = clip.poses.iter().find(|(_, row)| !row.contains(&None));
            clip.start = full.map(|(name, _)| Start::Pose(name.clone()));
        }
        _ => {}
    }
    if r.below(3) == 0 {
        clip.x.insert(
            "other tool".into(),
            serde_json::json!({"z": [1, 2.5, null], "a": {"b": true}}),
        );
    }
    clip
}

/// A mirror table for the clips above: the first joint turns around, the rest stays.
pub(crate) fn table(clip: &Clip) -> JointTable {
    let mut table = JointTable::from_clip(clip);
    table.mirror = Mirror::Table(vec![MirrorRow {
        target: clip.robot.joints[0].clone(),
        source: clip.robot.joints[0].clone(),
        sign: -1.0,
        offset: 0.5,
    }]);
    table
}

/// An edit that often, not always, makes sense for this clip.
pub(crate) fn op(r: &mut Rng, clip: &Clip, deep: bool) -> Op {
    let length = u64::from(clip.length);
    let any = |r: &mut Rng| r.below(length + 3) as u32;
    let flag = |r: &mut Rng| r.below(2) == 0;
    let frames = |r: &mut Rng| -> Vec<u32> {
        let n = clip.keys.len();
        if n == 0 || r.below(12) == 0 {
            return vec![r.below(length + 3) as u32];
        }
        let count = 1 + r.below(n as u64) as usize;
        r.subset(count, n).into_iter().map(|i| clip.keys[i].frame).collect()
    };
    let pose = |r: &mut Rng| match clip.poses.keys().nth(r.below(3) as usize) {
        Some(name) => name.clone(),
        None => word(r),
    };
    let marker = |r: &mut Rng| match clip.markers.get(r.below(3) as usize) {
        Some(m) => m.frame,
        None => r.below(length) as u32,
    };
    let offsets = |r: &mut Rng| match clip.offsets.get(r.below(3) as usize) {
        Some(o) => vec![o.frame],
        None => vec![r.below(length) as u32],
    };
    match r.below(if deep { 32 } else { 30 }) {
        24 | 25 => Op::OffsetsSet(OffsetsSet {
            frame: if flag(r) { any(r) } else { offsets(r)[0] },
            add: offset(r, clip, 0)
                .add
                .into_iter()
                .map(|(j, v)| (j, flag(r).then_some(v)))
                .collect(),
            fade_in: flag(r).then(|| r.below(30) as u32),
            hold: flag(r).then(|| r.below(6) as u32),
            fade_out: None,
        }),
        26 => match r.below(3) {
            0 => Op::OffsetsDelete(KeysFrames { frames: offsets(r) }),
            1 => Op::OffsetsBake(KeysFrames { frames: offsets(r) }),
            _ => Op::OffsetsMove(OffsetsMove {
                frames: offsets(r),
                df: r.below(41) as i64 - 20,
                copy: flag(r),
            }),
        },
        27 => Op::BlocksInsert(BlocksInsert {
            at: any(r),
            name: word(r),
            part: Part::of(&self::clip(r.below(1000))),
            blend: r.below(12) as u32,
        }),
        28 => {
            let mut frames: Vec<u32> =
                clip.markers.iter().filter(|m| m.to.is_some()).map(|m| m.frame).collect();
            frames.reverse();
            Op::BlocksOrder(BlocksOrder { frames })
        }
        29 if flag(r) => {
            Op::BlocksRepeat(BlocksRepeat { frame: marker(r), blend: r.below(9) as u32 })
        }
        29 => Op::BlocksDelete(BlocksDelete { frame: marker(r) }),
        0 | 1 => {
            let keys = (0..=r.below(3)).map(|_| any(r)).collect::<Vec<_>>();
            let keys = keys.into_iter().map(|f| key(r, clip, f)).collect();
            Op::KeysAdd(KeysAdd { keys, replace: flag(r) })
        }
        2 => {
            let mut set = KeysSet { frame: frames(r)[0], ..KeysSet::default() };
            match r.below(4) {
                0 => set.q = Some(row(r, clip.dim(), true)),
                1 => set.pose = Some(pose(r)),
                2 => {
                    let joint = clip.robot.joints[r.below(clip.dim() as u64) as usize].clone();
                    set.values = BTreeMap::from([(joint, flag(r).then_some(0.75))]);
                }
                _ => {}
            }
            set.hold = flag(r).then_some(1 + r.below(50) as u32);
            set.fill = flag(r).then(|| fill(r));
            set.note = flag(r).then(|| word(r));
            Op::KeysSet(set)
        }
        3 | 4 => Op::KeysMove(KeysMove {
            frames: frames(r),
            df: r.below(41) as i64 - 20,
            ripple: flag(r),
            replace: flag(r),
            copy: r.below(4) == 0,
        }),
        5 => Op::KeysScale(KeysScale {
            frames: frames(r),
            pivot: any(r),
            factor: r.range(0.2, 2.5),
            replace: flag(r),
        }),
        6 => Op::KeysDelete(KeysFrames { frames: frames(r) }),
        7 => {
            let keys = clip.keys.iter().take(3).cloned().collect();
            let joints = flag(r).then(|| clip.robot.joints.iter().take(1).cloned().collect());
            Op::KeysPaste(KeysPaste {
                at: any(r),
                keys,
                replace: flag(r),
                mirrored: flag(r),
                joints,
            })
        }
        8 => Op::KeysMirror(KeysFrames { frames: frames(r) }),
        9 if flag(r) => {
            Op::KeysSparsify(KeysSparsify { frames: frames(r), tolerance: r.uniform() })
        }
        9 => Op::KeysHold(KeysHold { frames: frames(r), hold: r.below(60) as u32 }),
        10 | 11 => {
            let (from, to) = span(r, clip.length);
            Op::MaskSet(MaskSet { from, to, joints: some_joints(r, clip), masked: flag(r) })
        }
        12 if flag(r) => Op::TangentSet(TangentSet {
            frames: frames(r),
            joints: some_joints(r, clip),
            tangent: flag(r).then(|| tangent(r)),
        }),
        12 => Op::FillSet(FillSet { frames: flag(r).then(|| frames(r)), fill: fill(r) }),
        13 => Op::TimeInsert(TimeInsert { at: any(r), frames: r.below(40) as u32 }),
        14 => {
            let (from, to) = span(r, clip.length);
            Op::TimeDelete(TimeDelete { from, to })
        }
        15 => {
            Op::PoseSave(PoseSave { name: word(r), q: row(r, clip.dim(), true), replace: flag(r) })
        }
        16 | 17 => Op::PoseApply(PoseApply {
            name: pose(r),
            frames: if flag(r) { frames(r) } else { vec![any(r)] },
            blend: if flag(r) { 1.0 } else { r.uniform() },
            mirrored: flag(r),
            joints: if flag(r) { some_joints(r, clip) } else { None },
        }),
        18 => Op::PoseRename(PoseRename { name: pose(r), to: word(r) }),
        19 => Op::PoseDelete(PoseDelete { name: pose(r) }),
        20 => Op::MarkersAdd(Marker { frame: any(r), name: word(r), to: None }),
        21 => Op::MarkersMove(MarkersMove { frame: marker(r), to: any(r) }),
        22 => match r.below(4) {
            0 => Op::MarkersDelete(KeysFrames { frames: vec![marker(r)] }),
            1 => Op::MarkersSet(Marker { frame: marker(r), name: word(r), to: None }),
            2 => Op::ClipRename(ClipRename { name: word(r) }),
            _ => Op::ClipNotes(ClipNotes { notes: word(r) }),
        },
        23 if flag(r) => Op::ClipLength(ClipLength { length: r.below(400) as u32, cut: flag(r) }),
        23 => {
            let q = (0..clip.dim()).map(|_| value(r)).collect();
            Op::ClipStart(ClipStart { start: flag(r).then_some(Start::Q(q)) })
        }
        _ => {
            let ops = (0..r.below(4)).map(|_| op(r, clip, false)).collect();
            Op::Batch(Batch { label: "several".into(), ops })
        }
    }
}
