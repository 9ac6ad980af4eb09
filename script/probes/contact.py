"""Measures whether the history of positions tells that links touch, and whether it helps to infer the action.

    script/python --setup && target/python/bin/pip install safetensors    # once: an environment with numpy
    robert collect --robot shadow_hand --agent babble --transitions 200000 --seed 7 --out data/probe
    target/python/bin/python script/probes/contact.py data/probe --out results/contact

Small networks with two hidden layers, and linear regressions, see one pose, two, or the 31 of a policy's window, some
with the actions that were applied. They say whether links touch in the last of these states, or which action led to
the state after it. Every fifth trajectory is held out. Figures are means over the seeds, with their range in brackets.
"""

import argparse
import json
import pathlib

import numpy as np
import shards

PAST = 30  # frames of history before the current one
BATCH, RATE = 512, 1e-3


class Windows:
    """PAST + 1 states each, the action that follows, the state after it, and touch in the last two states."""

    def __init__(self, folder):
        names = ["past", "pose", "acted", "after", "action", "touch", "later", "held"]
        rows = {name: [] for name in names}
        for number, episode in enumerate(shards.episodes(folder)):
            q, u, c = (episode[k] for k in ("qpos", "ctrl", "self_contact"))
            # Action t leads from state t to state t + 1; touch t is that of state t + 1.
            for t in range(PAST, len(q) - 1, 2):
                found = q[t - PAST:t], q[t], u[t - PAST:t], q[t + 1], u[t], c[t - 1], c[t], number % 5 == 0
                for name, value in zip(names, found):
                    rows[name].append(value)
        if not rows["pose"]:
            raise SystemExit(f"error: {folder} has no trajectory of more than {PAST + 1} frames")
        self.held = np.array(rows.pop("held"))
        for name, values in rows.items():
            setattr(self, name, np.asarray(values, np.float32))

    def inputs(self, history, acted=False, after=False, flag=False):
        """The pose, the differences to `history` earlier ones, actions, the next difference, touch at its end."""
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
        return self.scaled(np.concatenate(columns, 1))

    def scaled(self, x):
        """With mean 0 and deviation 1 over the windows that are learned from."""
        mean, spread = x[~self.held].mean(0), x[~self.held].std(0)
        return (x - mean) / np.maximum(spread, 1e-6)


class Network:
    """Two hidden layers, trained with Adam and a cosine schedule."""

    def __init__(self, seed, inputs, hidden, outputs):
        self.rng = np.random.default_rng(seed)
        sizes = [inputs, hidden, hidden, outputs]
        self.w = [self.rng.normal(0, np.sqrt(2 / a), (a, b)).astype(np.float32) for a, b in zip(sizes, sizes[1:])]
        self.w += [np.zeros(b, np.float32) for b in sizes[1:]]
        self.m = [np.zeros_like(w) for w in self.w]
        self.v = [np.zeros_like(w) for w in self.w]
        self.step = 0

    def layers(self, x):
        layers = [x]
        for i in range(3):
            x = layers[-1] @ self.w[i] + self.w[3 + i]
            layers.append(np.maximum(x, 0) if i < 2 else x)
        return layers

    def learn(self, x, y, wrong, rate):
        """One step on a batch; `wrong` is the gradient of the loss by the outputs."""
        layers = self.layers(x)
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

    def fit(self, x, y, wrong, epochs):
        batches = len(x) // BATCH
        for epoch in range(epochs):
            order = self.rng.permutation(len(x))
            for b in range(batches):
                rows = order[b * BATCH:(b + 1) * BATCH]
                rate = RATE * 0.5 * (1 + np.cos(np.pi * (epoch * batches + b) / (epochs * batches)))
                self.learn(x[rows], y[rows], wrong, rate)
        return self


class Probe:
    """What can be learned from columns of the windows."""

    def __init__(self, data, options):
        self.data, self.options = data, options

    def networks(self, x, y, wrong):
        """Answers for the held-out windows, one seed after another."""
        held, o = self.data.held, self.options
        for seed in range(1, o.seeds + 1):
            network = Network(seed, x.shape[1], o.hidden, y.shape[1])
            yield network.fit(x[~held], y[~held], wrong, o.epochs).layers(x[held])[-1]

    def touch(self, words, **columns):
        """Whether links touch in the last state: share of right answers, area under the ROC curve."""
        truth = self.data.touch[self.data.held]
        wrong = lambda out, want: 1 / (1 + np.exp(-out)) - want  # noqa: E731
        scores = [s[:, 0] for s in self.networks(self.data.inputs(**columns), self.data.touch[:, None], wrong)]
        right = [100 * np.mean((s > 0) == (truth > 0)) for s in scores]
        return [words, with_range(right, ".1f"), with_range([area(s, truth) for s in scores], ".2f")]

    def always(self):
        """The same for the more frequent answer."""
        share = 100 * self.data.touch[self.data.held].mean()
        return ["nothing: always the more frequent answer", f"{max(share, 100 - share):.1f}", ".50"]

    def action(self, words, **columns):
        """Error of the action that leads to the state after, by a linear regression and by networks."""
        data, held = self.data, self.data.held
        x = data.inputs(after=True, **columns)
        mean, spread = data.action[~held].mean(0), data.action[~held].std(0)
        y = (data.action - mean) / spread
        gram = x[~held].T.astype(float) @ x[~held]
        weights = np.linalg.solve(gram + 1e-3 * len(x) * np.eye(len(gram)), x[~held].T.astype(float) @ y[~held])
        linear = [self.errors(mean + spread * (x[held] @ weights))]
        learned = [self.errors(mean + spread * out) for out in self.networks(x, y, lambda out, want: out - want)]
        return [words, *self.cells(linear), *self.cells(learned)]

    def constant(self, words, answer):
        """The same for an answer that looks at no state."""
        return [words, *self.cells([self.errors(answer[self.data.held])]), "", ""]

    def errors(self, answer):
        """Mean absolute error in frames that end free and in frames that end with touch."""
        error = np.abs(answer - self.data.action[self.data.held]).mean(1)
        touching = self.data.later[self.data.held] > 0
        return error[~touching].mean(), error[touching].mean()

    @staticmethod
    def cells(errors):
        return [with_range(column, ".3f") for column in zip(*errors)]


def area(score, truth):
    """Probability that of a random window with touch and one without the first has the higher score."""
    order = np.argsort(score, kind="stable")
    ranks = np.empty(len(score))
    ranks[order] = np.arange(1, len(score) + 1)
    n = truth.sum()
    return (ranks[truth > 0].sum() - n * (n + 1) / 2) / (n * (len(truth) - n))


def with_range(values, form):
    short = lambda x: format(x, form).removeprefix("0")  # noqa: E731
    if len(values) == 1:
        return short(values[0])
    return f"{short(np.mean(values))} ({short(min(values))} to {short(max(values))})"


def table(probe, kind):
    """Head and rows of one of the two tables."""
    data = probe.data
    if kind == "touch":
        yield ["a network sees", "right answers, %", "area under the ROC curve"]
        yield probe.always()
        yield probe.touch("the pose", history=0)
        yield probe.touch("two poses", history=1)
        yield probe.touch("31 poses", history=PAST)
        yield probe.touch("31 poses and the 30 actions between them", history=PAST, acted=True)
    else:
        yield ["seen beside the next pose", "linear, free", "linear, touch", "network, free", "network, touch"]
        mean = np.broadcast_to(data.action[~data.held].mean(0), data.action.shape)
        yield probe.constant("nothing, not even that: the mean action", mean)
        yield probe.constant("only the last action: the same again", data.acted[:, -1])
        yield probe.action("the pose", history=0)
        yield probe.action("two poses", history=1)
        yield probe.action("31 poses", history=PAST)
        yield probe.action("31 poses and whether links touch in the next one", history=PAST, flag=True)
        yield probe.action("31 poses and the 30 actions between them", history=PAST, acted=True)


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("data", help="a folder that `robert collect` made")
    p.add_argument("--hidden", type=int, default=256, help="width of both hidden layers")
    p.add_argument("--epochs", type=int, default=10, help="passes over the windows")
    p.add_argument("--seeds", type=int, default=3, help="networks for each row")
    p.add_argument("--out", help="also write the two tables into files with this beginning, in results/")
    p.add_argument("--commit", default="", help="the commit of the program that recorded the data")
    args = p.parse_args()
    data = Windows(args.data)
    print(f"{len(data.pose)} windows, {data.held.sum()} held out, links touch in {100 * data.touch.mean():.1f} %")

    why = {
        "touch": "whether the history of positions tells that links touch",
        "action": "whether it helps to infer the action; mean absolute error, actions from -1 to 1",
    }
    for kind, reason in why.items():
        rows = []
        for row in table(Probe(data, args), kind):
            rows.append(row)
            print(" | ".join(row), flush=True)
        if args.out:
            path = pathlib.Path(f"{args.out}-{kind}.json")
            options = f"--hidden {args.hidden} --epochs {args.epochs} --seeds {args.seeds} --out {args.out}"
            record = {
                "name": path.stem, "kind": "noted", "why": reason, "commit": args.commit,
                "commands": [
                    shards.command(args.data),
                    f"target/python/bin/python script/probes/contact.py {args.data} {options}",
                ],
                "head": rows[0], "rows": rows[1:],
            }
            path.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
