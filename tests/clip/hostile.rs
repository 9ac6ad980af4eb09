//! Clips that mean harm or make no sense: each is refused with file, line and column, in
//! under a second and with less than 256 MB of address space above an empty run's.

use std::process::Command;

use crate::run::binary;

const HEAD: &str = "\"format\": \"robert-clip/1\",\n\"robot\": {\"id\": \"r\", \"joints\": [\"a\", \"b\"]},\n\"fps\": 20, \"length\": 100";

fn with(rest: &str) -> String {
    format!("{{{HEAD},\n{rest}\n}}\n")
}

fn keys(keys: &str) -> String {
    with(&format!("\"keys\": [{keys}]"))
}

/// Name, bytes, where it must be refused.
fn cases() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let t = |name, text: String, place| (name, text.into_bytes(), place);
    let many = |n: usize, item: &str| vec![item; n].join(",");
    vec![
        t("empty file", String::new(), "1:1"),
        t("not JSON", "clip".into(), "1:1"),
        t("wrong top", "[]".into(), "1:1"),
        t("cut off", format!("{{{HEAD}, \"keys\": ["), "3:36"),
        t("trailing text", format!("{{{HEAD}, \"keys\": []}}\nx"), "4:1"),
        t("byte order mark", format!("\u{feff}{{{HEAD}, \"keys\": []}}"), "1:1"),
        ("not UTF-8", b"{\n \"format\": \"\xff\"}".to_vec(), "2:13"),
        ("NUL bytes", vec![0; 1000], "1:1"),
        t("newer major", "{\"future\": 1,\n \"format\": \"robert-clip/2\"}".into(), "2:12"),
        t("other format", "{\"format\": \"bvh\"}".into(), "1:12"),
        t("unknown key", with("\"keys\": [], \"colour\": 1"), "4:13"),
        t("unknown key in a key", keys("{\"frame\": 1, \"q\": [0, 0], \"ease\": 1}"), "4:36"),
        t(
            "unknown key in the robot",
            "{\"format\": \"robert-clip/1\", \"robot\": {\"id\": \"r\", \"dof\": 2}}".into(),
            "1:50",
        ),
        t("key twice in an object", with("\"keys\": [], \"keys\": []"), "4:13"),
        t("missing keys", format!("{{{HEAD}}}"), "1:1"),
        t("missing frame", keys("{\"q\": [0, 0]}"), "4:10"),
        t("pose and q", keys("{\"frame\": 1, \"q\": [0, 0], \"pose\": \"p\"}"), "4:10"),
        t("neither pose nor q", keys("{\"frame\": 1}"), "4:10"),
        t("negative frame", keys("{\"frame\": -1, \"q\": [0, 0]}"), "4:20"),
        t("frame beyond the end", keys("{\"frame\": 100, \"q\": [0, 0]}"), "4:20"),
        t("frame beyond 32 bits", keys("{\"frame\": 99999999999999999999, \"q\": [0, 0]}"), "4:20"),
        t("broken frame", keys("{\"frame\": 1.5, \"q\": [0, 0]}"), "4:20"),
        t("frame as text", keys("{\"frame\": \"1\", \"q\": [0, 0]}"), "4:20"),
        t(
            "two keys on a frame",
            keys("{\"frame\": 1, \"q\": [0, 0]},\n{\"frame\": 1, \"q\": [0, 0]}"),
            "5:11",
        ),
        t("row too short", keys("{\"frame\": 1, \"q\": [0]}"), "4:28"),
        t("row too long", keys("{\"frame\": 1, \"q\": [0, 0, 0]}"), "4:28"),
        t("row of nothing", keys("{\"frame\": 1, \"q\": [null, null]}"), "4:28"),
        t("NaN", keys("{\"frame\": 1, \"q\": [0, NaN]}"), "4:32"),
        t("infinity", keys("{\"frame\": 1, \"q\": [0, -Infinity]}"), "4:32"),
        t("1e999", keys("{\"frame\": 1, \"q\": [0, 1e999]}"), "4:32"),
        t("1e308", keys("{\"frame\": 1, \"q\": [0, 1e308]}"), "4:32"),
        t(
            "a million digits",
            keys(&format!("{{\"frame\": 1, \"q\": [0, {}]}}", "9".repeat(1_000_000))),
            "4:32",
        ),
        t("hold of nothing", keys("{\"frame\": 1, \"q\": [0, 0], \"hold\": 0}"), "4:44"),
        t("hold for ever", keys("{\"frame\": 1, \"q\": [0, 0], \"hold\": 4000000000}"), "4:44"),
        t("unknown fill", keys("{\"frame\": 1, \"q\": [0, 0], \"fill\": \"spline\"}"), "4:44"),
        t("unknown pose", keys("{\"frame\": 1, \"pose\": \"gnu\"}"), "4:31"),
        t("wrong rate", format!("{{{}, \"keys\": []}}", HEAD.replace("20", "30")), "3:8"),
        t("no frames", format!("{{{}, \"keys\": []}}", HEAD.replace("100", "0")), "3:22"),
        t(
            "too many frames",
            format!("{{{}, \"keys\": []}}", HEAD.replace("100", "100001")),
            "3:22",
        ),
        t("no joints", format!("{{{}, \"keys\": []}}", HEAD.replace("\"a\", \"b\"", "")), "2:32"),
        t("joint twice", format!("{{{}, \"keys\": []}}", HEAD.replace("\"b\"", "\"a\"")), "2:38"),
        t(
            "10,000 joints",
            format!("{{{}, \"keys\": []}}", HEAD.replace("\"b\"", &many(10_000, "\"b\""))),
            "2:1058",
        ),
        t(
            "escape sequence in a name",
            format!("{{{}, \"keys\": []}}", HEAD.replace("\"a\"", "\"\\u001b[2J\"")),
            "2:33",
        ),
        t(
            "bad hash",
            format!(
                "{{{}, \"keys\": []}}",
                HEAD.replace("\"r\"", "\"r\", \"model_sha256\": \"xyz\"")
            ),
            "2:38",
        ),
        t(
            "units for half",
            format!("{{{}, \"keys\": []}}", HEAD.replace("\"r\"", "\"r\", \"units\": [\"rad\"]")),
            "2:31",
        ),
        t("falling mask", with("\"keys\": [], \"masks\": [{\"from\": 9, \"to\": 3}]"), "4:23"),
        t(
            "mask beyond the end",
            with("\"keys\": [], \"masks\": [{\"from\": 9, \"to\": 101}]"),
            "4:23",
        ),
        t(
            "mask of a stranger",
            with("\"keys\": [], \"masks\": [{\"from\": 9, \"to\": 11, \"joints\": [\"c\"]}]"),
            "4:56",
        ),
        t(
            "mask of nobody",
            with("\"keys\": [], \"masks\": [{\"from\": 9, \"to\": 11, \"joints\": []}]"),
            "4:55",
        ),
        t(
            "marker beyond the end",
            with("\"keys\": [], \"markers\": [{\"frame\": 100, \"name\": \"m\"}]"),
            "4:35",
        ),
        t(
            "marker without a name",
            with("\"keys\": [], \"markers\": [{\"frame\": 1, \"name\": \"\"}]"),
            "4:46",
        ),
        t("start with a hole", with("\"keys\": [], \"start\": {\"q\": [0, null]}"), "4:32"),
        t("start from nowhere", with("\"keys\": [], \"start\": {\"pose\": \"p\"}"), "4:31"),
        t("half a surrogate", with("\"keys\": [], \"name\": \"\\ud800\""), "4:22"),
        t("line break in a string", with("\"keys\": [], \"name\": \"a\nb\""), "4:23"),
        t(
            "a 300 byte name",
            with(&format!("\"keys\": [], \"name\": \"{}\"", "n".repeat(300))),
            "4:21",
        ),
        t(
            "depth 100,000",
            with(&format!("\"keys\": [], \"x\": {{\"d\": {}", "[".repeat(100_000))),
            "4:86",
        ),
        t("depth by objects", "{\"x\":".repeat(200_000), "1:321"),
        t(
            "ten million values",
            with(&format!("\"keys\": [], \"x\": {{\"d\": [{}]}}", many(5_000_000, "0"))),
            "4:200023",
        ),
        t("60,000 keys", keys(&many(60_000, "{\"frame\": 1, \"q\": [0, 0]}")), "4:1300010"),
        t(
            "a row of millions",
            keys(&format!("{{\"frame\": 1, \"q\": [{}]}}", many(5_000_000, "0"))),
            "4:541",
        ),
        t(
            "a million masks",
            with(&format!(
                "\"keys\": [], \"masks\": [{}]",
                many(500_000, "{\"from\": 0, \"to\": 1}")
            )),
            "4:1050023",
        ),
        t(
            "joint names without end",
            with(&format!(
                "\"keys\": [], \"masks\": [{}]",
                many(
                    20_000,
                    &format!("{{\"from\": 0, \"to\": 1, \"joints\": [{}]}}", many(100, "\"a\""))
                )
            )),
            "4",
        ),
        t("a string without end", format!("{{\"format\": \"{}", "x".repeat(15_000_000)), "1:12"),
        t(
            "poses without end",
            with(&format!(
                "\"keys\": [], \"poses\": {{{}}}",
                (0..20_000).map(|i| format!("\"{i}\": [0, 0]")).collect::<Vec<_>>().join(",")
            )),
            "4:",
        ),
    ]
}

#[test]
fn hostile_clips_are_refused_with_their_place() {
    let dir = tempfile::tempdir().unwrap();
    let cases = cases();
    assert!(cases.len() >= 40, "{}", cases.len());
    let mut wrong = Vec::new();
    for (name, bytes, place) in cases {
        std::fs::write(dir.path().join("h.clip.json"), bytes).unwrap();
        // ulimit counts kilobytes of address space, program and libraries included, and seconds
        // of processor time: those of the clock would judge the machine's other work.
        let ran = Command::new("sh")
            .args(["-c", "ulimit -v 262144 && ulimit -t 1 && exec \"$0\" clip check h.clip.json"])
            .arg(binary())
            .current_dir(dir.path())
            .output()
            .unwrap();
        let stderr = String::from_utf8_lossy(&ran.stderr);
        let expect = format!("error: h.clip.json:{place}");
        let ends = place.ends_with(':')
            || !place.contains(':')
            || stderr.starts_with(&format!("{expect}: "));
        if ran.status.code() != Some(3) || !stderr.starts_with(&expect) || !ends {
            wrong.push(format!(
                "{name}: exit {:?}, {}",
                ran.status.code(),
                &stderr[..stderr.len().min(300)]
            ));
        }
        if stderr.len() > 1000 || stderr.lines().count() > 1 {
            wrong.push(format!("{name}: a message of {} bytes", stderr.len()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_file_beyond_the_cap_is_not_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("big.clip.json");
    let file = std::fs::File::create(&path).unwrap();
    file.set_len(robert::limits::CLIP_BYTES + 1).unwrap();
    let e = robert::clip::load(&path).unwrap_err().to_string();
    assert!(e.contains("16777217 bytes"), "{e}");
}

/// Each cap holds at its value and one beyond it.
#[test]
fn caps_are_exact() {
    use robert::clip::*;
    use robert::limits::*;
    let clip = |joints: usize, length: u32| {
        let joints = (0..joints).map(|j| j.to_string()).collect();
        Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, length)
    };
    let ok = |c: &Clip| c.validate().is_ok();
    assert!(ok(&clip(JOINTS, 10)) && !ok(&clip(JOINTS + 1, 10)));
    assert!(ok(&clip(1, CLIP_FRAMES)) && !ok(&clip(1, CLIP_FRAMES + 1)));
    let cells = (CLIP_VALUES / 64) as u32;
    assert!(ok(&clip(64, cells)) && !ok(&clip(64, cells + 1)));
    let mut c = clip(1, CLIP_FRAMES);
    c.keys = (0..CLIP_KEYS as u32).map(|f| Key::new(f, &[0.0])).collect();
    assert!(ok(&c));
    c.keys.push(Key::new(CLIP_KEYS as u32, &[0.0]));
    assert!(!ok(&c));
    let mut c = clip(1, 10);
    c.name = "n".repeat(NAME_BYTES);
    c.notes = "n".repeat(NOTES_BYTES);
    assert!(ok(&c));
    c.notes.push('n');
    assert!(!ok(&c));
    c.notes.clear();
    c.name.push('n');
    assert!(!ok(&c));
    let mut c = clip(1, 10);
    c.keys = vec![Key::new(0, &[CLIP_VALUE_MAX])];
    assert!(ok(&c));
    c.keys = vec![Key::new(0, &[CLIP_VALUE_MAX * (1.0 + 1e-12)])];
    assert!(!ok(&c));
    let mut c = clip(1, 10);
    c.poses = (0..CLIP_POSES).map(|i| (i.to_string(), vec![Some(0.0)])).collect();
    assert!(ok(&c));
    c.poses.insert("more".into(), vec![Some(0.0)]);
    assert!(!ok(&c));
    let mut c = clip(1, CLIP_FRAMES);
    c.markers =
        (0..CLIP_SPANS as u32).map(|f| Marker { frame: f, name: "m".into(), to: None }).collect();
    assert!(ok(&c));
    c.markers.push(Marker { frame: CLIP_SPANS as u32, name: "m".into(), to: None });
    assert!(!ok(&c));
}

/// The same for what belongs to keys, offsets and masks, and for batches.
#[test]
fn caps_of_the_parts_of_keys_are_exact() {
    use robert::clip::*;
    use robert::limits::*;
    let names: Vec<String> = (0..JOINTS).map(|j| j.to_string()).collect();
    let wide = |length: u32| {
        Clip::new(RobotRef { id: "r".into(), joints: names.clone(), ..RobotRef::default() }, length)
    };
    let ok = |c: &Clip| c.validate().is_ok();
    let row = vec![0.0; JOINTS];

    let mut c = wide(2000);
    let full = (CLIP_TANGENTS / JOINTS) as u32;
    c.keys = (0..=full).map(|f| Key::new(f, &row)).collect();
    for key in &mut c.keys[..full as usize] {
        key.tangents = names.iter().map(|n| (n.clone(), Tangent::FLAT)).collect();
    }
    assert!(ok(&c));
    c.keys[full as usize].tangents.insert("0".into(), Tangent::FLAT);
    assert!(!ok(&c));

    let offset = |frame: u32, joints: &[String]| Offset {
        frame,
        add: joints.iter().map(|n| (n.clone(), 0.1)).collect(),
        fade_in: 0,
        hold: 1,
        fade_out: 0,
    };
    let mut c = wide(2000);
    let full = (CLIP_OFFSETS / JOINTS) as u32;
    c.offsets = (0..full).map(|f| offset(f, &names)).collect();
    assert!(ok(&c));
    c.offsets.push(offset(full, &names[..1]));
    assert!(!ok(&c));

    let mut c = wide(2000);
    let mask = |joints: &[String]| Mask { from: 0, to: 1, joints: Some(joints.to_vec()) };
    c.masks = (0..CLIP_MASK_JOINTS / JOINTS).map(|_| mask(&names)).collect();
    assert!(ok(&c));
    c.masks.push(mask(&names[..1]));
    assert!(!ok(&c));

    // End-effector goals, and the frames of a straight path between two of them.
    let goal = |frame: u32| {
        let mut key = Key::with(frame, Goal::Open);
        key.reach = vec![Reach::site("tool", [0.1, 0.2, 0.3])];
        key
    };
    let mut c = wide(CLIP_REACHES as u32 + 1);
    c.fill = Fill::Mask;
    c.keys = (0..CLIP_REACHES as u32).map(goal).collect();
    assert!(ok(&c));
    c.keys.push(goal(CLIP_REACHES as u32));
    assert!(!ok(&c));
    let path = |last: u32| {
        let mut c = wide(CLIP_REACH_FRAMES as u32 + 10);
        c.fill = Fill::Linear;
        c.keys = vec![goal(0), goal(last)];
        ok(&c)
    };
    assert!(path(CLIP_REACH_FRAMES as u32 - 1) && !path(CLIP_REACH_FRAMES as u32));

    let rename = Op::ClipRename(ClipRename { name: "n".into() });
    let batch = |n: usize| {
        let op = Op::Batch(Batch { label: String::new(), ops: vec![rename.clone(); n] });
        edited(&wide(10), &op, None).is_ok()
    };
    assert!(batch(BATCH_OPS) && !batch(BATCH_OPS + 1));

    let extra = |n: usize| {
        let clip = wide(10).to_text();
        let list = format!("\"x\": {{\"a\": [{}]}},\n  \"keys\"", vec!["0"; n].join(","));
        Clip::parse(&clip.replacen("\"keys\"", &list, 1)).is_ok()
    };
    // The list itself is a value.
    assert!(extra(CLIP_EXTRA_VALUES - 1) && !extra(CLIP_EXTRA_VALUES));
}
