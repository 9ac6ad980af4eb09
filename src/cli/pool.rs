//! Both ends of the local pool: the child, which reads indices, and the parent's summary of all
//! results.

use std::io::BufRead as _;

use super::failure::{Failure, Outcome};
use super::out;
use crate::exit::Exit;
use crate::shard::{Answer, Pooled};

/// Reads indices from stdin, one per line, performs each, and answers with a line of JSON. A
/// failure that other work would have too ends the process.
pub(super) fn serve(mut perform: impl FnMut(usize) -> Outcome) -> Outcome {
    let mut worst = Ok(());
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let Ok(index) = line.trim().parse() else {
            return Err(Failure::usage(format!("stdin: \"{}\" is not an index", line.trim())));
        };
        let found = perform(index);
        let (exit, error) = match &found {
            Ok(()) => (Exit::Ok, String::new()),
            Err(e) => (e.exit(), e.sentence()),
        };
        let answer = Answer { index, exit: exit.code(), error };
        let text = serde_json::to_string(&answer).map_err(std::io::Error::other)?;
        out::line(&text)?;
        match found {
            Ok(()) => {}
            Err(e) if alone(e.exit()) => worst = Err(e),
            Err(e) => return Err(e),
        }
    }
    worst
}

/// Whether other work may succeed although one piece ended with this exit code.
pub(super) fn alone(exit: Exit) -> bool {
    matches!(exit, Exit::Failed | Exit::Threshold)
}

/// The failure of some of `total` pieces of work (`what`, such as shards), or after a stop the hint
/// how to continue.
pub(super) fn outcome(found: &Pooled, total: usize, what: &str) -> Outcome {
    if let Some(worst) = worst(&found.failed) {
        let (count, one) = (found.failed.len(), what.trim_end_matches('s'));
        let message =
            format!("{count} of {total} {what} failed; {one} {}: {}", worst.index, worst.error);
        return Err(Failure::with(exit_of(worst.exit), message));
    }
    if found.stopped {
        let hint = format!("{} of {total} {what} are done; the same command continues", found.done);
        return Err(Failure::with(Exit::Interrupted, hint));
    }
    Ok(())
}

/// The failure that decides the exit code, in the order 3, 5, 4, 1.
fn worst(failed: &[Answer]) -> Option<&Answer> {
    let rank = |a: &&Answer| [3, 5, 4].iter().position(|e| *e == a.exit).unwrap_or(3);
    failed.iter().min_by_key(rank)
}

fn exit_of(code: u8) -> Exit {
    let all = [Exit::Usage, Exit::Invalid, Exit::Threshold, Exit::Missing];
    all.into_iter().find(|e| e.code() == code).unwrap_or(Exit::Failed)
}
