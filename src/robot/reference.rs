//! Where a reference of a model file leads: to a file inside of the project folder.

use std::iter::zip;
use std::path::{Component, Path, PathBuf};

use robert_base::limits;

/// Why a reference leads to no file.
pub(super) enum Unresolved {
    /// The place is allowed, but nothing is there.
    Missing(String),
    /// The reference leads elsewhere, or to what is no file.
    Refused(String),
}

impl From<Unresolved> for String {
    fn from(why: Unresolved) -> Self {
        match why {
            Unresolved::Missing(why) | Unresolved::Refused(why) => why,
        }
    }
}

/// The file that a reference means, inside `root`.
pub(super) fn resolve(dir: &Path, written: &str, root: &Path) -> Result<PathBuf, Unresolved> {
    use Unresolved::{Missing, Refused};
    if written.is_empty() || written.len() > 4096 || written.contains('\0') {
        return Err(Refused("the file name is empty or too long".into()));
    }
    let plain = written.replace('\\', "/");
    let wide = |there: &Path| {
        let whole: PathBuf = zip(root.components(), there.components())
            .take_while(|(a, b)| a == b)
            .map(|(part, _)| part)
            .collect();
        // The root of the disk is no folder of a project.
        let whole = if whole.components().count() > 1 { whole } else { PathBuf::from("DIR") };
        Refused(format!(
            "\"{written}\" is outside the project folder {}; name a folder that contains everything: --root {}",
            root.display(),
            whole.display()
        ))
    };
    let path = dir.join(&plain);
    // Checked before the disk is accessed, so that files outside cannot be probed.
    let dir_abs = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
    let mut lexical = if Path::new(&plain).is_absolute() { PathBuf::new() } else { dir_abs };
    for part in Path::new(&plain).components() {
        match part {
            Component::ParentDir => {
                lexical.pop();
            }
            Component::CurDir => {}
            Component::Prefix(_) => return Err(wide(Path::new(""))),
            Component::RootDir => lexical.push("/"),
            Component::Normal(p) => lexical.push(p),
        }
    }
    if !lexical.starts_with(root) {
        return Err(wide(&lexical));
    }
    let real = path.canonicalize().map_err(|e| match e.kind() {
        std::io::ErrorKind::NotFound => Missing(format!("\"{written}\" does not exist")),
        _ => Refused(format!("\"{written}\" cannot be opened: {e}")),
    })?;
    if !real.starts_with(root) {
        return Err(wide(&real));
    }
    if !real.is_file() {
        return Err(Refused(format!("\"{written}\" is not a file")));
    }
    Ok(real)
}

/// The same reference with the name of a file that differs in upper and lower case only, if there is
/// exactly one in the folder inside `root`, and the folder is not too large.
pub(super) fn in_other_case(dir: &Path, written: &str, root: &Path) -> Option<String> {
    let path = dir.join(written.replace('\\', "/"));
    let name = path.file_name()?.to_str()?;
    // A link may lead outside.
    let folder = path.parent()?.canonicalize().ok().filter(|folder| folder.starts_with(root))?;
    let there: Vec<_> =
        std::fs::read_dir(folder).ok()?.take(limits::PROJECT_FILES + 1).flatten().collect();
    if there.len() > limits::PROJECT_FILES {
        return None;
    }
    let names = there.iter().filter_map(|entry| entry.file_name().into_string().ok());
    let mut alike = names.filter(|other| other.eq_ignore_ascii_case(name));
    let found = alike.next().filter(|_| alike.next().is_none())?;
    Some(format!("{}{found}", written.strip_suffix(name)?))
}
