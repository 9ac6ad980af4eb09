"""Runs the shards of a plan that are not done on a Ray cluster.

    pip install ray
    robert shard plan examples/shards/eval.toml --out /shared/eval
    python examples/shards/ray_cluster.py /shared/eval --address auto
    robert shard merge /shared/eval --out results/eval

Every node needs the program `robert` and the folder of the plan at the same path. Ray decides only
where a shard runs. Files decide whether it is done, so a lost node costs its shards in progress.
"""

import argparse
import subprocess
import sys

import ray

# Exit codes that another try cannot change: usage, invalid input, threshold, missing dependency.
FINAL = {2, 3, 4, 5}


def run(plan: str, index: int, threads: int) -> tuple[int, int, str]:
    """Runs one shard; (index, exit code, message)."""
    command = ["robert", "shard", "run", plan, "--index", str(index), "--threads", str(threads)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0 and done.returncode not in FINAL:
        # Ray tries a task that raised again (max_retries).
        raise RuntimeError(done.stderr.strip())
    return index, done.returncode, done.stderr.strip()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("plan")
    parser.add_argument("--address", help="the cluster; without it, this machine alone")
    parser.add_argument("--threads", type=int, default=1, help="processor cores of a shard")
    args = parser.parse_args()
    ray.init(address=args.address)

    missing = subprocess.run(
        ["robert", "shard", "missing", args.plan], capture_output=True, text=True, check=True
    )
    task = ray.remote(num_cpus=args.threads, max_retries=3, retry_exceptions=True)(run)
    waiting = [task.remote(args.plan, int(i), args.threads) for i in missing.stdout.split()]
    total, failed = len(waiting), 0
    while waiting:
        ready, waiting = ray.wait(waiting)
        try:
            index, code, message = ray.get(ready[0])
        except ray.exceptions.RayError as error:
            index, code, message = "?", 1, str(error)
        failed += code != 0
        if code:
            print(f"shard {index}: {message}", file=sys.stderr)
        print(f"\r{total - len(waiting)}/{total}", end="", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
