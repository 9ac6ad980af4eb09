//! Runs the built binary in a folder of its own.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// One call of the binary, in a fresh temporary folder.
#[derive(Debug)]
pub(crate) struct Robert {
    dir: tempfile::TempDir,
    args: Vec<std::ffi::OsString>,
}

/// What came back.
#[derive(Debug)]
pub(crate) struct Ran {
    /// The folder it ran in; removed with this value.
    pub dir: tempfile::TempDir,
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

/// Starts a call.
pub(crate) fn robert() -> Robert {
    Robert { dir: tempfile::tempdir().unwrap(), args: Vec::new() }
}

impl Robert {
    /// Adds arguments.
    pub(crate) fn args<S: AsRef<OsStr>>(mut self, args: impl IntoIterator<Item = S>) -> Self {
        self.args.extend(args.into_iter().map(|a| a.as_ref().to_owned()));
        self
    }

    /// Puts a file into the folder first.
    pub(crate) fn file(self, name: &str, text: impl AsRef<[u8]>) -> Self {
        let path = self.dir.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
        self
    }

    /// A path in its folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Runs, whatever the exit code.
    pub(crate) fn run(self) -> Ran {
        let Output { status, stdout, stderr } = Command::new(binary())
            .args(&self.args)
            .current_dir(self.dir.path())
            .env("NO_COLOR", "1")
            .env_remove("ROBERT_LOG")
            .output()
            .unwrap();
        let mut stderr = String::from_utf8_lossy(&stderr).into_owned();
        if status.code().is_none() {
            stderr += &format!("\n({status})");
        }
        Ran {
            dir: self.dir,
            code: status.code().unwrap_or(-1),
            stdout: String::from_utf8_lossy(&stdout).into_owned(),
            stderr,
        }
    }

    /// Runs and demands exit 0.
    pub(crate) fn succeeds(self) -> Ran {
        let ran = self.run();
        assert_eq!(ran.code, 0, "stderr: {}\nstdout: {}", ran.stderr, ran.stdout);
        ran
    }

    /// Runs and demands this exit code.
    pub(crate) fn fails(self, code: i32) -> Ran {
        let ran = self.run();
        assert_eq!(ran.code, code, "stderr: {}\nstdout: {}", ran.stderr, ran.stdout);
        assert!(ran.stderr.contains("error: "), "no message: {}", ran.stderr);
        ran
    }
}

impl Ran {
    /// The one JSON document on stdout.
    pub(crate) fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("{e}: {}", self.stdout))
    }

    /// A file that the call left in its folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }
}

/// A call in a folder that is there: exit code, stdout, stderr.
pub(crate) fn call(dir: &Path, args: &[&str]) -> (i32, String, String) {
    let out = Command::new(binary()).args(args).current_dir(dir).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (out.status.code().unwrap_or(-1), text(&out.stdout), text(&out.stderr))
}

/// The binary under test.
pub(crate) fn binary() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_robert"))
}

#[test]
fn unknown_command_is_usage() {
    let ran = robert().args(["dance"]).run();
    assert_eq!(ran.code, 2);
    assert!(ran.stdout.is_empty());
}

#[test]
fn help_is_a_result() {
    let ran = robert().args(["--help"]).succeeds();
    assert!(ran.stdout.contains("Exit codes"));
    assert!(ran.stderr.is_empty());
}
