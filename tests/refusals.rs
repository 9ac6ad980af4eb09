//! Every refusal names the input that is wrong, so that a person and a script know which of several
//! it is.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::run::binary;
use crate::studio::CLIP;

/// What no reader takes.
const RUBBISH: &[u8] = b"{\"a\": \x01 <";

/// The name that the refusal has to contain, and the command.
const REFUSED: &[(&str, &str)] = &[
    ("bad.clip.json", "rollout bad.clip.json"),
    ("bad.clip.json", "render bad.clip.json -o made.png"),
    ("bad.clip.json", "export bad.clip.json --to csv"),
    ("bad.clip.json", "clip check bad.clip.json"),
    ("bad.clip.json", "clip fmt bad.clip.json"),
    ("bad.clip.json", "clip info bad.clip.json"),
    ("bad.clip.json", "clip upgrade bad.clip.json"),
    ("bad.clip.json", "clip apply bad.clip.json bad.json"),
    ("bad.json", "clip apply good.clip.json bad.json"),
    ("bad.clip.json", "clip diff good.clip.json bad.clip.json"),
    ("bad.clip.json", "clip join good.clip.json bad.clip.json -o made.clip.json"),
    ("bad.csv", "clip convert bad.csv made.clip.json --robot ur5e"),
    ("bad.csv", "clip convert bad.csv made.clip.json --like good.clip.json"),
    ("bad.clip.json", "clip convert good.csv made.clip.json --like bad.clip.json"),
    ("bad.json", "clip convert bad.json made.clip.json --robot ur5e"),
    ("bad.xml", "clip convert bad.xml made.clip.json --robot ur5e"),
    ("bad.yaml", "clip convert bad.yaml made.clip.json --robot ur5e"),
    ("bad.bvh", "clip convert bad.bvh made.clip.json --robot ur5e"),
    ("bad.npz", "clip convert bad.npz made.clip.json --robot ur5e"),
    ("bad.lafan.csv", "clip convert bad.lafan.csv made.clip.json --robot ur5e --fps 30"),
    ("bad.mcap", "clip convert bad.mcap made.clip.json --robot ur5e"),
    ("set/meta/info.json", "clip convert set made.clip.json --robot ur5e"),
    ("bad.mcap", "render bad.mcap -o made.png"),
    ("bad.mcap", "export bad.mcap --to csv"),
    ("data/manifest.json", "dataset info data"),
    ("data/manifest.json", "dataset check data"),
    ("data/manifest.json", "dataset merge data --out made"),
    ("data/manifest.json", "dataset split data --out made"),
    ("data/manifest.json", "train --robot ur5e --data data --preset instant --out made"),
    ("data", "collect --robot ur5e --agent noise --transitions 100 --out data --resume"),
    ("bad.safetensors", "models show bad.safetensors"),
    ("bad.safetensors", "rollout good.clip.json -p robert:bad.safetensors"),
    ("bad.safetensors", "rollout good.clip.json -p ridge:bad.safetensors"),
    ("bad.safetensors", "rollout good.clip.json -p nearest:bad.safetensors"),
    ("bad.safetensors", "rollout good.clip.json -p mlp-inverse:bad.safetensors"),
    ("run/config.toml", "runs show run"),
    ("run/config.toml", "runs compare run run"),
    ("run/config.toml", "train --robot ur5e --data data --resume run"),
    ("bad.toml", "shard plan bad.toml --out made"),
    ("shards/plan.json", "shard status shards"),
    ("shards/plan.json", "shard run shards --index 0"),
    ("shards/plan.json", "shard merge shards --out made"),
    ("robot/profile.toml", "robots show robot"),
    ("robot/profile.toml", "rollout good.clip.json --robot robot"),
    ("robot/profile.toml", "collect --robot robot --agent noise --transitions 100 --out made"),
    ("bad.urdf", "import bad.urdf --out made"),
    ("bad.xml", "import bad.xml --out made"),
    ("bad.urdf", "new bad.urdf --out made"),
    ("bad.clip.json", "studio --no-open --port 0 bad.clip.json"),
];

fn inputs(dir: &Path) {
    let put = |name: &str, bytes: &[u8]| {
        let path = dir.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    };
    put("good.clip.json", CLIP.as_bytes());
    put("good.csv", b"frame,a\n0,0\n");
    for end in ["clip.json", "json", "csv", "lafan.csv", "xml", "yaml", "bvh", "npz", "mcap"] {
        put(&format!("bad.{end}"), RUBBISH);
    }
    for end in ["toml", "safetensors", "urdf"] {
        put(&format!("bad.{end}"), RUBBISH);
    }
    for name in ["set/meta/info.json", "data/manifest.json", "shards/plan.json"] {
        put(name, RUBBISH);
    }
    for name in ["run/config.toml", "robot/profile.toml", "robot/robot.xml"] {
        put(name, RUBBISH);
    }
}

#[test]
fn each_refusal_names_its_input() {
    let dir = tempfile::tempdir().unwrap();
    inputs(dir.path());
    let mut wrong = Vec::new();
    for (name, line) in REFUSED {
        let out = Command::new(binary())
            .args(line.split(' '))
            .current_dir(dir.path())
            .env("NO_COLOR", "1")
            .env("ROBERT_STATE_DIR", dir.path().join("state"))
            .output()
            .unwrap();
        let stderr = String::from_utf8(out.stderr).unwrap();
        let said = stderr.lines().find(|l| l.starts_with("error: ")).unwrap_or("nothing");
        if out.status.code() != Some(3) || !said.contains(name) || stderr.contains("panicked") {
            wrong.push(format!("{line}: {:?}, {stderr}", out.status.code()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(
        !fs::read_dir(dir.path())
            .unwrap()
            .any(|e| { e.unwrap().file_name().to_string_lossy().starts_with("made") })
    );
}
