//! Warns if the page that goes into the program is older than its source.

use std::path::Path;
use std::time::SystemTime;

/// npm bundles the page, and the bundle goes into the program as it is. An old bundle with new
/// server code would behave in ways that nobody can explain.
fn main() {
    println!("cargo::rerun-if-changed=../../ui/src");
    println!("cargo::rerun-if-changed=../../ui/dist");
    let bundled = std::fs::metadata("../../ui/dist/app.js").and_then(|m| m.modified());
    if let (Ok(bundled), Some(written)) = (bundled, newest(Path::new("../../ui/src")))
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
