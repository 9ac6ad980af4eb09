//! Takes through the binary: rollout --out, export, parity, damage.

use crate::run::robert;

const CLIP: &str = "ur5e/reacher";

fn take(policy: &str) -> crate::run::Ran {
    robert()
        .args(["rollout", CLIP, "--policy", policy, "--seed", "5", "--out", "a.mcap", "--json"])
        .succeeds()
}

#[test]
fn the_same_clip_twice_is_the_same_file() {
    let (a, b) = (take("pd"), take("pd"));
    let (x, y) = (a.json(), b.json());
    assert_eq!(x["precision"], y["precision"]);
    assert_eq!(x["per_frame"], y["per_frame"]);
    let read = |ran: &crate::run::Ran| std::fs::read(ran.path("a.mcap")).unwrap();
    assert!(read(&a) == read(&b), "the takes differ");
}

/// Rollout, take, command exported, imported, rolled out again: the same Precision.
#[test]
fn parity_over_export_and_import() {
    let first = take("computed-torque");
    let want = first.json()["precision"].as_f64().unwrap();
    let mcap = std::fs::read(first.path("a.mcap")).unwrap();
    for (format, name) in
        [("csv", "c.csv"), ("mjcf", "c.xml"), ("ros", "c.yaml"), ("json", "c.json")]
    {
        let exported = robert()
            .file("a.mcap", &mcap)
            .args(["export", "a.mcap", "--to", format, "--what", "command", "-o", name, "--json"])
            .succeeds();
        let report = exported.json();
        assert!((report["precision"].as_f64().unwrap() - want).abs() <= 1e-9, "{format}: take");
        let text = std::fs::read(exported.path(name)).unwrap();
        let back = robert()
            .file(name, &text)
            .args(["clip", "convert", name, "back.clip.json", "--robot", "ur5e"])
            .succeeds();
        let clip = std::fs::read(back.path("back.clip.json")).unwrap();
        let again = robert()
            .file("back.clip.json", clip)
            .args([
                "rollout",
                "back.clip.json",
                "--policy",
                "computed-torque",
                "--seed",
                "5",
                "--json",
            ])
            .succeeds();
        let got = again.json()["precision"].as_f64().unwrap();
        assert!((got - want).abs() <= 1e-9, "{format}: {got} {want}");
    }
}

#[test]
fn a_clip_is_performed_and_a_take_is_not() {
    let ran = robert().args(["export", CLIP, "--policy", "pd", "--to", "csv"]).succeeds();
    let rows: Vec<&str> = ran.stdout.lines().collect();
    assert!(rows[0].starts_with("frame,time,mask,"));
    assert!(rows.len() > 20);
    let first = take("pd");
    let mcap = std::fs::read(first.path("a.mcap")).unwrap();
    let same = robert().file("b.mcap", &mcap).args(["export", "b.mcap", "--to", "csv"]).succeeds();
    // The seed does not matter to pd.
    assert_eq!(same.stdout, ran.stdout);
    let copy = robert()
        .file("b.mcap", &mcap)
        .args(["export", "b.mcap", "--to", "mcap", "-o", "c.mcap"])
        .succeeds();
    assert!(std::fs::read(copy.path("c.mcap")).unwrap() == mcap, "a take copied is another take");
}

#[test]
fn damage_is_named_and_recovered() {
    let first = take("pd");
    let mcap = std::fs::read(first.path("a.mcap")).unwrap();
    let cut = &mcap[..mcap.len() * 9 / 10];
    let ran = robert().file("a.mcap", cut).args(["export", "a.mcap", "--to", "csv"]).fails(3);
    assert!(ran.stderr.contains("a.mcap: byte "), "{}", ran.stderr);
    let mut flipped = mcap.clone();
    flipped[mcap.len() / 2] ^= 0x40;
    let ran = robert().file("a.mcap", &flipped).args(["export", "a.mcap", "--to", "csv"]).fails(3);
    assert!(ran.stderr.contains("a.mcap: byte "), "{}", ran.stderr);
    // Within the closing records all frames are there.
    let tail = &mcap[..mcap.len() - 20];
    robert().file("a.mcap", tail).args(["export", "a.mcap", "--to", "csv"]).fails(3);
    let ran = robert()
        .file("a.mcap", tail)
        .args(["export", "a.mcap", "--to", "csv", "--recover"])
        .succeeds();
    let whole = robert().file("a.mcap", &mcap).args(["export", "a.mcap", "--to", "csv"]).succeeds();
    assert_eq!(ran.stdout, whole.stdout);
    let ran =
        robert().file("a.mcap", "not a take").args(["export", "a.mcap", "--to", "csv"]).fails(3);
    assert!(ran.stderr.contains("not an MCAP"), "{}", ran.stderr);
    robert().args(["export", "none.mcap", "--to", "csv"]).fails(3);
}

#[test]
fn recordings_and_pages() {
    let first = take("pd");
    let mcap = std::fs::read(first.path("a.mcap")).unwrap();
    let ran = robert().file("a.mcap", &mcap).args(["export", "a.mcap", "--to", "viser"]).succeeds();
    let bytes = std::fs::read(ran.path("a.viser")).unwrap();
    let inner = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    assert_eq!(zstd::bulk::decompress(&bytes[8..], inner).unwrap().len(), inner);
    let ran = robert()
        .file("a.mcap", &mcap)
        .file("client.html", "<html><head></head><body></body></html>")
        .args(["export", "a.mcap", "--to", "html", "--viser-client", "client.html", "-o", "p.html"])
        .succeeds();
    let page = std::fs::read_to_string(ran.path("p.html")).unwrap();
    assert!(page.contains("__VISER_EMBED_DATA__") && page.len() > bytes.len());
    // Of another robot nothing can be drawn.
    let ran = robert()
        .file("a.mcap", &mcap)
        .args(["export", "a.mcap", "--to", "viser", "--robot", "pointmass"])
        .fails(3);
    assert!(ran.stderr.contains("ur5e"), "{}", ran.stderr);
    robert().args(["export", CLIP, "--to", "mcap", "--what", "command"]).fails(2);
}
