//! `robert shard submit DIR`: runs the shards that are not done, here or on a cluster.

use std::path::{Path, PathBuf};

use super::super::bar::Bar;
use super::super::failure::Outcome;
use super::super::global::{Global, threads};
use super::super::interrupt::cancel_on_ctrl_c;
use super::super::{out, pool};
use super::accept::AcceptArgs;
use crate::shard::{Plan, Pool, kubernetes, slurm, survey};

/// `MaxArraySize` of Slurm if it cannot be asked.
const MAX_ARRAY: usize = 1001;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert shard submit work/eval --backend local\n  robert shard submit work/eval --backend local --jobs 4 --threads 2\n  robert shard submit work/eval --backend slurm --pack 20 --limit 64 --time 1:00:00\n  robert shard submit work/eval --backend slurm --dry-run -- --partition=short\n  robert shard submit work/eval --backend kubernetes --image robert:1 --claim work\n\nOnly shards that are not done are sent. Repeat the command after a failure, or when jobs were lost."
)]
pub(in super::super) struct Args {
    /// Folder of the plan.
    dir: PathBuf,
    /// local: processes of this machine. slurm: a job array. kubernetes: prints an Indexed Job.
    #[arg(long, value_parser = ["local", "slurm", "kubernetes"])]
    backend: String,
    /// Processes at once on this machine [default: one for each --threads cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Processor cores of a process or task.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: u16,
    /// Shards in a task, so that it takes 5 to 60 minutes.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pack: u32,
    /// Tasks at once; 0 for no limit.
    #[arg(long, value_name = "N", default_value_t = 16)]
    limit: u32,
    /// Time limit of a task.
    #[arg(long, default_value = "01:00:00")]
    time: String,
    /// Memory of a task [default: 2G; kubernetes: 2Gi].
    #[arg(long)]
    mem: Option<String>,
    /// Seconds before the time limit at which a task saves its work. Slurm may warn a minute
    /// earlier.
    #[arg(long, value_name = "SECS", default_value_t = 120)]
    warn: u64,
    /// Merge into this folder when all tasks have ended.
    #[arg(long, value_name = "OUT")]
    merge: Option<PathBuf>,
    /// Largest array index plus one, if it is not what the site says.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    max_array: Option<u32>,
    /// Image of the pods.
    #[arg(long, default_value = "robert")]
    image: String,
    /// Claim of the volume with the plan.
    #[arg(long, default_value = "robert-work")]
    claim: String,
    /// Print the script and send nothing.
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    accept: AcceptArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Further options of sbatch.
    #[arg(last = true, value_name = "SBATCH")]
    sbatch: Vec<String>,
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    let plan = Plan::load(&args.dir)?;
    if args.backend == "kubernetes" {
        return out::bytes(kubernetes::job(&plan, &pods(args)).as_bytes());
    }
    let left = survey(&args.dir, &plan, args.accept.accept()).left();
    match args.backend.as_str() {
        "local" => local(args, global, &plan, &left),
        _ => cluster(args, &plan, &left),
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
    let cores = threads(None);
    let jobs = args.jobs.map_or_else(|| cores / usize::from(args.threads), usize::from).max(1);
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
    if let Some(to) = &args.merge {
        crate::shard::merge(&args.dir, plan, to, args.accept.accept(), false)?;
    }
    let before = plan.shards() - left.len();
    if args.json {
        return out::json(&serde_json::json!({ "done": found.done, "done_before": before }));
    }
    out::line(&format!("{} shards done, {before} done before", found.done))
}

fn cluster(args: &Args, plan: &Plan, left: &[usize]) -> Outcome {
    if left.is_empty() {
        eprintln!("all {} shards are done", plan.shards());
        return Ok(());
    }
    // The site's limit is asked for only when something is sent, so that a dry run is the same
    // everywhere.
    let site = if args.dry_run { None } else { slurm::max_array() };
    let options = slurm::Options {
        pack: args.pack as usize,
        limit: args.limit as usize,
        time: args.time.clone(),
        cpus: usize::from(args.threads),
        memory: args.mem.clone().unwrap_or_else(|| "2G".to_owned()),
        warn_secs: args.warn,
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
    kubernetes::Options {
        image: args.image.clone(),
        claim: args.claim.clone(),
        dir: args.dir.display().to_string(),
        limit: args.limit as usize,
        cpus: usize::from(args.threads),
        memory: args.mem.clone().unwrap_or_else(|| "2Gi".to_owned()),
        pack: args.pack as usize,
    }
}
