//! Shards on a real Slurm of two nodes on this machine, where Slurm and munge are installed.
//!
//! `ROBERT_SLURM=long` also kills a node in the middle, and lets a training shard outlive its limit;
//! both wait for Slurm's own timeouts and take minutes.

use std::collections::BTreeMap;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::run::{binary, call};

/// A cluster that ends with this value.
struct Cluster {
    dir: tempfile::TempDir,
    daemons: Vec<(&'static str, Child)>,
}

fn port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

fn present(program: &str) -> bool {
    let found = |dir: PathBuf| dir.join(program).is_file();
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).chain(["/usr/sbin".into()]).any(found)
}

impl Cluster {
    /// Starts munge, a controller and two nodes of one core; `None` where they are not installed.
    fn start() -> Option<Self> {
        if !["munged", "slurmctld", "slurmd", "sbatch"].iter().all(|p| present(p)) {
            eprintln!("skipped: Slurm is not installed (apt-get install slurm-wlm munge)");
            return None;
        }
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name).display().to_string();
        for name in ["run", "state", "log", "spool_n1", "spool_n2"] {
            std::fs::create_dir(dir.path().join(name)).unwrap();
        }
        std::fs::write(at("key"), [7_u8; 128]).unwrap();
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o600);
        std::fs::set_permissions(at("key"), mode).unwrap();
        let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
        let user = String::from_utf8(Command::new("id").arg("-un").output().unwrap().stdout);
        let user = user.unwrap().trim().to_owned();
        let conf = format!(
            "ClusterName=loop\nSlurmctldHost={host}(127.0.0.1)\nSlurmctldPort={}\n\
             CommunicationParameters=NoInAddrAny,NoCtldInAddrAny\nAuthType=auth/munge\n\
             CryptoType=crypto/munge\nAuthInfo=socket={}\nSlurmUser={user}\nSlurmdUser={user}\n\
             StateSaveLocation={}\nSlurmdSpoolDir={}/spool_%n\nSlurmctldPidFile={}\n\
             SlurmdPidFile={}/run/slurmd_%n.pid\nSlurmctldLogFile={}\nSlurmdLogFile={}/log/slurmd_%n.log\n\
             ProctrackType=proctrack/pgid\nTaskPlugin=task/none\nJobAcctGatherType=jobacct_gather/none\n\
             MpiDefault=none\nSelectType=select/cons_tres\nSelectTypeParameters=CR_Core\nJobRequeue=1\n\
             ReturnToService=2\nSlurmctldTimeout=30\nSlurmdTimeout=15\nKillWait=5\nMaxArraySize=11\n\
             SchedulerParameters=sched_interval=1,bf_interval=1\n\
             NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={} CPUs=1 RealMemory=2000 State=UNKNOWN\n\
             NodeName=n2 NodeHostname={host} NodeAddr=127.0.0.1 Port={} CPUs=1 RealMemory=2000 State=UNKNOWN\n\
             PartitionName=all Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP\n",
            port(),
            at("run/munge.sock"),
            at("state"),
            dir.path().display(),
            at("run/ctld.pid"),
            dir.path().display(),
            at("log/ctld.log"),
            dir.path().display(),
            port(),
            port(),
        );
        std::fs::write(at("slurm.conf"), conf).unwrap();
        let mut cluster = Cluster { dir, daemons: Vec::new() };
        cluster.daemon(
            "munge",
            "munged",
            &[
                "--foreground",
                "--force",
                "--key-file",
                &at2(&cluster, "key"),
                "--socket",
                &at2(&cluster, "run/munge.sock"),
                "--pid-file",
                &at2(&cluster, "run/munged.pid"),
                "--log-file",
                &at2(&cluster, "log/munged.log"),
                "--seed-file",
                &at2(&cluster, "run/munged.seed"),
            ],
        );
        cluster.wait_for("munge", |c| c.dir.path().join("run/munge.sock").exists());
        cluster.daemon("ctld", "slurmctld", &["-D"]);
        cluster.daemon("n1", "slurmd", &["-D", "-N", "n1"]);
        cluster.daemon("n2", "slurmd", &["-D", "-N", "n2"]);
        cluster.wait_for("two idle nodes", |c| {
            let out = c.call("sinfo", &["-h", "-N", "-o", "%N %T"]);
            String::from_utf8_lossy(&out.stdout).matches("idle").count() == 2
        });
        Some(cluster)
    }

    fn daemon(&mut self, name: &'static str, program: &str, args: &[&str]) {
        let sbin = Path::new("/usr/sbin").join(program);
        let program = if sbin.is_file() { sbin } else { program.into() };
        let child = Command::new(program)
            .args(args)
            .env("SLURM_CONF", self.dir.path().join("slurm.conf"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        self.daemons.push((name, child));
    }

    fn wait_for(&self, what: &str, done: impl Fn(&Self) -> bool) {
        let began = Instant::now();
        while !done(self) {
            assert!(began.elapsed().as_secs() < 600, "{what}: {}", self.logs());
            std::thread::sleep(Duration::from_millis(200));
        }
    }

    fn logs(&self) -> String {
        let tail = |name: &str| {
            let text = std::fs::read_to_string(self.dir.path().join("log").join(name));
            let text = text.unwrap_or_default();
            let lines: Vec<&str> = text.lines().rev().take(20).collect();
            format!("{name}:\n{}\n", lines.into_iter().rev().collect::<Vec<_>>().join("\n"))
        };
        ["munged.log", "ctld.log", "slurmd_n1.log", "slurmd_n2.log"].map(tail).concat()
    }

    fn call(&self, program: &str, args: &[&str]) -> Output {
        Command::new(program)
            .args(args)
            .env("SLURM_CONF", self.dir.path().join("slurm.conf"))
            .current_dir(self.dir.path())
            .output()
            .unwrap()
    }

    /// Runs `robert` inside the cluster's folder.
    fn robert(&self, args: &[&str]) -> String {
        let out = self.call(binary().to_str().unwrap(), args);
        let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
        assert!(out.status.success(), "{args:?}: {}{}", text(&out.stderr), text(&out.stdout));
        text(&out.stdout)
    }

    /// Plans this spec into `name`.
    fn plan(&self, text: &str, name: &str) {
        std::fs::write(self.dir.path().join("spec.toml"), text).unwrap();
        self.robert(&["shard", "plan", "spec.toml", "--out", name]);
    }

    fn left(&self, name: &str) -> usize {
        self.robert(&["shard", "missing", name]).lines().count()
    }

    fn merged(&self, name: &str) -> String {
        let out = format!("out-{name}");
        let text = self.robert(&["shard", "merge", name, "--out", &out, "--json"]);
        serde_json::from_str::<Value>(&text).unwrap()["sha256"].as_str().unwrap().to_owned()
    }

    /// Kills a node like a power cut: its daemon, its steps and what they run.
    fn kill_node(&mut self, name: &str) -> usize {
        let at = self.daemons.iter().position(|(n, _)| *n == name).unwrap();
        let (_, mut daemon) = self.daemons.remove(at);
        daemon.kill().unwrap();
        daemon.wait().unwrap();
        let mine = format!("SLURMD_NODENAME={name}");
        let mut killed = 0;
        for (pid, parent) in processes(&mine) {
            for pid in [parent, pid] {
                let Some(pid) = rustix::process::Pid::from_raw(pid) else { continue };
                let kill = rustix::process::kill_process(pid, rustix::process::Signal::KILL);
                killed += usize::from(kill.is_ok());
            }
        }
        killed
    }
}

fn at2(cluster: &Cluster, name: &str) -> String {
    cluster.dir.path().join(name).display().to_string()
}

/// Processes with this variable in their environment, and their parents.
fn processes(variable: &str) -> Vec<(i32, i32)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir("/proc").unwrap().flatten() {
        let Ok(pid) = entry.file_name().to_string_lossy().parse::<i32>() else { continue };
        let environment = std::fs::read(entry.path().join("environ")).unwrap_or_default();
        if !environment.split(|b| *b == 0).any(|v| v == variable.as_bytes()) {
            continue;
        }
        let stat = std::fs::read_to_string(entry.path().join("stat")).unwrap_or_default();
        let parent = stat.rsplit(')').next().and_then(|s| s.split_whitespace().nth(1));
        found.push((pid, parent.and_then(|p| p.parse().ok()).unwrap_or(0)));
    }
    found
}

impl Drop for Cluster {
    fn drop(&mut self) {
        self.call("scancel", &["--state=PENDING"]);
        self.call("scancel", &["--state=RUNNING"]);
        for (_, child) in self.daemons.iter_mut().rev() {
            child.kill().ok();
            child.wait().ok();
        }
    }
}

fn long() -> bool {
    std::env::var("ROBERT_SLURM").is_ok_and(|v| v == "long")
}

#[test]
fn packed_arrays_give_the_same_set_as_the_local_pool() {
    let Some(cluster) = Cluster::start() else { return };
    let text = "kind = \"collect\"\nrobot = \"pointmass\"\ntransitions = 4_080\nshards = 40\n";
    for name in ["queue", "pool"] {
        cluster.plan(text, name);
    }
    cluster.robert(&["shard", "submit", "pool", "--backend", "local"]);
    // MaxArraySize is 11, so 14 tasks are two arrays; the merge is a job of its own.
    let began = Instant::now();
    let sent = cluster.robert(&[
        "shard",
        "submit",
        "queue",
        "--backend",
        "slurm",
        "--pack",
        "3",
        "--limit",
        "0",
        "--time",
        "5",
        "--mem",
        "100M",
        "--merge",
        "merged",
        "--json",
    ]);
    let sent: Value = serde_json::from_str(&sent).unwrap();
    assert_eq!(sent["jobs"].as_array().unwrap().len(), 3, "{sent}");
    let merged = cluster.dir.path().join("merged/merged.json");
    cluster.wait_for("the merge", |_| merged.exists());
    eprintln!("40 shards in 14 tasks on two nodes: {:.1} s", began.elapsed().as_secs_f64());
    let sha = robert::fsio::sha256_file(&merged).unwrap();
    assert_eq!(sha, cluster.merged("pool"));
    assert_eq!(cluster.merged("queue"), sha);
    let all_done = call(cluster.dir.path(), &["shard", "submit", "queue", "--backend", "slurm"]);
    assert!(
        all_done.0 == 0 && all_done.1.contains("0 shards done, 40 done before"),
        "{all_done:?}"
    );
}

#[test]
fn a_killed_node_costs_its_shards_in_progress_and_no_hand() {
    if !long() {
        eprintln!("skipped: ROBERT_SLURM=long kills a node, which takes a minute");
        return;
    }
    let Some(mut cluster) = Cluster::start() else { return };
    let text = "kind = \"collect\"\nrobot = \"pointmass\"\ntransitions = 2_000_000\nshards = 40\n";
    for name in ["queue", "pool"] {
        cluster.plan(text, name);
    }
    cluster.robert(&["shard", "submit", "pool", "--backend", "local"]);
    let began = Instant::now();
    cluster.robert(&[
        "shard",
        "submit",
        "queue",
        "--backend",
        "slurm",
        "--pack",
        "4",
        "--limit",
        "0",
        "--time",
        "5",
        "--mem",
        "100M",
    ]);
    cluster.wait_for("work on n2", |c| {
        c.left("queue") < 40 && !processes("SLURMD_NODENAME=n2").is_empty()
    });
    let killed = cluster.kill_node("n2");
    assert!(killed >= 2, "the step and its shard");
    let at = began.elapsed().as_secs_f64();
    eprintln!("killed n2 after {at:.1} s, {} shards left", cluster.left("queue"));
    cluster.wait_for("all shards", |c| c.left("queue") == 0);
    eprintln!("all 40 shards after {:.1} s", began.elapsed().as_secs_f64());
    let mut restarts = BTreeMap::new();
    for entry in std::fs::read_dir(cluster.dir.path().join("queue/log")).unwrap().flatten() {
        let text = std::fs::read_to_string(entry.path()).unwrap();
        restarts.insert(entry.file_name(), text.matches("done before").count());
    }
    eprintln!("shards that a second start found done: {:?}", restarts.values().sum::<usize>());
    assert_eq!(cluster.merged("queue"), cluster.merged("pool"));
}

#[test]
fn a_training_shard_that_outlives_its_limit_is_requeued_and_ends_with_the_same_bits() {
    if !long() {
        eprintln!("skipped: ROBERT_SLURM=long lets a shard outlive its limit, which takes minutes");
        return;
    }
    let Some(cluster) = Cluster::start() else { return };
    let steps = std::env::var("ROBERT_STEPS").unwrap_or_else(|_| "40000".to_owned());
    let text = format!(
        "kind = \"train\"\nrobot = \"pointmass\"\npreset = \"pm-tiny\"\nseeds = [5]\n\
         suites = [\"test\"]\ncases = 2\n[set]\nsteps = {steps}\nbatch = 8\nlayers = 1\nwidth = 16\nheads = 1\n\
         [collect]\ntransitions = 4_000\n"
    );
    for name in ["queue", "pool"] {
        cluster.plan(&text, name);
    }
    let began = Instant::now();
    cluster.robert(&[
        "shard",
        "submit",
        "queue",
        "--backend",
        "slurm",
        "--time",
        "1",
        "--warn",
        "15",
        "--mem",
        "100M",
    ]);
    cluster.wait_for("the shard", |c| c.left("queue") == 0);
    eprintln!("done after {:.0} s", began.elapsed().as_secs_f64());
    let logs = std::fs::read_dir(cluster.dir.path().join("queue/log")).unwrap().flatten();
    let text: String = logs.map(|e| std::fs::read_to_string(e.path()).unwrap()).collect();
    let stops = text.matches("stopped at shard 0").count();
    eprintln!("warned and requeued {stops} times:\n{text}");
    assert!(stops > 0, "the shard did not outlive its limit: raise ROBERT_STEPS");
    cluster.robert(&["shard", "submit", "pool", "--backend", "local"]);
    assert_eq!(cluster.merged("queue"), cluster.merged("pool"));
}
