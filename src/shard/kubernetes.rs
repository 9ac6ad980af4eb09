//! An Indexed Job of Kubernetes: the same command with `JOB_COMPLETION_INDEX`.
//!
//! An exit code that a repetition cannot change (2 to 4) fails its index at once. Other exit codes
//! count against the index's own limit (`backoffLimitPerIndex`, stable since Kubernetes 1.33): another
//! node may have the processor that the plan wants (5). Only the text of the job is made here; it has
//! not been tried on a cluster.

use std::path::Path;

use super::Plan;

/// Where a pod sees the volume that contains the plan.
const MOUNT: &str = "/shards";

/// Facts about the cluster.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Image with the program.
    pub image: String,
    /// The claim for the volume that contains the plan.
    pub claim: String,
    /// Path of the plan inside the volume.
    pub dir: String,
    /// Pods at once.
    pub limit: usize,
    /// Processor cores of a pod.
    pub cpus: usize,
    /// Memory of a pod, as Kubernetes reads it.
    pub memory: String,
    /// Shards in a pod.
    pub pack: usize,
    /// Further options of `robert shard run`.
    pub run: Vec<String>,
}

/// The manifest of the job.
pub fn job(plan: &Plan, options: &Options) -> String {
    let Options { image, claim, dir, limit, cpus, memory, pack, run } = options;
    let more: String = run.iter().flat_map(|word| [" ", word]).collect();
    let name: String = plan
        .name
        .to_ascii_lowercase()
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '-' })
        .collect();
    let pods = plan.shards().div_ceil((*pack).max(1));
    let parallel = if *limit == 0 { pods } else { (*limit).min(pods) };
    let dir = Path::new(MOUNT).join(dir.trim_start_matches('/'));
    let dir = dir.display();
    format!(
        r#"apiVersion: batch/v1
kind: Job
metadata:
  name: robert-{name}
spec:
  completionMode: Indexed
  completions: {pods}
  parallelism: {parallel}
  backoffLimitPerIndex: 3
  podFailurePolicy:
    rules:
      - action: FailIndex
        onExitCodes:
          operator: In
          values: [2, 3, 4]
  template:
    spec:
      restartPolicy: Never
      containers:
        - name: shard
          image: {image}
          command: ["/bin/bash", "-c"]
          args:
            - exec robert shard run '{dir}' --index "$((JOB_COMPLETION_INDEX * {pack}))" --count {pack} --threads {cpus}{more}
          resources:
            limits:
              cpu: "{cpus}"
              memory: {memory}
          volumeMounts:
            - name: work
              mountPath: {MOUNT}
      volumes:
        - name: work
          persistentVolumeClaim:
            claimName: {claim}
"#
    )
}
