//! Slurm job arrays: the batch script, the list of tasks, and how many arrays they need.
//!
//! Several short shards are packed into one task, because starting a task takes about a second and
//! sites ask for few starts a minute. A task is a line of indices in a file, so that only missing
//! shards are sent and the command line stays short. One script serves several arrays: its argument
//! is the number of its first line, since the indices of an array end at the site's `MaxArraySize`.
//!
//! Rejected: Slurm's answer about success. Merges wait with `afterany` and judge by files;
//! `afterok` waits for ever after one failed task.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use robert_base::{fsio, limits};

use super::{Error, Plan, ranges, ranges::indices};

/// Facts about the site.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Shards in a task.
    pub pack: usize,
    /// Tasks at once; 0 for no limit.
    pub limit: usize,
    /// Time limit of a task, as Slurm reads it.
    pub time: String,
    /// Processor cores of a task.
    pub cpus: usize,
    /// Memory of a task, as Slurm reads it.
    pub memory: String,
    /// Seconds before the limit at which a task receives the signal to save its work.
    pub warn_secs: u64,
    /// Largest array index of the site plus one.
    pub max_array: usize,
    /// Further options of `sbatch`, each a word.
    pub sbatch: Vec<String>,
    /// Further options of `robert shard run`.
    pub run: Vec<String>,
    /// The program.
    pub binary: PathBuf,
    /// Folder for the merged results, if the merge is submitted as well.
    pub merge: Option<PathBuf>,
}

/// Script and commands of a submission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Submission {
    /// The batch script.
    pub script: String,
    /// The path of the script.
    pub path: PathBuf,
    /// Arguments of `sbatch` for each array.
    pub arrays: Vec<Vec<String>>,
    /// Arguments of `sbatch` for the merge, without its dependency.
    pub merge: Option<Vec<String>>,
}

impl Submission {
    /// The commands that submit it, in the form for a shell. The ids of the arrays are known only
    /// then.
    pub fn commands(&self) -> Vec<String> {
        let merge = self.merge.iter().cloned().map(|mut words| {
            words.insert(0, "--dependency=afterany:IDS".to_owned());
            words
        });
        let line = |words: Vec<String>| {
            let words: Vec<String> = words.iter().map(|w| quoted(w)).collect();
            format!("sbatch {}", words.join(" "))
        };
        self.arrays.iter().cloned().chain(merge).map(line).collect()
    }
}

/// Writes the list of tasks for these indices and composes the script.
///
/// # Errors
/// [`Error::Files`].
pub fn submission(
    dir: &Path,
    plan: &Plan,
    left: &[usize],
    options: &Options,
) -> Result<Submission, Error> {
    let lines: Vec<String> = left.chunks(options.pack.max(1)).map(ranges).collect();
    let text = lines.join("\n") + "\n";
    let hash = fsio::sha256_hex(text.as_bytes());
    let stem = dir.join("submit").join(hash.get(..12).unwrap_or_default());
    let tasks = stem.with_extension("tasks");
    fsio::write_atomic(&tasks, text.as_bytes())?;
    // Slurm does not create the folder of its logs.
    let log = dir.join("log");
    std::fs::create_dir_all(&log).map_err(super::error::write_error(&log))?;
    let size = options.max_array.max(1);
    let limit = if options.limit > 0 { format!("%{}", options.limit) } else { String::new() };
    let array = |first: usize| {
        let last = (lines.len() - first).min(size) - 1;
        format!("0-{last}{limit}")
    };
    let script = script(dir, plan, &tasks, &array(0), options);
    let path = stem.with_extension("sbatch");
    let whole = path.display().to_string();
    let arrays = (0..lines.len()).step_by(size).map(|first| {
        let array = format!("--array={}", array(first));
        vec!["--parsable".to_owned(), array, whole.clone(), first.to_string()]
    });
    let merge = options.merge.as_ref().map(|out| {
        let words = [options.binary.as_path(), Path::new("shard"), Path::new("merge"), dir];
        let mut command: Vec<String> = words.iter().map(|w| quoted(&w.to_string_lossy())).collect();
        command.extend(["--out".to_owned(), quoted(&out.to_string_lossy())]);
        let log = dir.join("log/merge-%j.log");
        vec![
            "--parsable".to_owned(),
            format!("--job-name=robert-{}-merge", plain(&plan.name)),
            format!("--output={}", log.display()),
            format!("--wrap=exec {}", command.join(" ")),
        ]
    });
    Ok(Submission { script, arrays: arrays.collect(), merge, path })
}

/// The batch script. `exec` is necessary: without it the shell receives the signal and ends.
/// `append` keeps the log of a task that is queued again.
fn script(dir: &Path, plan: &Plan, tasks: &Path, array: &str, options: &Options) -> String {
    let name = plain(&plan.name);
    let mut text = String::from("#!/bin/bash\n");
    let mut line = |l: &str| {
        writeln!(text, "{l}").ok();
    };
    line(&format!("#SBATCH --job-name=robert-{name} --array={array}"));
    line(&format!(
        "#SBATCH --cpus-per-task={} --mem={} --time={}",
        options.cpus, options.memory, options.time
    ));
    line(&format!("#SBATCH --requeue --open-mode=append --signal=B:USR1@{}", options.warn_secs));
    // A percent sign of the folder's name is no pattern.
    let folder = dir.to_string_lossy().replace('%', "%%");
    line(&format!("#SBATCH --output={}/log/%A_%a.log", quoted(&folder)));
    if !options.sbatch.is_empty() {
        line(&format!("#SBATCH {}", options.sbatch.join(" ")));
    }
    line(&format!("# {} shards of {}, computed with {}.", plan.shards(), plan.name, plan.numerics));
    let extra: Vec<String> = options.run.iter().map(|r| format!(" {r}")).collect();
    line(&format!(
        "exec {} shard run {} --tasks {} --task \"$((${{1:-0}} + SLURM_ARRAY_TASK_ID))\" \\",
        quoted(&options.binary.to_string_lossy()),
        quoted(&dir.to_string_lossy()),
        quoted(&tasks.to_string_lossy()),
    ));
    line(&format!("  --threads \"${{SLURM_CPUS_PER_TASK:-1}}\" --requeue slurm{}", extra.concat()));
    text
}

/// A word of a shell command.
fn quoted(word: &str) -> String {
    let safe = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
    if !word.is_empty() && word.chars().all(safe) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// A name of a job.
fn plain(name: &str) -> String {
    let safe = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    name.chars().map(safe).collect()
}

/// The indices of a task: a line of the list.
///
/// # Errors
/// [`Error::Plan`] when there is no such line.
pub fn task(list: &Path, task: usize) -> Result<Vec<usize>, Error> {
    let bytes = fsio::read_capped(list, limits::TASK_LIST_BYTES)?;
    let text = String::from_utf8_lossy(&bytes);
    let found = text.lines().nth(task).and_then(indices);
    found.ok_or_else(|| Error::Plan {
        why: format!("there is no task {task}; it has {} lines", text.lines().count()),
        path: list.to_owned(),
    })
}

/// Saves the script and submits the arrays and the merge; returns the job ids, the merge's last.
///
/// # Errors
/// [`Error::Queue`] with what `sbatch` said.
pub fn send(submission: &Submission) -> Result<Vec<String>, Error> {
    fsio::write_atomic(&submission.path, submission.script.as_bytes())?;
    let mut ids = Vec::new();
    for array in &submission.arrays {
        ids.push(sbatch(array)?);
    }
    if let Some(merge) = &submission.merge {
        let mut args = vec![format!("--dependency=afterany:{}", ids.join(":"))];
        args.extend(merge.iter().cloned());
        ids.push(sbatch(&args)?);
    }
    Ok(ids)
}

/// Runs a program of Slurm; its stdout.
fn call(program: &str, args: &[String]) -> Result<String, Error> {
    let out = Command::new(program).args(args).output().map_err(|e| Error::Queue {
        why: format!("cannot run {program}: {e}; run this on a machine that has Slurm's programs"),
        missing: true,
    })?;
    if out.status.success() {
        return Ok(String::from_utf8_lossy(&out.stdout).trim().to_owned());
    }
    let said = String::from_utf8_lossy(&out.stderr).trim().replace('\n', "; ");
    let why = format!("{program}: {said}. If the site limits jobs or tasks, raise --pack");
    Err(Error::Queue { why, missing: false })
}

fn sbatch(args: &[String]) -> Result<String, Error> {
    let answer = call("sbatch", args)?;
    // With several clusters the id is followed by the cluster's name.
    Ok(answer.split(';').next().unwrap_or_default().to_owned())
}

/// The site's largest array index plus one; `None` without Slurm.
pub fn max_array() -> Option<usize> {
    let said = call("scontrol", &["show".to_owned(), "config".to_owned()]).ok()?;
    let line = said.lines().find(|l| l.trim_start().starts_with("MaxArraySize"))?;
    line.split('=').nth(1)?.trim().parse().ok()
}

/// Requeues the task of this process. It needs the array's id and the task's index, because the
/// plain job id of the first task means all of them.
///
/// # Errors
/// [`Error::Queue`].
pub fn requeue() -> Result<(), Error> {
    let get = |name: &str| std::env::var(name).ok().filter(|v| !v.is_empty());
    let id = match (get("SLURM_ARRAY_JOB_ID"), get("SLURM_ARRAY_TASK_ID"), get("SLURM_JOB_ID")) {
        (Some(array), Some(task), _) => format!("{array}_{task}"),
        (_, _, Some(job)) => job,
        _ => {
            let why = "this is no job of Slurm, so it cannot be queued again".to_owned();
            return Err(Error::Queue { why, missing: true });
        }
    };
    call("scontrol", &["requeue".to_owned(), id]).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_the_shell_are_quoted() {
        assert_eq!(quoted("/a/b-1.toml"), "/a/b-1.toml");
        assert_eq!(quoted("a b's"), "'a b'\\''s'");
        assert_eq!(plain("my sweep"), "my_sweep");
    }
}
