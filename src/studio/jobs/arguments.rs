//! The arguments of a job, and of a job that is resumed.

use crate::protocol::{Error, JobKind};

impl JobKind {
    pub(super) fn command(self) -> &'static str {
        match self {
            JobKind::Collect => "collect",
            JobKind::Train => "train",
            JobKind::Eval => "eval",
            JobKind::Render => "render",
            JobKind::Export => "export",
            JobKind::Import => "import",
        }
    }

    /// The arguments that resume an ended job.
    pub(super) fn resumed(self, args: &[String]) -> Result<Vec<String>, Error> {
        let mut next = args.to_vec();
        match self {
            // A run directory contains all other settings.
            JobKind::Train => {
                if value_of(args, "--resume").is_some() {
                    return Ok(next);
                }
                let run = value_of(args, "--out")
                    .ok_or_else(|| Error::request("this training was started without --out"))?;
                next = without(args, &["--out", "--preset", "--set"]);
                next.extend(["--resume".to_owned(), run]);
            }
            JobKind::Collect => {
                if !args.iter().any(|a| a == "--resume") {
                    next.push("--resume".into());
                }
            }
            // Short enough to begin anew.
            JobKind::Eval | JobKind::Render | JobKind::Export | JobKind::Import => {}
        }
        Ok(next)
    }
}

/// The value of `--name V` or `--name=V`.
fn value_of(args: &[String], name: &str) -> Option<String> {
    let glued = format!("{name}=");
    args.iter().enumerate().find_map(|(i, a)| {
        if a == name { args.get(i + 1).cloned() } else { a.strip_prefix(&glued).map(str::to_owned) }
    })
}

/// The arguments without these options and their values.
fn without(args: &[String], names: &[&str]) -> Vec<String> {
    let mut kept = Vec::new();
    let mut skip = false;
    for a in args {
        if std::mem::take(&mut skip) {
            continue;
        }
        if names.contains(&a.as_str()) {
            skip = true;
        } else if !names.iter().any(|n| a.strip_prefix(n).is_some_and(|r| r.starts_with('='))) {
            kept.push(a.clone());
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stopped_training_goes_on_in_its_own_folder() {
        let words = |t: &str| t.split(' ').map(str::to_owned).collect::<Vec<_>>();
        let args =
            words("--robot ur5e --data d --preset quick --set lr=1 --set=seed=2 --out runs/a");
        let next = JobKind::Train.resumed(&args).unwrap();
        assert_eq!(next, words("--robot ur5e --data d --resume runs/a"));
        assert_eq!(JobKind::Train.resumed(&next).unwrap(), next, "and so the second time");
        let next = JobKind::Collect.resumed(&words("--out d")).unwrap();
        assert_eq!(next, words("--out d --resume"));
        assert_eq!(JobKind::Collect.resumed(&next).unwrap(), next);
        assert!(JobKind::Train.resumed(&words("--robot ur5e")).is_err());
    }
}
