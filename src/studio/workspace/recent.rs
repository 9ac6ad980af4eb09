//! Recently opened clips, in the state folder.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use crate::protocol::RecentFile;
use robert_base::fsio;
use robert_base::limits;
use robert_clip::Clip;

/// The list; the newest first.
#[derive(Debug)]
pub(crate) struct Recent {
    path: PathBuf,
    files: Mutex<Vec<RecentFile>>,
}

impl Recent {
    /// Reads the list of the last runs. A damaged list counts as empty.
    pub(crate) fn load(state_dir: &Path) -> Recent {
        let path = state_dir.join("recent.json");
        let files = Mutex::new(read(&path).unwrap_or_default());
        Recent { path, files }
    }

    /// A clip was opened or saved here.
    pub(crate) fn opened(&self, path: &Path, clip: &Clip) {
        let Some(text) = path.to_str() else { return };
        let file = RecentFile {
            path: text.to_owned(),
            name: clip.name.clone(),
            robot: clip.robot.id.clone(),
            opened_secs: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()),
            exists: true,
        };
        let json = {
            let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
            // Another studio may have written since.
            if let Some(known) = read(&self.path) {
                *files = known;
            }
            files.retain(|f| f.path != file.path);
            files.insert(0, file);
            files.truncate(limits::RECENT);
            serde_json::to_vec_pretty(&*files)
        };
        if let Ok(json) = json
            && let Err(e) = fsio::write_atomic(&self.path, &json)
        {
            tracing::warn!("the list of recent files was not kept: {e}");
        }
    }

    /// The list as it is now.
    pub(crate) fn list(&self) -> Vec<RecentFile> {
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner).clone();
        for file in &mut files {
            file.exists = Path::new(&file.path).is_file();
        }
        files
    }
}

/// The folder for files that belong to no clip: `ROBERT_STATE_DIR`, else the desktop's usual place.
pub fn state_dir() -> PathBuf {
    let var = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    if let Some(dir) = var("ROBERT_STATE_DIR") {
        return dir;
    }
    var("XDG_STATE_HOME")
        .or_else(|| var("HOME").map(|home| home.join(".local/state")))
        .unwrap_or_else(std::env::temp_dir)
        .join("robert")
}

fn read(path: &Path) -> Option<Vec<RecentFile>> {
    serde_json::from_slice(&fsio::read_capped(path, 1 << 20).ok()?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_clip::RobotRef;

    #[test]
    fn newest_first_and_each_once() {
        let dir = tempfile::tempdir().unwrap();
        let recent = Recent::load(dir.path());
        let clip = Clip::new(RobotRef::default(), 10);
        for name in ["/a", "/b", "/a"] {
            recent.opened(Path::new(name), &clip);
        }
        let names: Vec<String> =
            Recent::load(dir.path()).list().into_iter().map(|f| f.path).collect();
        assert_eq!(names, ["/a", "/b"]);
        for n in 0..=limits::RECENT {
            recent.opened(Path::new(&format!("/{n}")), &clip);
        }
        let files = Recent::load(dir.path()).list();
        assert_eq!((files.len(), files.last().unwrap().path.as_str()), (limits::RECENT, "/1"));
        std::fs::write(dir.path().join("recent.json"), b"{").unwrap();
        assert!(Recent::load(dir.path()).list().is_empty());
    }
}
