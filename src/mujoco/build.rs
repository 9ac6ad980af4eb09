//! Compiles the C++ shim over `MuJoCo` and links the library.

use std::path::Path;

const HEADER: &str = "/usr/include/mujoco/mujoco.h";

fn main() {
    println!("cargo::rerun-if-changed=shim.cc");
    println!("cargo::rerun-if-changed=shim.h");
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
    build.cpp(true).std("c++17").file("shim.cc").flag_if_supported("-Wno-unused-parameter");
    if let Some(dir) = include {
        build.include(dir);
    }
    build.compile("robert_mujoco_shim");
    println!("cargo::rustc-link-lib=mujoco");
}
