//! `robert export TAKE|CLIP|DATASET`: motion in other formats; a clip is performed first.

mod args;
mod format;
mod learn;
mod plan;
mod source;

use std::path::Path;

pub(super) use args::Args;

use self::plan::{Made, Plan, say};
use self::source::Source;
use super::failure::{Failure, Outcome};
use super::global::Global;
use super::{out, output};
use crate::fsio;

pub(super) fn run(args: &Args, global: Global) -> Outcome {
    args.check()?;
    let plan = Plan::new(args)?;
    if args.to.gathers() {
        output::may_write(&args.inputs, args.out.as_deref())?;
        return plan.gather(global);
    }
    if let Some(folder) = args.inputs.iter().find(|i| Path::new(i).is_dir()) {
        return Err(Failure::usage(format!(
            "{folder} is a folder: of a dataset only --to lerobot and --to minari make something; the other formats take clips and takes"
        )));
    }
    let many = args.inputs.len() > 1;
    let mut made = Vec::new();
    for (input, path) in args.inputs.iter().zip(plan.outputs()?) {
        let source = Source::read(input, args, global)?;
        let export = plan.export(&source)?;
        if path == Path::new("-") {
            say(&export, None, global);
            let Some(file) = export.files.first().filter(|_| export.folder.is_none()) else {
                return Err(Failure::usage("a folder cannot go to stdout: name it with -o"));
            };
            return out::bytes(&file.bytes);
        }
        if many && let Some(dir) = path.parent() {
            std::fs::create_dir_all(dir)
                .map_err(|source| fsio::Error::Write { source, path: dir.to_owned() })?;
        }
        let files = export.write(&path)?;
        say(&export, Some(&path), global);
        made.push(Made { source, export, path, files });
    }
    plan.report(&made)
}
