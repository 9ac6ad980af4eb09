//! Every parser of our own on damaged files: whatever the bytes, no panic, no second of work, no
//! memory beyond what a file of that size explains.
//!
//! Each input is a function of its number, so a failure can be repeated. A few thousand in a normal
//! run; `ROBERT_FUZZ=10000000 cargo test --test it parsers::csv -- --nocapture` for so many of one
//! parser. `ROBERT_FUZZ_FROM` is the number of the first. Clips themselves are in `clip::fuzz`,
//! takes in `robert-take`, journals in `robert-studio`, models of robots in `malformed`.

use std::path::Path;
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

use robert::clip::formats::{
    from_command_json, from_csv, from_mjcf, from_ros, to_command_json, to_csv, to_mjcf, to_ros,
};
use robert::clip::{Clip, Command, Fill, Op, RobotRef, compile, edited};
use robert::net::checkpoint::{self, Card, Model};
use robert::net::{Net, NetConfig};
use robert::rng::{Rng, Stream};
use robert::robot::import::{self, ImportConfig};
use robert::robot::{PlantConfig, Robot, preparse};
use robert::rollout::{PolicyConfig, Rollout, RolloutConfig, Start, tasks};
use robert::take::export::{self, Bodies};
use robert::take::{self, Provenance, Take, What};
use robert::xml;

use crate::clip::generate;

/// What numbers, names and structure are replaced by.
const TOKENS: &[&str] = &[
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e999",
    "-1e308",
    "4e-320",
    "-0",
    "99999999999999999999",
    "-1",
    "0x10",
    ".5",
    "1.",
    "+2",
    "true",
    "null",
    "\"",
    "'",
    "`",
    "\\",
    "\\u0000",
    "{",
    "}",
    "[",
    "]",
    "<",
    ">",
    "</",
    "/>",
    "<!--",
    "&amp;",
    "&#0;",
    ",",
    ":",
    ";",
    "\t",
    "\n",
    "\r\n",
    " ",
    "---",
    "- ",
    "? ",
    "*a",
    "&a ",
    "!!binary ",
    "|",
    "#",
    "\u{feff}",
    "\u{1F916}",
    "\u{202e}",
    "e",
    "E+",
    "%",
];

/// One to six edits: bits, bytes, tokens, pieces moved, doubled and cut.
fn damage(seed: &[u8], up_to: usize, rng: &mut Rng) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..=rng.below(6) {
        let reach = bytes.len().min(up_to) as u64;
        let at = rng.below(reach + 1) as usize;
        let end = (at + rng.below(24) as usize).min(bytes.len());
        match rng.below(9) {
            0 if at < bytes.len() => bytes[at] ^= 1 << rng.below(8),
            1 if at < bytes.len() => bytes[at] = rng.below(256) as u8,
            2 => bytes.insert(at, rng.below(256) as u8),
            3 => {
                bytes.drain(at..end);
            }
            4 => {
                let piece = bytes[at..end].to_vec();
                let to = rng.below(reach + 1) as usize;
                bytes.splice(to.min(bytes.len())..to.min(bytes.len()), piece);
            }
            5 | 6 => {
                let token = TOKENS[rng.below(TOKENS.len() as u64) as usize];
                let end = if rng.below(2) == 0 { at } else { end };
                bytes.splice(at..end, token.bytes());
            }
            7 => {
                // A digit becomes another, so that counts and sizes stay numbers.
                if let Some(d) = bytes[at..].iter().take(64).position(u8::is_ascii_digit) {
                    bytes[at + d] = b'0' + rng.below(10) as u8;
                }
            }
            _ if rng.below(4) == 0 => bytes.truncate(at),
            _ => {}
        }
    }
    bytes
}

fn asked(name: &str) -> Option<u64> {
    std::env::var(name).ok().and_then(|n| n.parse().ok())
}

/// Peak memory of this process, kB. It is meaningful only if one test runs alone.
fn peak_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap();
    peak.trim().trim_end_matches(" kB").parse().unwrap()
}

/// Feeds a parser, which says whether it took the input. `up_to` is where a seed may be damaged.
fn survives(
    name: &str,
    usual: u64,
    seeds: &[Vec<u8>],
    up_to: usize,
    parse: impl Fn(&[u8]) -> bool,
) {
    for (n, seed) in seeds.iter().enumerate() {
        assert!(parse(seed), "{name}: sound file {n} is refused");
    }
    let rounds = asked("ROBERT_FUZZ").unwrap_or(usual);
    let first = asked("ROBERT_FUZZ_FROM").unwrap_or(0);
    let (begin, mut taken, mut slowest) = (Instant::now(), 0_u64, (Duration::ZERO, 0));
    for round in first..first + rounds {
        let rng = &mut Rng::new(21, Stream::Test, round);
        let seed = &seeds[rng.below(seeds.len() as u64) as usize];
        let bytes = damage(seed, up_to, rng);
        let start = Instant::now();
        let read = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| parse(&bytes)));
        taken += u64::from(read.unwrap_or_else(|_| panic!("{name}: input {round} panics")));
        let mut took = start.elapsed();
        if took > slowest.0 && took > Duration::from_millis(20) {
            // It may have been other work on this machine: once more, by the processor's clock.
            let start = crate::clip::cpu();
            parse(&bytes);
            took = crate::clip::cpu().saturating_sub(start);
        }
        slowest = slowest.max((took, round));
    }
    assert!(slowest.0 < Duration::from_secs(1), "{name}: input {} took {:?}", slowest.1, slowest.0);
    assert!(taken < rounds, "{name}: damage is never noticed");
    if asked("ROBERT_FUZZ").is_some() {
        let (secs, peak) = (begin.elapsed().as_secs_f64(), peak_kb());
        println!(
            "{name}: {rounds} inputs, {taken} taken, {secs:.0} s, slowest {:?}, peak {peak} kB",
            slowest.0
        );
        assert!(peak < 512 << 10, "{name}: {peak} kB");
    }
}

/// Clips small enough that a damaged byte is likely one that matters, and a file is soon read.
fn clips() -> Vec<Clip> {
    let small = |c: &Clip| c.length < 24 && c.robot.joints.len() < 8;
    (0..4000).map(generate::clip).filter(small).take(60).collect()
}

fn exported(write: impl Fn(&Command) -> Option<String>) -> Vec<Vec<u8>> {
    let clips = clips();
    let texts = clips.iter().filter_map(|c| write(&compile(c).unwrap()));
    let found: Vec<Vec<u8>> = texts.filter(|t| t.len() < 2500).map(String::into_bytes).collect();
    assert!(found.len() >= 3, "{}", found.len());
    found
}

/// A clip that was taken is a clip, and compiles.
fn sound(clip: &Clip) -> bool {
    assert!(compile(clip).unwrap().q().iter().all(|v| v.is_finite()));
    true
}

fn text(bytes: &[u8]) -> Option<&str> {
    std::str::from_utf8(bytes).ok()
}

/// The robot of the clips with three joints.
fn three_joints() -> RobotRef {
    let robots = (0..).map(|i| generate::clip(i).robot);
    robots.into_iter().find(|r| r.joints.len() == 3).unwrap()
}

#[test]
fn csv() {
    let robot = three_joints();
    let seeds = exported(|c| (c.joints().len() == 3).then(|| to_csv(c)));
    survives("csv", 3000, &seeds, usize::MAX, |b| {
        from_csv(b, Some(&robot), Fill::Mask).is_ok_and(|c| sound(&c))
    });
}

#[test]
fn command_json() {
    let seeds = exported(|c| Some(to_command_json(c, "r")));
    survives("command_json", 3000, &seeds, usize::MAX, |b| {
        text(b).is_some_and(|t| from_command_json(t, None, Fill::Mask).is_ok_and(|c| sound(&c)))
    });
}

#[test]
fn ros() {
    let seeds = exported(|c| to_ros(c).ok());
    survives("ros", 3000, &seeds, usize::MAX, |b| {
        text(b).is_some_and(|t| from_ros(t, None, Fill::Mask).is_ok_and(|c| sound(&c)))
    });
}

#[test]
fn mjcf_keys() {
    let robot = three_joints();
    let seeds = exported(|c| (c.joints().len() == 3).then(|| to_mjcf(c).ok()).flatten());
    survives("mjcf_keys", 3000, &seeds, usize::MAX, |b| {
        text(b).is_some_and(|t| from_mjcf(t, &robot, Fill::Mask).is_ok_and(|c| sound(&c)))
    });
}

/// Half a second of the arm.
static TAKE: LazyLock<(Arc<Robot>, Take)> = LazyLock::new(|| {
    let robot = Arc::new(Robot::builtin("ur5e").unwrap());
    let clip = tasks::find("ur5e/reacher", None).unwrap();
    let command = compile(&clip).unwrap();
    let policy: PolicyConfig = "pd".parse().unwrap();
    let config = RolloutConfig::default();
    let provenance = Provenance::new(&robot, &policy, &config).unwrap();
    let built = policy.build(&robot).unwrap();
    let mut rollout = Rollout::new(&robot, built, &command, Start::Pose, config).unwrap();
    while rollout.frame() < 10 {
        rollout.step().unwrap();
    }
    let take = Take::record(&rollout, &command, Some(&clip), provenance).unwrap();
    (robot, take)
});

fn joints() -> Vec<String> {
    TAKE.0.joints().iter().map(|j| j.name.clone()).collect()
}

/// The last file of an export: the data, where others go along.
fn data(mut export: export::Export) -> Vec<u8> {
    export.files.pop().unwrap().bytes
}

#[test]
fn bvh() {
    let seed = data(export::bvh(&TAKE.1, &TAKE.0).unwrap());
    survives("bvh", 2000, &[seed], usize::MAX, |b| {
        text(b).is_some_and(|t| take::import::from_bvh(t, &TAKE.0).is_ok())
    });
}

#[test]
fn lafan() {
    let seed = data(export::lafan(&TAKE.1, &TAKE.0, 20).unwrap());
    let joints = joints();
    survives("lafan", 3000, &[seed], usize::MAX, |b| {
        take::import::from_lafan(b, &joints, 20.0).is_ok()
    });
}

#[test]
fn tracking() {
    let seed = data(export::tracking(&TAKE.1, &TAKE.0, 20, Bodies::Mujoco).unwrap());
    let joints = joints();
    survives("tracking", 1000, &[seed], usize::MAX, |b| {
        take::import::from_tracking(b, &joints, None).is_ok()
    });
}

#[test]
fn bag() {
    let options = export::RosOptions::default();
    let seed = data(export::bag(&TAKE.1, What::Achieved, &options).unwrap());
    survives("bag", 2000, &[seed], usize::MAX, |b| take::import::from_bag(b).is_ok());
}

#[test]
fn model_file() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let whole = checkpoint::load(&root.join("assets/models/pointmass/faithful.safetensors"), None);
    let Model { card, encoder, .. } = whole.unwrap();
    // The same model with the smallest network, so that its file is soon read.
    let small = NetConfig { layers: 1, width: 16, heads: 1, ..card.net.clone() };
    let net = Net::init(small.clone(), None, 1).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.safetensors");
    let card = Card { net: small, ..card };
    checkpoint::save(&path, &card, &net, encoder.ridge.as_ref(), None).unwrap();
    let seed = std::fs::read(&path).unwrap();
    let head = 8 + u64::from_le_bytes(seed[..8].try_into().unwrap()) as usize;
    survives("model_file", 300, &[seed], head, |b| checkpoint::parse(b, &path, None).is_ok());
}

#[test]
fn robot_xml() {
    let seeds: Vec<Vec<u8>> = ["pointmass", "ur5e"]
        .iter()
        .map(|id| Robot::builtin(id).unwrap().mjcf().as_bytes().to_vec())
        .collect();
    let elements = robert::limits::XML_ELEMENTS;
    survives("robot_xml", 2000, &seeds, usize::MAX, |b| {
        text(b).is_some_and(|t| xml::parse(t, elements).is_ok())
    });
}

/// What reads a model before the simulator does: MJCF with an include, and URDF.
#[test]
fn preparsed() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("part.xml"), "<mujocoinclude/>").unwrap();
    let path = dir.path().join("model.xml");
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let read = |missing| preparse::read(&path, None, missing).is_ok();
        let [strict, lenient] =
            [preparse::MissingFiles::Refuse, preparse::MissingFiles::LeaveOut].map(read);
        assert!(!strict || lenient);
        strict || lenient
    };
    let pointmass = Robot::builtin("pointmass").unwrap().mjcf().to_owned();
    let assets = "<include file=\"part.xml\"/><default><geom mesh=\"a\"/></default><asset><mesh file=\"a.stl\"/><texture name=\"t\" file=\"t.png\"/><material name=\"m\" texture=\"t\"/></asset>";
    let whole = pointmass.replacen("<worldbody", &format!("{assets}<worldbody"), 1);
    assert_ne!(pointmass, whole);
    let arm = std::fs::read(root.join("examples/arm.urdf")).unwrap();
    survives("preparsed", 1000, &[whole.into_bytes(), arm], usize::MAX, read);
}

/// What makes an MJCF of a URDF before the simulator sees it: links, joints, shapes, paths.
#[test]
fn urdf() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let dir = tempfile::tempdir().unwrap();
    let (source, out) = (dir.path().join("robot.urdf"), dir.path().join("out"));
    let config = ImportConfig { fixed_base: true, ..ImportConfig::new(source, out, "") };
    let arm = std::fs::read(root.join("examples/arm.urdf")).unwrap();
    survives("urdf", 1000, &[arm], usize::MAX, |b| {
        std::fs::write(&config.source, b).unwrap();
        let Ok(draft) = import::draft(&config) else { return false };
        xml::parse(&draft, robert::limits::XML_ELEMENTS).expect("the draft is XML");
        true
    });
}

#[test]
fn lerobot() {
    let episodes = [export::Episode::of_take(&TAKE.1, "wave")];
    let dir = tempfile::tempdir().unwrap();
    let set = dir.path().join("set");
    let options = export::LeRobotOptions::default();
    export::lerobot(&episodes, None, &options).unwrap().write(&set).unwrap();
    let path = set.join("data/chunk-000/file-000.parquet");
    let seed = std::fs::read(&path).unwrap();
    let column = "observation.state".to_owned();
    let source = take::import::LeRobotSource { episode: 0, column, degrees: true };
    // The library panics here and there, and the panic becomes an error: silently.
    let said = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    survives("lerobot", 500, &[seed], usize::MAX, |b| {
        std::fs::write(&path, b).unwrap();
        take::import::from_lerobot(&set, &source).is_ok()
    });
    std::panic::set_hook(said);
}

/// Edits as the page and `robert clip apply` send them: what is taken leaves a sound clip.
#[test]
fn operations() {
    let clips = clips();
    let ops = |i: u64| {
        let clip = &clips[i as usize % clips.len()];
        serde_json::to_vec(&generate::op(&mut generate::rng(51, i), clip, true)).unwrap()
    };
    let seeds: Vec<Vec<u8>> = (0..200).map(ops).collect();
    let tables: Vec<_> = clips.iter().map(generate::table).collect();
    survives("operations", 5000, &seeds, usize::MAX, |b| {
        let Ok(op) = serde_json::from_slice::<Op>(b) else { return false };
        let at = b.len() % clips.len();
        if let Ok(next) = edited(&clips[at], &op, Some(&tables[at])) {
            assert_eq!(next.validate(), Ok(()));
            sound(&next);
        }
        true
    });
}

#[test]
fn policies_and_plants() {
    let policies =
        ["robert:adaptive+guide", "pd:kp=30,kd=2+refine", "ridge:runs/a.safetensors", "ilqr"];
    let plants = ["mass=1.2,damping=0.5", "gear=0.7", "friction=2"];
    let seeds: Vec<Vec<u8>> = policies
        .iter()
        .filter(|t| t.parse::<PolicyConfig>().is_ok())
        .chain(plants.iter().filter(|t| t.parse::<PlantConfig>().is_ok()))
        .map(|t| t.as_bytes().to_vec())
        .collect();
    assert!(seeds.len() >= 3, "{}", seeds.len());
    survives("policies_and_plants", 5000, &seeds, usize::MAX, |b| {
        text(b)
            .is_some_and(|t| t.parse::<PolicyConfig>().is_ok() | t.parse::<PlantConfig>().is_ok())
    });
}
