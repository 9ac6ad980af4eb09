//! Models that are broken, hostile or merely odd. Each gets the class of error that it
//! deserves, quickly, in little memory, and never takes the program along.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use robert::rng::{Rng, Stream};
use robert::robot::import::{ImportConfig, Servos, import};
use robert::robot::{Error, Robot};

use crate::run::binary;

/// Address space that a whole import may take, child included, kilobytes: 512 MB.
const MEMORY_KB: u32 = 512 * 1024;
/// Processor time that a refusal may take; the time on a clock depends on what else the machine does.
const PATIENCE: Duration = Duration::from_secs(2);

/// File name, content, and what the message must say.
struct Case {
    name: &'static str,
    text: Vec<u8>,
    says: &'static str,
}

fn case(name: &'static str, text: impl Into<Vec<u8>>, says: &'static str) -> Case {
    Case { name, text: text.into(), says }
}

/// A sound model around this content of the world, with a motor at joint "j".
fn world(inner: &str) -> String {
    format!(
        "<mujoco>\n<worldbody>\n{inner}\n</worldbody>\n<actuator><motor name=\"m\" joint=\"j\" ctrllimited=\"true\" ctrlrange=\"-1 1\"/></actuator>\n</mujoco>"
    )
}

/// A sound model with these sections added.
fn with(sections: &str) -> String {
    world(BODY).replace("\n<worldbody>", &format!("\n{sections}\n<worldbody>"))
}

const BODY: &str =
    r#"<body name="b"><joint name="j" type="hinge" axis="0 0 1"/><geom size=".1"/></body>"#;

fn body(attributes: &str, joint: &str, geom: &str) -> String {
    world(&format!(
        "<body name=\"b\" {attributes}><joint name=\"j\" {joint}/><geom {geom}/></body>"
    ))
}

fn nested(n: usize) -> String {
    let open = (0..n).fold(String::new(), |all, i| {
        all + &format!("<body name=\"n{i}\"><joint name=\"j{i}\"/><geom size=\".1\"/>")
    });
    world(&format!("{BODY}{open}{}", "</body>".repeat(n)))
}

fn mjcf_cases() -> Vec<Case> {
    let good = world(BODY);
    let text = |s: &str| s.to_owned();
    vec![
        // Not a model at all.
        case("empty.xml", "", "the file is empty"),
        case("blank.xml", "  \n\t\n", "the file is empty"),
        case("truncated.xml", &good.as_bytes()[..good.len() / 2], "truncated.xml:"),
        case("prose.xml", "Dear robot,", "prose.xml:1:"),
        case("binary.xml", (0..=255_u8).cycle().take(4096).collect::<Vec<_>>(), "binary.xml:"),
        case("nul.xml", good.replace("size", "si\0ze"), "NUL byte"),
        case("latin1.xml", b"<mujoco model=\"M\xfcller\"/>".to_vec(), "UTF-8"),
        case("root.xml", "<worldbody/>", "the root element is <worldbody>"),
        case("html.xml", "<html><body/></html>", "the root element is <html>"),
        case("two_roots.xml", "<mujoco/><mujoco/>", "two_roots.xml:1:"),
        case("unclosed.xml", "<mujoco><worldbody></mujoco>", "unclosed.xml:1:"),
        case("twice.xml", world(r#"<body name="b" name="c"/>"#), "twice.xml:3:"),
        case("doctype.xml", format!("<!DOCTYPE mujoco [<!ENTITY a \"b\">]>{good}"), "DOCTYPE"),
        case(
            "laughs.xml",
            "<!DOCTYPE l [<!ENTITY a \"ha\"><!ENTITY b \"&a;&a;&a;&a;\">]><mujoco model=\"&b;\"/>",
            "DOCTYPE",
        ),
        case("entity.xml", world("<body name=\"&system;\"/>"), "entity.xml:3:"),
        // The schema.
        case("element.xml", with("<robots/>"), "unrecognized element"),
        case(
            "part.xml",
            "<mujoco><body name=\"b\"><geom size=\".1\"/></body></mujoco>",
            "import the file that includes it",
        ),
        case("attribute.xml", body("colour=\"red\"", "", "size=\".1\""), "unrecognized attribute"),
        case("extension.xml", with("<extension><plugin plugin=\"a\"/></extension>"), "Schema violation"),
        case("keyword.xml", with("<option cone=\"round\"/>"), "invalid keyword"),
        case("numbers.xml", body("pos=\"1 2 3 4\"", "", "size=\".1\""), "attribute 'pos' has too much data"),
        case("few_numbers.xml", body("pos=\"1 2\"", "", "size=\".1\""), "pos"),
        case("word.xml", body("pos=\"a b c\"", "", "size=\".1\""), "pos"),
        case("missing_attribute.xml", with("<asset><material/></asset>"), "name"),
        // The compiler.
        case("negative_mass.xml", body("", "", "size=\".1\" mass=\"-1\""), "mass"),
        case("negative_size.xml", body("", "", "size=\"-.1\""), "size"),
        case("zero_size.xml", body("", "", "size=\"0\""), "size"),
        case("massless.xml", world("<body name=\"b\"><joint name=\"j\"/></body>"), "mass and inertia"),
        case(
            "inertia.xml",
            world("<body name=\"b\"><joint name=\"j\"/><inertial pos=\"0 0 0\" mass=\"1\" diaginertia=\"1 1 9\"/></body>"),
            "inertia",
        ),
        case("no_joint.xml", good.replace("joint=\"j\"", "joint=\"k\""), "k"),
        case("no_mesh.xml", body("", "", "type=\"mesh\" mesh=\"gone\""), "mesh"),
        case("no_file.xml", with("<asset><mesh name=\"m\" file=\"gone.stl\"/></asset>"), "\"gone.stl\" does not exist"),
        case("no_tendon.xml", with("<actuator><motor tendon=\"t\"/></actuator>"), "t"),
        case("empty_tendon.xml", with("<tendon><fixed name=\"t\"/></tendon>"), "tendon"),
        case("tendon_joint.xml", with("<tendon><fixed name=\"t\"><joint joint=\"x\" coef=\"1\"/></fixed></tendon>"), "x"),
        case("equality.xml", with("<equality><joint joint1=\"j\" joint2=\"x\"/></equality>"), "x"),
        case("weld.xml", with("<equality><weld body1=\"b\" body2=\"x\"/></equality>"), "x"),
        case("exclude.xml", with("<contact><exclude body1=\"b\" body2=\"x\"/></contact>"), "x"),
        case("pair.xml", with("<contact><pair geom1=\"g\" geom2=\"h\"/></contact>"), "g"),
        case("duplicate.xml", world(&format!("{BODY}{BODY}")), "repeated name"),
        case("duplicate_motor.xml", with("<actuator><motor name=\"m\" joint=\"j\"/></actuator>"), "repeated name"),
        case("range.xml", body("", "range=\"1 -1\" limited=\"true\"", "size=\".1\""), "range"),
        case("ctrlrange.xml", good.replace("-1 1", "1 -1"), "ctrlrange"),
        case("axis.xml", body("", "axis=\"0 0 0\"", "size=\".1\""), "axis"),
        case("nested_free.xml", world("<body name=\"a\"><geom size=\".1\"/><body name=\"b\"><freejoint name=\"j\"/><geom size=\".1\"/></body></body>"), "floats freely"),
        case("free.xml", world("<body name=\"b\"><freejoint name=\"j\"/><geom size=\".1\"/></body>"), "--fixed-base"),
        case("ball.xml", body("", "type=\"ball\"", "size=\".1\""), "ball joint"),
        case("still.xml", "<mujoco><worldbody><geom size=\"1\"/></worldbody></mujoco>", "no joint"),
        case("keyframe.xml", with("<keyframe><key qpos=\"1 2 3\"/></keyframe>"), "key"),
        case(
            "muscle.xml",
            good.replace("</actuator>", "<muscle joint=\"j\" range=\"1 .5\"/></actuator>"),
            "muscle.xml",
        ),
        case("texture.xml", with("<asset><texture name=\"t\" type=\"2d\" builtin=\"flat\" width=\"-4\" height=\"4\"/></asset>"), "texture"),
        case("skin.xml", with("<asset><skin name=\"s\" file=\"gone.skn\"/></asset>"), "does not exist"),
        case("mesh_faces.xml", with("<asset><mesh name=\"m\" vertex=\"0 0 0 1 0 0 0 1 0 0 0 1\" face=\"0 1 9\"/></asset>"), "mesh"),
        case("flat_mesh.xml", world(BODY).replace("\n<worldbody>", "<asset><mesh name=\"m\" vertex=\"0 0 0 1 0 0 0 1 0 1 1 0\"/></asset>\n<worldbody><geom type=\"mesh\" mesh=\"m\"/>"), "mesh"),
        // What the compiler takes without a word.
        case("timestep_zero.xml", with("<option timestep=\"0\"/>"), "timestep is 0 s"),
        case("timestep_negative.xml", with("<option timestep=\"-0.01\"/>"), "timestep is -0.01 s"),
        case("timestep_huge.xml", with("<option timestep=\"1e10\"/>"), "timestep is"),
        case("timestep_nan.xml", with("<option timestep=\"nan\"/>"), "not a finite number"),
        case("nan_pos.xml", body("pos=\"0 nan 0\"", "", "size=\".1\""), "not a finite number"),
        case("inf_pos.xml", body("pos=\"0 inf 0\"", "", "size=\".1\""), "not a finite number"),
        case("overflow.xml", body("pos=\"0 1e999 0\"", "", "size=\".1\""), "not a finite number"),
        case("nan_mass.xml", body("", "", "size=\".1\" mass=\"NaN\""), "not a finite number"),
        case("nan_key.xml", with("<keyframe><key qpos=\"nan\"/></keyframe>"), "not a finite number"),
        case("zero_quat.xml", body("quat=\"0 0 0 0\"", "", "size=\".1\""), "not a rotation"),
        case("negative_damping.xml", body("", "damping=\"-1\"", "size=\".1\""), "gain energy"),
        case("gear.xml", good.replace("ctrllimited", "gear=\"1e300\" ctrllimited"), "beyond any physical model"),
        case("user_dynamics.xml", with("<actuator><general joint=\"j\" dyntype=\"user\"/></actuator>"), "own program"),
        case("negative_nstack.xml", with("<size nstack=\"-7\"/>"), "must not be negative"),
        case("long_name.xml", body(&format!("pos=\"0 0 0\" childclass=\"{}\"", "x".repeat(100_000)), "", "size=\".1\""), "100000 bytes"),
        // Meant to exhaust.
        case("deep.xml", nested(97), "nested more than"),
        case("very_deep.xml", text(&format!("<mujoco>{}", "<a>".repeat(100_000))), "nested more than"),
        case("wide.xml", text(&format!("<mujoco>{}</mujoco>", "<a/>".repeat(300_000))), "elements"),
        case("nuser.xml", with("<size nuser_body=\"2000000000\"/>"), "nuser_body is 2000000000"),
        case("nstack.xml", with("<size nstack=\"2000000000\"/>"), "nstack is 2000000000"),
        case("nstack_tiny.xml", with("<size nstack=\"8\"/>"), "Stack overflow"),
        case("njmax.xml", with("<size njmax=\"2000000000\"/>"), "njmax is 2000000000"),
        case("composite.xml", world(&format!("{BODY}<body name=\"c\"><composite type=\"grid\" count=\"1000 1000 1000\" spacing=\".1\"><geom size=\".01\"/></composite></body>")), "composite has 1000000000 elements"),
        case("hfield.xml", with("<asset><hfield name=\"h\" nrow=\"100000\" ncol=\"100000\" size=\"1 1 1 1\"/></asset>"), "nrow is 100000"),
        case("big_texture.xml", with("<asset><texture name=\"t\" type=\"2d\" builtin=\"flat\" width=\"100000\" height=\"100000\"/></asset>"), "100000; at most 4096"),
        // Out of the folder.
        case("include_self.xml", with("<include file=\"include_self.xml\"/>"), "included twice or by itself"),
        case("include_gone.xml", with("<include file=\"gone.xml\"/>"), "\"gone.xml\" does not exist"),
        case("include_out.xml", with("<include file=\"/etc/passwd\"/>"), "outside the project folder"),
        case("mesh_out.xml", with("<asset><mesh name=\"m\" file=\"../../../../etc/passwd\"/></asset>"), "outside the project folder"),
    ]
}

fn urdf(links_and_joints: &str) -> String {
    format!("<robot name=\"r\">\n{links_and_joints}\n</robot>")
}

const LINKS: &str = "<link name=\"a\"/>\n<link name=\"b\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>";

fn urdf_joint(kind: &str, parent: &str, child: &str, rest: &str) -> String {
    format!(
        "<joint name=\"j\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/>{rest}</joint>"
    )
}

fn urdf_cases() -> Vec<Case> {
    let limit = "<limit lower=\"-1\" upper=\"1\" effort=\"5\" velocity=\"1\"/>";
    let one = |rest: &str| urdf(&format!("{LINKS}\n{}", urdf_joint("revolute", "a", "b", rest)));
    vec![
        case("no_links.urdf", "<robot name=\"r\"/>", "no link"),
        case("xacro.urdf", "<robot name=\"r\" xmlns:xacro=\"http://www.ros.org/wiki/xacro\"><xacro:macro name=\"m\"/></robot>", "xacro"),
        case("loop.urdf", urdf(&format!("{LINKS}\n{}\n{}", urdf_joint("revolute", "a", "b", limit), urdf_joint("revolute", "b", "a", limit).replace("\"j\"", "\"k\""))), "every link has a parent"),
        case("two_parents.urdf", urdf(&format!("{LINKS}<link name=\"c\"/>\n{}\n{}", urdf_joint("revolute", "a", "b", limit), urdf_joint("revolute", "c", "b", limit).replace("\"j\"", "\"k\""))), "two parents"),
        case("two_trees.urdf", urdf(&format!("{LINKS}<link name=\"c\"/>\n{}", urdf_joint("revolute", "a", "b", limit))), "one root"),
        case("no_link.urdf", urdf(&format!("{LINKS}\n{}", urdf_joint("revolute", "a", "z", limit))), "\"z\", which is not there"),
        case("same_link.urdf", urdf(&format!("{LINKS}<link name=\"a\"/>\n{}", urdf_joint("revolute", "a", "b", limit))), "two links are called \"a\""),
        case("limits.urdf", one("<limit lower=\"1\" upper=\"-1\" effort=\"5\" velocity=\"1\"/>"), "above upper limit"),
        case("axis.urdf", one(&format!("{limit}<axis xyz=\"0 0 0\"/>")), "axis is 0 0 0"),
        case("mimic.urdf", one(&format!("{limit}<mimic joint=\"ghost\"/>")), "mimics \"ghost\""),
        case("floating.urdf", urdf(&format!("{LINKS}\n{}", urdf_joint("floating", "a", "b", ""))), "--fixed-base"),
        case("package.urdf", urdf(&format!("{}\n{}", LINKS.replace("<link name=\"a\"/>", "<link name=\"a\"><visual><geometry><mesh filename=\"package://nowhere/a.stl\"/></geometry></visual></link>"), urdf_joint("revolute", "a", "b", limit))), "--package nowhere=DIR"),
    ]
}

/// Runs `robert import` under the memory limit; gives exit code, stderr and processor time.
fn refuse(dir: &Path, file: &str) -> (Option<i32>, String, Duration) {
    let script = format!("ulimit -v {MEMORY_KB}; \"$0\" \"$@\"; code=$?; times; exit $code");
    let out = Command::new("sh")
        .args(["-c", &script])
        .arg(binary())
        .args(["import", file, "--out", &format!("{file}.out")])
        .current_dir(dir)
        .stdin(Stdio::null())
        .env("NO_COLOR", "1")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stdout);
    // The last line has the times of the shell's children, in user code and in the kernel: 0m0.21s 0m0.05s.
    let seconds = |word: &str| {
        let (minutes, rest) = word.split_once('m').unwrap();
        let rest: f64 = rest.trim_end_matches('s').parse().unwrap();
        60.0 * minutes.parse::<f64>().unwrap() + rest
    };
    let took = said.lines().last().unwrap().split(' ').map(seconds).sum();
    let stderr = String::from_utf8_lossy(&out.stderr).into_owned();
    (out.status.code(), stderr, Duration::from_secs_f64(took))
}

#[test]
fn eighty_eight_broken_models_get_their_errors() {
    let cases: Vec<Case> = mjcf_cases().into_iter().chain(urdf_cases()).collect();
    assert!(cases.len() >= 88, "{}", cases.len());
    let dir = tempfile::tempdir().unwrap();
    let (next, wrong) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|s| {
        for _ in 0..2 {
            s.spawn(|| {
                while let Some(c) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    std::fs::write(dir.path().join(c.name), &c.text).unwrap();
                    let (code, stderr, time) = refuse(dir.path(), c.name);
                    let message = stderr.lines().find(|l| l.starts_with("error: ")).unwrap_or("");
                    let good = code == Some(3)
                        && message.contains(c.says)
                        && message.contains(c.name)
                        && !dir.path().join(format!("{}.out", c.name)).exists()
                        && time < PATIENCE;
                    if !good {
                        wrong.lock().unwrap().push(format!(
                            "{}: code {code:?} in {time:?}, wanted \"{}\", got {}",
                            c.name,
                            c.says,
                            stderr.trim()
                        ));
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), cases.len(), wrong.join("\n"));
    assert!(!dir.path().join("MUJOCO_LOG.TXT").exists());
}

/// One or two edits of a sound model: bytes changed, removed, doubled; numbers made wild.
fn mutate(text: &str, rng: &mut Rng) -> Vec<u8> {
    const WILD: [&str; 12] = [
        "nan",
        "-1",
        "0",
        "1e308",
        "1e-308",
        "inf",
        "99999999999",
        "",
        "-0",
        "1 2 3 4 5 6 7",
        "\"",
        "&",
    ];
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=rng.below(2) {
        let at = rng.below(bytes.len() as u64) as usize;
        match rng.below(5) {
            0 => bytes[at] = (rng.next_u64() & 0xff) as u8,
            1 => {
                let end = (at + 1 + rng.below(40) as usize).min(bytes.len());
                bytes.drain(at..end);
            }
            2 => {
                let end = (at + 1 + rng.below(200) as usize).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
            _ => {
                // The value between the next two quotes.
                let quote =
                    |from: usize| bytes[from..].iter().position(|b| *b == b'"').map(|n| from + n);
                if let Some((a, b)) = quote(at).and_then(|a| Some((a, quote(a + 1)?))) {
                    let wild = WILD[rng.below(WILD.len() as u64) as usize];
                    bytes.splice(a + 1..b, wild.bytes());
                }
            }
        }
        if bytes.is_empty() {
            break;
        }
    }
    bytes
}

/// `ROBERT_MODELS` models (500 if not said) from number `ROBERT_MODELS_FROM` on. `ROBERT_CHECKER`
/// may name a faster build of the program that checks them in a child.
#[test]
fn five_hundred_mutations_kill_nothing() {
    let asked = |name: &str| std::env::var(name).ok().and_then(|n| n.parse().ok());
    let (count, from) = (asked("ROBERT_MODELS").unwrap_or(500), asked("ROBERT_MODELS_FROM"));
    let from: usize = from.unwrap_or(0);
    let checker = std::env::var_os("ROBERT_CHECKER");
    let checker = checker.map_or_else(|| binary().to_owned(), PathBuf::from);
    let sources: Vec<String> = ["ur5e", "shadow_hand", "pointmass"]
        .iter()
        .map(|id| Robot::builtin(id).unwrap().mjcf().to_owned())
        .chain([
            with("<include file=\"part.xml\"/>"),
            urdf(&format!(
                "{LINKS}\n{}",
                urdf_joint(
                    "revolute",
                    "a",
                    "b",
                    "<limit lower=\"-1\" upper=\"1\" effort=\"5\" velocity=\"1\"/>"
                )
            )),
        ])
        .collect();
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("part.xml"), "<mujocoinclude/>").unwrap();
    let (next, slowest) = (AtomicUsize::new(from), Mutex::new((Duration::ZERO, 0)));
    let (taken, refused, dead) = (AtomicUsize::new(0), AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|s| {
        for _ in 0..2 {
            s.spawn(|| {
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    if k >= from + count {
                        break;
                    }
                    let mut rng = Rng::new(2, Stream::Test, k as u64);
                    let bytes = mutate(&sources[k % sources.len()], &mut rng);
                    let source = dir.path().join(format!("m{k}.xml"));
                    std::fs::write(&source, &bytes).unwrap();
                    let out = dir.path().join(format!("out{k}"));
                    let config = ImportConfig {
                        effort: Some(10.0),
                        servos: Servos::Torque,
                        ..ImportConfig::new(source, out, &checker)
                    };
                    let start = Instant::now();
                    let made = import(&config);
                    let mut slowest = slowest.lock().unwrap();
                    *slowest = (*slowest).max((start.elapsed(), k));
                    drop(slowest);
                    std::fs::remove_file(&config.source).unwrap();
                    if made.is_ok() {
                        std::fs::remove_dir_all(&config.out).unwrap();
                    }
                    match made {
                        Ok(_) => taken.fetch_add(1, Ordering::Relaxed),
                        Err(Error::Exhausted { what, .. }) => {
                            dead.lock().unwrap().push(format!("mutation {k}: {what}"));
                            0
                        }
                        Err(Error::NoChecker { message }) => panic!("{message}"),
                        Err(_) => refused.fetch_add(1, Ordering::Relaxed),
                    };
                }
            });
        }
    });
    let (taken, refused) = (taken.into_inner(), refused.into_inner());
    let dead = dead.into_inner().unwrap();
    println!("{taken} taken, {refused} refused, slowest {:?}", slowest.into_inner().unwrap());
    assert!(dead.is_empty(), "{dead:?}");
    assert_eq!(taken + refused, count);
    // Both ends must be exercised, or the mutations are too wild or too tame.
    let share = |n: usize| 1000 * n / count;
    assert!(share(taken) > 60 && share(refused) > 300, "{taken} taken, {refused} refused");
}
