"""Measures whether the history of positions tells that links touch, and whether that helps to infer the torque.

    script/python --setup                          # once: an environment with numpy
    robert collect --robot shadow_hand --agent babble --transitions 200000 --seed 7 --out data/probe
    target/python/bin/python script/probes/contact.py data/probe --out results/contact-probe.json

Small networks (two hidden layers of 128) see the pose alone, two poses, or the 31 of the paper's window, some with the
actions that were applied. They predict whether links touch in the last state, and which action led to the next state.
Every fifth episode is held out. Each network is trained with three seeds; the table has mean and range.
"""

import argparse
import json
import pathlib

import numpy as np

import shards

PAST = 30  # frames of history before the current one
HIDDEN, BATCH, EPOCHS, RATE = 128, 512, 6, 1e-3
SEEDS = (1, 2, 3)


class Windows:
    """Windows of PAST + 1 states, the action that follows, the state after it, and touch at both ends."""

    def __init__(self, folder):
        past, pose, acted, after, action, touch, later, held = [], [], [], [], [], [], [], []
        for number, episode in enumerate(shards.episodes(folder)):
            q, u, c = (episode[k] for k in ("qpos", "ctrl", "self_contact"))
            # Touch of frame t is that of state t + 1.
            for t in range(PAST, len(q) - 1, 3):
                past.append(q[t - PAST:t])
                pose.append(q[t])
                acted.append(u[t - PAST:t])
                after.append(q[t + 1])
                action.append(u[t])
                touch.append(c[t - 1])
                later.append(c[t])
                held.append(number % 5 == 0)
        if not pose:
            raise SystemExit(f"error: {folder} has no episode of more than {PAST + 1} frames")
        stack = lambda rows: np.asarray(rows, np.float32)  # noqa: E731
        self.past, self.pose, self.acted, self.after = map(stack, (past, pose, acted, after))
        self.action, self.touch, self.later = map(stack, (action, touch, later))
        self.held = np.array(held)

    def inputs(self, history, acted=False, after=False, flag=False):
        """Columns: the pose, differences to `history` earlier poses, actions, the next step, the touch at its end."""
        n = len(self.pose)
        columns = [self.pose]
        # Differences, because one frame changes a pose by little of its range.
        if history:
            states = np.concatenate([self.past, self.pose[:, None]], 1)
            columns.append(np.diff(states, axis=1)[:, -history:].reshape(n, -1))
        if acted:
            columns.append(self.acted[:, -history:].reshape(n, -1))
        if after:
            columns.append(self.after - self.pose)
        if flag:
            columns.append(self.later[:, None])
        return np.concatenate(columns, 1)


class Network:
    """Two hidden layers, trained with Adam; `outputs` are logits or values."""

    def __init__(self, seed, inputs, outputs):
        self.rng = np.random.default_rng(seed)
        sizes = [inputs, HIDDEN, HIDDEN, outputs]
        self.w = [self.rng.normal(0, np.sqrt(2 / a), (a, b)).astype(np.float32) for a, b in zip(sizes, sizes[1:])]
        self.w += [np.zeros(b, np.float32) for b in sizes[1:]]
        self.m = [np.zeros_like(w) for w in self.w]
        self.v = [np.zeros_like(w) for w in self.w]
        self.step = 0

    def forward(self, x):
        layers = [x]
        for i in range(3):
            x = layers[-1] @ self.w[i] + self.w[3 + i]
            layers.append(np.maximum(x, 0) if i < 2 else x)
        return layers

    def learn(self, x, y, wrong, rate):
        """One step on a batch; `wrong` is the gradient of the loss by the outputs."""
        layers = self.forward(x)
        slope = wrong(layers[-1], y) / len(x)
        grads = [None] * 6
        for i in (2, 1, 0):
            grads[i], grads[3 + i] = layers[i].T @ slope, slope.sum(0)
            if i:
                slope = (slope @ self.w[i].T) * (layers[i] > 0)
        self.step += 1
        for w, g, m, v in zip(self.w, grads, self.m, self.v):
            m += 0.1 * (g - m)
            v += 0.001 * (g * g - v)
            w -= rate * (m / (1 - 0.9**self.step)) / (np.sqrt(v / (1 - 0.999**self.step)) + 1e-8)

    def fit(self, x, y, wrong):
        batches = len(x) // BATCH
        for epoch in range(EPOCHS):
            order = self.rng.permutation(len(x))
            for b in range(batches):
                rows = order[b * BATCH:(b + 1) * BATCH]
                rate = RATE * 0.5 * (1 + np.cos(np.pi * (epoch * batches + b) / (EPOCHS * batches)))
                self.learn(x[rows], y[rows], wrong, rate)
        return self

    def predict(self, x):
        return self.forward(x)[-1]


def scaled(x, held):
    mean, spread = x[~held].mean(0), x[~held].std(0)
    return (x - mean) / np.maximum(spread, 1e-6)


def auc(score, truth):
    """Probability that a frame with touch has the higher score of a random pair."""
    order = np.argsort(score, kind="stable")
    ranks = np.empty(len(score))
    ranks[order] = np.arange(1, len(score) + 1)
    n = truth.sum()
    return (ranks[truth > 0].sum() - n * (n + 1) / 2) / (n * (len(truth) - n))


def touch_row(data, words, **columns):
    """How well touch in the last state is told from the columns."""
    x, y, held = scaled(data.inputs(**columns), data.held), data.touch[:, None], data.held
    wrong = lambda out, want: 1 / (1 + np.exp(-out)) - want  # noqa: E731
    right, areas = [], []
    for seed in SEEDS:
        score = Network(seed, x.shape[1], 1).fit(x[~held], y[~held], wrong).predict(x[held])[:, 0]
        right.append(np.mean((score > 0) == (data.touch[held] > 0)))
        areas.append(auc(score, data.touch[held]))
    return [words, percent(right), spread(areas), "", ""]


def action_row(data, words, **columns):
    """How well the action is inferred from the columns and the state after it."""
    x, y, held = scaled(data.inputs(after=True, **columns), data.held), data.action, data.held
    wrong = lambda out, want: out - want  # noqa: E731
    free, touching = [], []
    for seed in SEEDS:
        out = Network(seed, x.shape[1], y.shape[1]).fit(x[~held], y[~held], wrong).predict(x[held])
        error = np.abs(out - y[held]).mean(1)
        free.append(error[data.later[held] == 0].mean())
        touching.append(error[data.later[held] > 0].mean())
    return [words, "", "", spread(free), spread(touching)]


def short(x):
    return f"{x:.3f}".lstrip("0")


def spread(values):
    return f"{short(np.mean(values))} ({short(min(values))} to {short(max(values))})"


def percent(values):
    return f"{100 * np.mean(values):.1f} % ({100 * min(values):.1f} to {100 * max(values):.1f})"


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("data", help="a folder that `robert collect` made")
    p.add_argument("--out", help="also write the table into this file of results/")
    p.add_argument("--commit", default="", help="the commit of the program that recorded the data")
    args = p.parse_args()
    data = Windows(args.data)
    print(f"{len(data.pose)} windows, {data.held.sum()} held out, links touch in {100 * data.touch.mean():.1f} %")

    rows = []
    for make, words, columns in [
        (touch_row, "the pose", dict(history=0)),
        (touch_row, "the pose and the one before", dict(history=1)),
        (touch_row, "31 poses", dict(history=PAST)),
        (touch_row, "31 poses and the 30 actions between them", dict(history=PAST, acted=True)),
        (action_row, "the pose and the one after", dict(history=0)),
        (action_row, "one before, the pose, the one after", dict(history=1)),
        (action_row, "31 poses and the one after", dict(history=PAST)),
        (action_row, "the same with the 30 actions", dict(history=PAST, acted=True)),
        (action_row, "31 poses, the one after, and whether links touch", dict(history=PAST, flag=True)),
    ]:
        rows.append(make(data, words, **columns))
        print(" | ".join(rows[-1]), flush=True)
    if args.out:
        record = {
            "name": pathlib.Path(args.out).stem,
            "kind": "noted",
            "why": "whether the history of positions tells contact",
            "commit": args.commit,
            "commands": [
                "robert collect --robot shadow_hand --agent babble --transitions 200000 --seed 7 --out data/probe",
                "target/python/bin/python script/probes/contact.py data/probe --out results/contact-probe.json",
            ],
            "head": ["a small network sees", "says rightly whether links touch", "area under its ROC curve",
                     "error of the action, free", "error of the action, links touch"],
            "rows": rows,
        }
        pathlib.Path(args.out).write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
