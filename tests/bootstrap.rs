//! `script/bootstrap` on machines without Rust. Every program that it would call is a stub that
//! writes its arguments down, so that nothing is installed and no network is needed.

use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command;

/// What the script really runs; everything else on the path is a stub.
const REAL: [&str; 10] =
    ["bash", "sh", "dirname", "sed", "grep", "cat", "mkdir", "cp", "chmod", "touch"];

/// Stub of rustup: remembers the call; a toolchain that it installed makes cargo work.
const RUSTUP: &str = r#"echo "rustup $*" >>"$LOG"
touch "$HOME/toolchain""#;
/// Stub of cargo as rustup's proxy: it fails until there is a toolchain.
const CARGO: &str = r#"[ -e "$HOME/toolchain" ]"#;

/// A machine: a checkout with nothing but the script, a home, and a path of stubs.
struct Machine {
    dir: tempfile::TempDir,
}

impl Machine {
    /// Where every Debian package is installed but Rust.
    fn without_rust() -> Machine {
        let machine = Machine { dir: tempfile::tempdir().unwrap() };
        for folder in ["checkout/script", "home", "bin"] {
            std::fs::create_dir_all(machine.path(folder)).unwrap();
        }
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        for file in ["script/bootstrap", "rust-toolchain.toml"] {
            std::fs::copy(root.join(file), machine.path("checkout").join(file)).unwrap();
        }
        for name in REAL {
            let found = std::env::split_paths(&std::env::var_os("PATH").unwrap())
                .map(|folder| folder.join(name))
                .find(|path| path.is_file())
                .unwrap_or_else(|| panic!("no {name}"));
            std::os::unix::fs::symlink(found, machine.path("bin").join(name)).unwrap();
        }
        machine.stub("dpkg-query", "echo install ok installed");
        machine.stub("id", "echo 0");
        machine.stub("apt-get", r#"echo "apt-get $*" >>"$LOG""#);
        machine.stub("apt-cache", "exit 100");
        // The viser client cannot be had, which is a warning only.
        machine.stub("mktemp", r#"echo "$HOME""#);
        machine.stub("python3", "exit 1");
        for name in ["node", "npm", "rm"] {
            machine.stub(name, "exit 0");
        }
        machine
    }

    fn path(&self, name: &str) -> std::path::PathBuf {
        self.dir.path().join(name)
    }

    fn stub(&self, name: &str, body: &str) {
        let path = self.path("bin").join(name);
        std::fs::write(&path, format!("#!/bin/sh\n{body}\n")).unwrap();
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
    }

    /// Runs the script: exit code, stderr, and what the stubs were called with.
    fn bootstrap(&self, args: &[&str]) -> (Option<i32>, String, String) {
        let log = self.path("log");
        // Not as a program: it was only just written, and the system refuses to start a file that a process
        // which another test starts at this moment still holds open.
        let out = Command::new("/bin/bash")
            .arg(self.path("checkout/script/bootstrap"))
            .args(args)
            .env_clear()
            .env("PATH", self.path("bin"))
            .env("HOME", self.path("home"))
            .env("LOG", &log)
            .output()
            .unwrap();
        let called = std::fs::read_to_string(log).unwrap_or_default();
        (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned(), called)
    }
}

/// The version that rust-toolchain.toml pins.
fn channel() -> &'static str {
    include_str!("../rust-toolchain.toml").split('"').nth(1).unwrap()
}

/// A stub of curl that prints an installer; it puts rustup and cargo where the real one does.
fn installer(machine: &Machine) {
    let rustup = format!("#!/bin/sh\n{RUSTUP}\n");
    let cargo = format!("#!/bin/sh\n{CARGO}\n");
    std::fs::write(machine.path("home/rustup.stub"), rustup).unwrap();
    std::fs::write(machine.path("home/cargo.stub"), cargo).unwrap();
    let script = r#"echo "installer $*" >>"$LOG"
mkdir -p "$HOME/.cargo/bin"
for one in rustup cargo; do cp "$HOME/$one.stub" "$HOME/.cargo/bin/$one"; done
chmod 755 "$HOME/.cargo/bin/rustup" "$HOME/.cargo/bin/cargo""#;
    std::fs::write(machine.path("home/installer"), script).unwrap();
    machine.stub("curl", r#"echo "curl $*" >>"$LOG"; cat "$HOME/installer""#);
}

#[test]
fn the_official_installer_brings_rust_without_questions() {
    let machine = Machine::without_rust();
    installer(&machine);
    let (code, err, called) = machine.bootstrap(&[]);
    assert_eq!(code, Some(0), "{err}");
    let announced = err.lines().filter(|l| l.contains("https://sh.rustup.rs")).count();
    assert_eq!(announced, 1, "{err}");
    let calls: Vec<&str> = called.lines().collect();
    assert!(calls[0].starts_with("curl ") && calls[0].contains("--proto =https"), "{called}");
    assert!(calls[1].starts_with("installer -y --no-modify-path"), "{called}");
    assert!(calls[2].starts_with(&format!("rustup toolchain install {}", channel())), "{called}");
    assert_eq!(calls.len(), 3, "{called}");
    // The second time everything is there.
    let (code, err, again) = machine.bootstrap(&[]);
    assert_eq!((code, again), (Some(0), called), "{err}");
}

#[test]
fn the_distributions_rustup_comes_first() {
    let machine = Machine::without_rust();
    installer(&machine);
    machine.stub("apt-cache", r#"[ "$1 $2" = "show rustup" ]"#);
    let folder = machine.path("bin").display().to_string();
    machine.stub(
        "apt-get",
        &format!(
            r#"echo "apt-get $*" >>"$LOG"
case "$*" in *rustup) for one in rustup cargo; do
  cp "$HOME/$one.stub" {folder}/$one; chmod 755 {folder}/$one; done ;; esac"#
        ),
    );
    let (code, err, called) = machine.bootstrap(&[]);
    assert_eq!(code, Some(0), "{err}");
    assert!(called.contains("apt-get install -y --no-install-recommends rustup\n"), "{called}");
    assert!(called.contains(&format!("rustup toolchain install {}", channel())), "{called}");
    assert!(!called.contains("curl"), "{called}");
}

#[test]
fn without_the_network_the_way_out_is_named() {
    let machine = Machine::without_rust();
    machine.stub("curl", "exit 6");
    let (code, err, _) = machine.bootstrap(&[]);
    assert_eq!(code, Some(5), "{err}");
    assert!(err.contains("error: Rust is missing; fix: ") && err.contains("rustup.rs"), "{err}");
}

#[test]
fn a_check_installs_nothing() {
    let machine = Machine::without_rust();
    installer(&machine);
    let (code, err, called) = machine.bootstrap(&["--check"]);
    assert_eq!((code, called.as_str()), (Some(5), ""), "{err}");
    assert!(err.contains("error: Rust is missing; fix: script/bootstrap"), "{err}");
}
