//! Child processes of this program. They end with their parent, and have only the rights that their
//! task needs.
//!
//! A child is started by [`command`] and calls [`follow_parent`] first. A child that reads foreign
//! models then gives up rights with [`confine`]. A file that crashes the physics library, or makes
//! it run foreign code, can then waste memory and time, but do no other harm.

use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use landlock::{
    ABI, Access, AccessFs, AccessNet, Ruleset, RulesetAttr, RulesetCreatedAttr, path_beneath_rules,
};
use rustix::process::{Pid, Resource, Rlimit, Signal, getppid, set_parent_process_death_signal};

/// Environment variable with the process id of the parent.
const PARENT: &str = "ROBERT_PARENT";
/// Time for a job to save its work after its parent has ended.
const GRACE: Duration = Duration::from_millis(1500);
/// Time between two checks of the parent.
const LOOK: Duration = Duration::from_millis(100);

/// A command that runs this program as a child of this process.
///
/// The system treats the end of the *thread* that started the child as the end of the parent, so
/// that thread must live as long as the child.
pub fn command(binary: &Path) -> Command {
    let mut command = Command::new(binary);
    command.env(PARENT, std::process::id().to_string());
    command
}

/// What happens to a child process when its parent ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnParentExit {
    /// At once.
    Now,
    /// As after Ctrl-C, with time to write a checkpoint.
    Interrupted,
}

/// Ends this process when its parent ends, even by SIGKILL. Does nothing in a process that
/// was not started by [`command`].
///
/// # Errors
/// The error of the operating system.
pub fn follow_parent(then: OnParentExit) -> io::Result<()> {
    let parent = std::env::var(PARENT).ok().and_then(|p| p.parse().ok()).and_then(Pid::from_raw);
    let Some(parent) = parent else { return Ok(()) };
    let gone = move || getppid() != Some(parent);
    match then {
        OnParentExit::Now => {
            set_parent_process_death_signal(Some(Signal::KILL))?;
            // The parent may have ended before the request was registered.
            if gone() {
                std::process::exit(1);
            }
        }
        OnParentExit::Interrupted => {
            set_parent_process_death_signal(Some(Signal::INT))?;
            let watch = move || {
                while !gone() {
                    std::thread::sleep(LOOK);
                }
                std::thread::sleep(GRACE);
                std::process::exit(i32::from(crate::exit::Exit::Interrupted.code()));
            };
            std::thread::Builder::new().name("parent".into()).spawn(watch)?;
        }
    }
    Ok(())
}

/// The limits of a child process: what it may read, write and use.
#[derive(Clone, Debug, Default)]
pub struct Rights {
    /// Address space, bytes.
    pub memory_bytes: Option<u64>,
    /// Processor time, seconds.
    pub cpu_secs: Option<u64>,
    /// Size of a file that it writes, bytes.
    pub file_bytes: Option<u64>,
    /// Folders and files that it may read; `None` for all.
    pub reads: Option<Vec<PathBuf>>,
    /// Folders and files that it may write; `None` for all.
    pub writes: Option<Vec<PathBuf>>,
}

/// Gives up every right that is not in `rights`, for this thread and those that it starts; call it
/// before there are others. No core file is written, and no program that it starts gains rights. If
/// the kernel has Landlock (5.13, 2021), access to files is restricted as well, and TCP for
/// processes that may not read everything.
///
/// # Errors
/// The error of the operating system. A kernel without Landlock is not an error.
pub fn confine(rights: &Rights) -> io::Result<()> {
    rustix::thread::set_no_new_privs(true)?;
    let limit = |what, cap: Option<u64>| {
        // If a limit cannot be set, it is already tighter.
        let limit = cap.map(|n| Rlimit { current: Some(n), maximum: Some(n) });
        limit.map(|l| rustix::process::setrlimit(what, l).ok());
    };
    limit(Resource::Core, Some(0));
    limit(Resource::As, rights.memory_bytes);
    limit(Resource::Cpu, rights.cpu_secs);
    limit(Resource::Fsize, rights.file_bytes);
    restrict(rights).map_err(io::Error::other)
}

fn restrict(rights: &Rights) -> Result<(), landlock::RulesetError> {
    // Rights that an older kernel does not know are left out, as the crate recommends.
    let abi = ABI::V5;
    let (read, write) = (AccessFs::from_read(abi), AccessFs::from_write(abi));
    let mut rules = Ruleset::default();
    if rights.reads.is_none() && rights.writes.is_none() {
        return Ok(());
    }
    if rights.writes.is_some() {
        rules = rules.handle_access(write)?;
    }
    if rights.reads.is_some() {
        rules = rules.handle_access(read)?.handle_access(AccessNet::from_all(abi))?;
    }
    let mut rules = rules.create()?;
    if let Some(paths) = &rights.reads {
        rules = rules.add_rules(path_beneath_rules(paths, read))?;
    }
    if let Some(paths) = &rights.writes {
        rules = rules.add_rules(path_beneath_rules(paths, write))?;
    }
    rules.restrict_self()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Landlock applies to a thread, so the other tests of this process keep their rights. The
    /// limits and `no_new_privs` are tested in separate processes (`tests/children.rs`).
    #[test]
    fn a_confined_thread_reads_and_writes_only_where_it_may() {
        let dir = tempfile::tempdir().unwrap();
        let (mine, others) = (dir.path().join("mine"), dir.path().join("others"));
        for d in [&mine, &others] {
            std::fs::create_dir(d).unwrap();
            std::fs::write(d.join("a"), "a").unwrap();
        }
        let enforced = std::thread::spawn({
            let (mine, others) = (mine.clone(), others.clone());
            move || {
                let rights = Rights {
                    reads: Some(vec![mine.clone()]),
                    writes: Some(Vec::new()),
                    ..Rights::default()
                };
                restrict(&rights).unwrap();
                assert!(std::fs::read(mine.join("a")).is_ok());
                assert!(std::fs::write(mine.join("b"), "b").is_err() || !landlocked());
                std::fs::read(others.join("a")).is_err()
            }
        });
        assert_eq!(enforced.join().unwrap(), landlocked());
        assert_eq!(std::fs::read(others.join("a")).unwrap(), b"a");
    }

    /// Whether this kernel has Landlock, by its list of security modules if that can be read, else
    /// by its version.
    fn landlocked() -> bool {
        let rules = Ruleset::default()
            .handle_access(AccessFs::from_all(ABI::V1))
            .and_then(landlock::Ruleset::create);
        let tried = std::thread::spawn(move || rules.unwrap().restrict_self().unwrap());
        tried.join().unwrap().ruleset != landlock::RulesetStatus::NotEnforced
    }
}
