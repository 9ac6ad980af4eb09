//! `robert shard submit DIR`: runs the shards that are not done, here or on a cluster.

use std::path::{Path, PathBuf};

use clap::ValueEnum as _;

use super::super::bar::Bar;
use super::super::failure::{Failure, Outcome};
use super::super::global::{Global, cores, thread_count};
use super::super::interrupt::cancel_on_ctrl_c;
use super::super::{out, pool};
use super::accept::AcceptArgs;
use crate::shard::{Plan, Pool, kubernetes, slurm, survey};

/// `MaxArraySize` of Slurm if it cannot be asked.
const MAX_ARRAY: usize = 1001;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert shard submit work/eval --backend local\n  robert shard submit work/eval --backend local --jobs 4 --threads 2\n  robert shard submit work/eval --backend slurm --pack 20 --limit 64 --time 1:00:00\n  robert shard submit work/eval --backend slurm --dry-run -- --partition=short\n  robert shard submit work/eval --backend kubernetes --image robert:1 --claim work\n\nOnly shards that are not done are sent. Repeat the command after a failure, or when jobs were lost.\nWhere nothing is left, --merge merges at once. The Job of Kubernetes names all shards, and those that\nare done end at once. An option that the backend does not have is refused."
)]
pub(in super::super) struct Args {
    /// Folder of the plan.
    dir: PathBuf,
    /// Where the shards run.
    #[arg(long)]
    backend: Backend,
    /// local: processes at once [default: one for each --threads cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Processor cores of a process or task.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = thread_count())]
    threads: usize,
    /// slurm, kubernetes: shards in a task, so that it takes 5 to 60 minutes [default: 1].
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..))]
    pack: Option<u32>,
    /// slurm, kubernetes: tasks at once; 0 for no limit [default: 16].
    #[arg(long, value_name = "N")]
    limit: Option<u32>,
    /// slurm: time limit of a task [default: 01:00:00].
    #[arg(long)]
    time: Option<String>,
    /// slurm, kubernetes: memory of a task [default: 2G; kubernetes: 2Gi].
    #[arg(long)]
    mem: Option<String>,
    /// slurm: seconds before the time limit at which a task saves its work. Slurm may warn a minute
    /// earlier [default: 120].
    #[arg(long, value_name = "SECS")]
    warn: Option<u64>,
    /// local, slurm: merge into this folder when all tasks have ended.
    #[arg(long, value_name = "OUT")]
    merge: Option<PathBuf>,
    /// slurm: largest array index plus one, if it is not what the site says.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    max_array: Option<u32>,
    /// kubernetes: image of the pods [default: robert].
    #[arg(long)]
    image: Option<String>,
    /// kubernetes: claim of the volume with the plan [default: robert-work].
    #[arg(long)]
    claim: Option<String>,
    /// slurm, kubernetes: print the script and send nothing.
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    accept: AcceptArgs,
    /// local, slurm: print JSON.
    #[arg(long)]
    json: bool,
    /// slurm: further options of sbatch.
    #[arg(last = true, value_name = "SBATCH")]
    sbatch: Vec<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Backend {
    /// Processes of this machine.
    Local,
    /// A job array.
    Slurm,
    /// Prints an Indexed Job.
    Kubernetes,
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    args.must_apply()?;
    let plan = Plan::load(&args.dir)?;
    let left = || survey(&args.dir, &plan, args.accept.accept()).left();
    match args.backend {
        Backend::Local => local(args, global, &plan, &left()),
        Backend::Slurm => cluster(args, &plan, &left()),
        Backend::Kubernetes => out::bytes(kubernetes::job(&plan, &pods(args)).as_bytes()),
    }
}

impl Args {
    fn pack(&self) -> usize {
        self.pack.unwrap_or(1) as usize
    }

    fn limit(&self) -> usize {
        self.limit.unwrap_or(16) as usize
    }

    /// Refuses options that the backend would ignore.
    fn must_apply(&self) -> Outcome {
        use Backend::{Kubernetes, Local, Slurm};
        let given: [(&str, bool, &[Backend]); 12] = [
            ("--jobs", self.jobs.is_some(), &[Local]),
            ("--pack", self.pack.is_some(), &[Slurm, Kubernetes]),
            ("--limit", self.limit.is_some(), &[Slurm, Kubernetes]),
            ("--time", self.time.is_some(), &[Slurm]),
            ("--mem", self.mem.is_some(), &[Slurm, Kubernetes]),
            ("--warn", self.warn.is_some(), &[Slurm]),
            ("--merge", self.merge.is_some(), &[Local, Slurm]),
            ("--max-array", self.max_array.is_some(), &[Slurm]),
            ("--image and --claim", self.image.is_some() || self.claim.is_some(), &[Kubernetes]),
            ("--dry-run", self.dry_run, &[Slurm, Kubernetes]),
            ("--json (and --jsonl)", self.json, &[Local, Slurm]),
            ("an option of sbatch", !self.sbatch.is_empty(), &[Slurm]),
        ];
        let Some((flag, _, those)) =
            given.into_iter().find(|(_, given, those)| *given && !those.contains(&self.backend))
        else {
            return Ok(());
        };
        let name =
            |b: &Backend| b.to_possible_value().map(|v| format!("--backend {}", v.get_name()));
        let those: Vec<String> = those.iter().filter_map(name).collect();
        Err(Failure::usage(format!("{flag}: only for {}", those.join(" and "))))
    }
}

/// The program that shards run with: the plan's copy, else this one.
fn program(dir: &Path) -> Outcome<PathBuf> {
    let copy = super::plan::copied(dir);
    if copy.is_file() { Ok(absolute(&copy)?) } else { Ok(std::env::current_exe()?) }
}

fn absolute(path: &Path) -> Outcome<PathBuf> {
    Ok(std::path::absolute(path)?)
}

fn local(args: &Args, global: Global, plan: &Plan, left: &[usize]) -> Outcome {
    let binary = program(&args.dir)?;
    if binary == std::env::current_exe()? {
        // A foreign machine is named once, not by every process.
        plan.admit(args.accept.accept())?;
    }
    let jobs = args.jobs.map_or_else(|| cores() / args.threads, usize::from).max(1);
    let mut words = vec!["shard".to_owned(), "run".to_owned(), args.dir.display().to_string()];
    words.extend(["--stdin".to_owned(), "--threads".to_owned(), args.threads.to_string()]);
    words.extend(args.accept.words());
    let workers = Pool { binary, args: words, jobs };
    let cancel = cancel_on_ctrl_c();
    let bar = Bar::new("shards", "shards", global.quiet || args.json);
    let found = workers.run(left, &bar, &cancel);
    bar.finish();
    let found = found?;
    pool::outcome(&found, left.len(), "shards")?;
    end(args, plan, found.done, plan.shards() - left.len())
}

/// Merges if asked, and reports: all shards are done, `now` of them by this command.
fn end(args: &Args, plan: &Plan, now: usize, before: usize) -> Outcome {
    if let Some(to) = &args.merge {
        crate::shard::merge(&args.dir, plan, to, args.accept.accept(), false)?;
    }
    if args.json {
        return out::json(&serde_json::json!({ "done": now, "done_before": before }));
    }
    out::line(&format!("{now} shards done, {before} done before"))
}

fn cluster(args: &Args, plan: &Plan, left: &[usize]) -> Outcome {
    if left.is_empty() {
        if args.dry_run {
            out::aside(format!("all {} shards are done", plan.shards()));
            return Ok(());
        }
        return end(args, plan, 0, plan.shards());
    }
    // The site's limit is asked for only when something is sent, so that a dry run is the same
    // everywhere.
    let site = if args.dry_run { None } else { slurm::max_array() };
    let options = slurm::Options {
        pack: args.pack(),
        limit: args.limit(),
        time: args.time.clone().unwrap_or_else(|| "01:00:00".to_owned()),
        cpus: args.threads,
        memory: args.mem.clone().unwrap_or_else(|| "2G".to_owned()),
        warn_secs: args.warn.unwrap_or(120),
        max_array: args.max_array.map(|n| n as usize).or(site).unwrap_or(MAX_ARRAY),
        sbatch: args.sbatch.clone(),
        run: args.accept.words(),
        binary: program(&args.dir)?,
        merge: args.merge.as_deref().map(absolute).transpose()?,
    };
    let submission = slurm::submission(&absolute(&args.dir)?, plan, left, &options)?;
    if args.dry_run {
        let mut text = submission.script.clone();
        text.push_str("# Save this script and send it:\n");
        let commands = submission.commands().into_iter().map(|c| format!("#   {c}\n"));
        text.push_str(&commands.collect::<Vec<_>>().concat());
        return out::bytes(text.as_bytes());
    }
    let ids = slurm::send(&submission)?;
    if args.json {
        return out::json(
            &serde_json::json!({ "jobs": ids, "shards": left.len(), "script": submission.path }),
        );
    }
    out::line(&format!(
        "{} shards sent as jobs {}; robert shard status {} counts what is done",
        left.len(),
        ids.join(" "),
        args.dir.display()
    ))
}

fn pods(args: &Args) -> kubernetes::Options {
    let or = |given: &Option<String>, usual: &str| given.as_deref().unwrap_or(usual).to_owned();
    kubernetes::Options {
        image: or(&args.image, "robert"),
        claim: or(&args.claim, "robert-work"),
        dir: args.dir.display().to_string(),
        limit: args.limit(),
        cpus: args.threads,
        memory: or(&args.mem, "2Gi"),
        pack: args.pack(),
        run: args.accept.words(),
    }
}
