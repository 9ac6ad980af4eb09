//! `robert shard plan SPEC --out DIR`.

use std::io;
use std::path::{Path, PathBuf};

use super::super::bar::Bar;
use super::super::failure::{Failure, Outcome};
use super::super::global::Global;
use super::super::out;
use crate::shard::make;

#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  robert shard plan examples/shards/eval.toml --out work/eval\n  robert shard plan examples/shards/sweep.toml --out work/sweep --json\n  robert shard plan examples/shards/train.toml --out work/seeds --numerics avx2 --copy-binary\n\nThe kinds of work are collect, eval, sweep and train; examples/shards has a spec of each. The plan\nremembers the robot, the data, the models, the program and the kind of processor. A plan with other\ncontent replaces the one in DIR; shards whose work is the same stay done."
)]
pub(in super::super) struct Args {
    /// The spec, a TOML file.
    spec: PathBuf,
    /// Folder for the plan and its shards, on a file system that all machines share.
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Let all machines compute like one with AVX2 only, so that different processors give equal
    /// bits. Training then takes longer on processors that have more.
    #[arg(long, value_name = "KIND", value_parser = ["avx2"])]
    numerics: Option<String>,
    /// Copy this program into DIR, so that a new build does not interrupt the plan.
    #[arg(long)]
    copy_binary: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The program in a plan's folder, if it was copied there.
pub(super) fn copied(dir: &Path) -> PathBuf {
    dir.join("bin/robert")
}

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    if args.out.is_file() {
        return Err(Failure::usage(format!("{} is a file", args.out.display())));
    }
    let bar = Bar::new("plan", "shards", global.quiet || args.json);
    let plan = make(&args.spec, &args.out, args.numerics.as_deref(), &bar);
    bar.finish();
    let plan = plan?;
    if args.copy_binary {
        let to = copied(&args.out);
        let fail = |source| crate::fsio::Error::Write { source, path: to.clone() };
        // This program, whose hash is in the plan, even if another build has replaced its file.
        let own = Path::new("/proc/self/exe");
        let bytes = std::fs::read(own)
            .map_err(|source| crate::fsio::Error::Read { source, path: own.to_owned() })?;
        crate::fsio::write_atomic(&to, &bytes)?;
        executable(&to).map_err(fail)?;
    }
    if args.json {
        return out::json(&serde_json::json!({
            "shards": plan.shards(),
            "out": args.out,
            "kind": plan.spec.kind(),
            "numerics": plan.numerics,
            "binary_sha256": plan.binary_sha256,
        }));
    }
    out::line(&format!(
        "{}: {} shards, {}; robert shard submit {} --backend local runs them here",
        args.out.display(),
        plan.shards(),
        plan.numerics,
        args.out.display(),
    ))
}

fn executable(path: &Path) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755))
}
