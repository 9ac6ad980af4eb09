"""Measures how much nearer than a cubic spline a learned linear interpolation is to hidden frames of recorded motion.

    script/python --setup && target/python/bin/pip install safetensors    # once: an environment with numpy
    robert collect --robot ur5e --agent noise --transitions 100000 --seed 7 --out data/cubic-ur5e
    target/python/bin/python script/probes/hidden.py data/cubic-ur5e … --out results/hidden-probe.json

A quarter or half of 79 frames is hidden at random in 60 pieces of 111 frames of held-out trajectories, as in the `test`
suites (which are other pieces). A natural cubic spline passes through the visible frames. A linear interpolation, joint
by joint, learned from four fifths of the trajectories how the speed of a joint at one time goes with its speed at
another: it is the mean of a Gaussian process with these covariances, given the visible frames. Of eight strengths of
regularisation it has the one that comes nearest to the hidden frames, which favours it.
"""

import argparse
import json
import pathlib

import numpy as np
import shards

FRAMES, FIRST, LAST = 111, 31, 110  # of a piece; hidden frames are in FIRST..LAST
PIECES = 60
NOISE = [1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2]


def spline(seen, values, wanted):
    """A natural cubic spline through (seen, values) at the frames `wanted`."""
    h = np.diff(seen).astype(float)
    slope = np.diff(values, axis=0) / h[:, None]
    a, b = np.eye(len(seen)), np.zeros_like(values)
    for i in range(1, len(seen) - 1):
        a[i, i - 1:i + 2] = h[i - 1], 2 * (h[i - 1] + h[i]), h[i]
        b[i] = 6 * (slope[i] - slope[i - 1])
    bend = np.linalg.solve(a, b)
    i = np.clip(np.searchsorted(seen, wanted) - 1, 0, len(h) - 1)
    width, left, right = h[i, None], (wanted - seen[i])[:, None], (seen[i + 1] - wanted)[:, None]
    ends = (values[i] * right + values[i + 1] * left) / width
    return ends + bend[i] * (right**3 / width - width * right) / 6 + bend[i + 1] * (left**3 / width - width * left) / 6


def covariance_of_steps(training):
    """Mean product of a joint's steps that lie k frames apart, (FRAMES - 1, S)."""
    total = np.zeros((FRAMES - 1, training[0].shape[1]))
    count = np.zeros((FRAMES - 1, 1))
    for states in training:
        step = np.diff(states, axis=0)
        for k in range(min(FRAMES - 1, len(step))):
            total[k] += (step[:len(step) - k] * step[k:]).sum(0)
            count[k] += len(step) - k
    return total / count


def covariance_of_positions(lagged):
    """Covariance of the positions of each joint, (S, FRAMES, FRAMES); where a piece begins, is nearly unknown."""
    frames = np.arange(FRAMES - 1)
    steps = lagged[np.abs(frames[:, None] - frames)].transpose(2, 0, 1)
    sums = np.tril(np.ones((FRAMES, FRAMES - 1)), -1)
    return sums @ steps @ sums.T + 1e4 * lagged[0][:, None, None]


def process(covariance, noise, seen, values, wanted):
    """The mean of the Gaussian process at the frames `wanted`, (wanted, S)."""
    out = []
    for one, observed in zip(covariance, values.T):
        scale = one[0, 0] * 1e-4
        known = one[np.ix_(seen, seen)] + noise * scale * np.eye(len(seen))
        mean = observed.mean()
        out.append(mean + one[np.ix_(wanted, seen)] @ np.linalg.solve(known, observed - mean))
    return np.array(out).T


def ratios(folder, hidden):
    """Error of the process on hidden frames divided by that of the spline: mean over the pieces, and of all together."""
    motion = [e["qpos"].astype(float) for e in shards.episodes(folder)]
    covariance = covariance_of_positions(covariance_of_steps([q for i, q in enumerate(motion) if i % 5]))
    held = [q for i, q in enumerate(motion) if i % 5 == 0 and len(q) >= FRAMES][:PIECES]
    if not held:
        raise SystemExit(f"error: {folder} has no held-out trajectory of {FRAMES} frames; collect more")
    rng = np.random.default_rng(0)
    errors, cubic = np.zeros((len(held), len(NOISE))), np.zeros(len(held))
    for i, states in enumerate(held):
        begin = rng.integers(len(states) - FRAMES + 1)
        piece = states[begin:begin + FRAMES]
        wanted = np.sort(FIRST + rng.choice(LAST - FIRST, hidden, replace=False))
        seen = np.setdiff1d(np.arange(FRAMES), wanted)
        cubic[i] = np.abs(spline(seen, piece[seen], wanted) - piece[wanted]).mean()
        for n, noise in enumerate(NOISE):
            errors[i, n] = np.abs(process(covariance, noise, seen, piece[seen], wanted) - piece[wanted]).mean()
    best = errors.mean(0).argmin()
    return (errors[:, best] / cubic).mean(), errors[:, best].mean() / cubic.mean()


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("data", nargs="+", help="folders that `robert collect` made")
    p.add_argument("--out", help="also write the table into this file of results/")
    p.add_argument("--commit", default="", help="the commit of the program that recorded the data")
    args = p.parse_args()
    rows = []
    for folder in args.data:
        robot = shards.robot(folder)
        for words, hidden in [("a quarter", 20), ("half", 40)]:
            mean, together = ratios(folder, hidden)
            rows.append([f"`{robot}`, {words} hidden", f"{mean:.2f}", f"{together:.2f}"])
            print(" | ".join(rows[-1]), flush=True)
    if args.out:
        record = {
            "name": pathlib.Path(args.out).stem,
            "kind": "noted",
            "why": "how much nearer than a cubic spline a learned linear interpolation is to hidden frames",
            "commit": args.commit,
            "commands": [
                *map(shards.command, args.data),
                f"target/python/bin/python script/probes/hidden.py {' '.join(args.data)} --out {args.out}",
            ],
            "head": ["error of the learned interpolation / of the spline", "mean of the pieces", "all pieces together"],
            "rows": rows,
        }
        pathlib.Path(args.out).write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
