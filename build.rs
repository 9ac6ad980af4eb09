//! Compiles the C++ shim over `MuJoCo` and links the library.

use std::path::Path;
use std::time::SystemTime;

const HEADER: &str = "/usr/include/mujoco/mujoco.h";

fn main() {
    println!("cargo::rerun-if-changed=src/mujoco/shim.cc");
    println!("cargo::rerun-if-changed=src/mujoco/shim.h");
    println!("cargo::rerun-if-env-changed=MUJOCO_INCLUDE_DIR");
    // docs.rs builds the documentation without MuJoCo; nothing is linked there.
    println!("cargo::rerun-if-env-changed=DOCS_RS");
    if std::env::var_os("DOCS_RS").is_some() {
        return;
    }
    let include = std::env::var_os("MUJOCO_INCLUDE_DIR");
    if include.is_none() && !Path::new(HEADER).exists() {
        println!(
            "cargo::error=MuJoCo 2.2.2 is missing ({HEADER}): sudo apt-get install libmujoco-dev"
        );
        return;
    }
    let mut build = cc::Build::new();
    build
        .cpp(true)
        .std("c++17")
        .file("src/mujoco/shim.cc")
        .flag_if_supported("-Wno-unused-parameter");
    if let Some(dir) = include {
        build.include(dir);
    }
    build.compile("robert_mujoco_shim");
    println!("cargo::rustc-link-lib=mujoco");
    page_is_current();
}

/// The page is bundled by npm and put into the program as it lies there: an old bundle with
/// new server code is a puzzle for whoever runs it.
fn page_is_current() {
    println!("cargo::rerun-if-changed=ui/src");
    println!("cargo::rerun-if-changed=ui/dist");
    let bundled = std::fs::metadata("ui/dist/app.js").and_then(|m| m.modified());
    if let (Ok(bundled), Some(written)) = (bundled, newest(Path::new("ui/src")))
        && written > bundled
    {
        println!("cargo::warning=ui/dist is older than ui/src: npm --prefix ui run build");
    }
}

fn newest(path: &Path) -> Option<SystemTime> {
    let Ok(entries) = std::fs::read_dir(path) else {
        return std::fs::metadata(path).and_then(|m| m.modified()).ok();
    };
    entries.flatten().filter_map(|e| newest(&e.path())).max()
}
