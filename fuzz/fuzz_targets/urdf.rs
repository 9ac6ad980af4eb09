//! Robots: everything that reads a URDF or an MJCF before the simulator does.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use robert_robot::import::{self, ImportConfig};

/// A file in memory, if there is such a folder; one for each process.
static SOURCE: LazyLock<PathBuf> = LazyLock::new(|| {
    let shm = PathBuf::from("/dev/shm");
    let folder = if shm.is_dir() { shm } else { std::env::temp_dir() };
    let folder = folder.join(format!("robert-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder.join("robot.urdf")
});

fuzz_target!(|bytes: &[u8]| {
    std::fs::write(&*SOURCE, bytes).unwrap();
    let out = SOURCE.with_file_name("out");
    let config = ImportConfig { fixed_base: true, ..ImportConfig::new(&*SOURCE, out, "") };
    if let Ok(xml) = import::draft(&config) {
        robert_base::xml::parse(&xml, robert_base::limits::XML_ELEMENTS).expect("the draft is XML");
    }
});
