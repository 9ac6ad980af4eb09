"""Processor time of one update of each curious agent in PyTorch, on one thread.

The same sizes, losses and order of work as `robert bench collect` (preset url-fast), so that
the two can be run in turns:

    robert bench collect --robot ur5e --json; python benches/peers/explore.py --state 5 --act 5

Needs torch.
"""

import argparse
import json
import time

import torch
from torch import nn
from torch.nn import functional as F


def mlp(*sizes, last=None):
    layers = []
    for i, (a, b) in enumerate(zip(sizes, sizes[1:])):
        layers.append(nn.Linear(a, b))
        if i + 2 < len(sizes):
            layers.append(nn.ReLU())
    if last:
        layers.append(last)
    return nn.Sequential(*layers)


class Ddpg:
    def __init__(self, o, a, k, h):
        trunk = lambda i: nn.Sequential(nn.Linear(i, h), nn.LayerNorm(h), nn.Tanh())
        self.k = k
        self.actor = nn.Sequential(trunk(o + k), mlp(h, h, a, last=nn.Tanh()))
        make = lambda: nn.ModuleList([trunk(o + k + a), mlp(h, h, max(k, 1)), mlp(h, h, max(k, 1))])
        self.critic, self.target = make(), make()
        self.target.load_state_dict(self.critic.state_dict())
        self.actor_opt = torch.optim.Adam(self.actor.parameters(), lr=1e-4)
        self.critic_opt = torch.optim.Adam(self.critic.parameters(), lr=1e-4)

    def q(self, net, s, a, w):
        x = net[0](torch.cat([s, a], -1))
        return [(head(x) * w).sum(-1, keepdim=True) if self.k else head(x) for head in net[1:]]

    def act(self, s):
        mu = self.actor(s)
        x = mu + (torch.randn_like(mu) * 0.2).clamp(-0.3, 0.3)
        return x - x.detach() + x.detach().clamp(-1 + 1e-6, 1 - 1e-6)

    def update(self, s, a, r, n, w):
        if self.k:
            s, n = torch.cat([s, w], -1), torch.cat([n, w], -1)
        with torch.no_grad():
            y = r + 0.99**3 * torch.min(*self.q(self.target, n, self.act(n), w))
        q1, q2 = self.q(self.critic, s, a, w)
        loss = F.mse_loss(q1, y) + F.mse_loss(q2, y)
        self.critic_opt.zero_grad(set_to_none=True)
        loss.backward()
        self.critic_opt.step()
        loss = -torch.min(*self.q(self.critic, s, self.act(s), w)).mean()
        self.actor_opt.zero_grad(set_to_none=True)
        loss.backward()
        self.actor_opt.step()
        with torch.no_grad():
            for slow, fast in zip(self.target.parameters(), self.critic.parameters()):
                slow.lerp_(fast, 0.01)


class Rms:
    def __init__(self):
        self.mean, self.var, self.n = torch.zeros(1), torch.ones(1), 1e-4

    def __call__(self, x):
        b, d = x.shape[0], x.mean(0) - self.mean
        self.var = (self.var * self.n + x.var(0) * b + d**2 * self.n * b / (self.n + b)) / (self.n + b)
        self.mean = self.mean + d * b / (self.n + b)
        self.n += b


def pbe(rep, rms=None, clip=0.0):
    d = torch.cdist(rep, rep).topk(12, dim=1, largest=False).values
    if rms:
        rms(d.reshape(-1, 1))
        d = d / rms.mean
    return torch.log1p((d - clip).clamp_min(0).mean(1, keepdim=True))


class Rnd:
    def __init__(self, o, a, h):
        self.norm = nn.BatchNorm1d(o, affine=False)
        self.f, self.goal = mlp(o, h, h, 512), mlp(o, h, h, 512)
        self.opt, self.rms = torch.optim.Adam(self.f.parameters(), lr=1e-4), Rms()

    def error(self, s):
        x = self.norm(s).clamp(-5, 5)
        with torch.no_grad():
            goal = self.goal(x)
        return (self.f(x) - goal).square().mean(-1, keepdim=True)

    def update(self, s, a, n, w):
        loss = self.error(s).mean()
        self.opt.zero_grad(set_to_none=True)
        loss.backward()
        self.opt.step()
        with torch.no_grad():
            e = self.error(s)
            self.rms(e)
            return e / (self.rms.var.sqrt() + 1e-8)


class Icm:
    def __init__(self, o, a, h):
        self.trunk = None
        self.build(o, a, h)

    def build(self, o, a, h):
        self.forward, self.inverse = mlp(o + a, h, o), mlp(2 * o, h, a, last=nn.Tanh())
        nets = [self.forward, self.inverse] + ([self.trunk] if self.trunk else [])
        self.opt = torch.optim.Adam([p for n in nets for p in n.parameters()], lr=1e-4)

    def errors(self, s, a, n):
        if self.trunk:
            s, n = self.trunk(s), self.trunk(n)
        e = (n - self.forward(torch.cat([s, a], -1))).norm(dim=-1, keepdim=True)
        return e, (a - self.inverse(torch.cat([s, n], -1))).norm(dim=-1, keepdim=True)

    def step(self, s, a, n):
        loss = sum(e.mean() for e in self.errors(s, a, n))
        self.opt.zero_grad(set_to_none=True)
        loss.backward()
        self.opt.step()

    def update(self, s, a, n, w):
        self.step(s, a, n)
        with torch.no_grad():
            e = (n - self.forward(torch.cat([s, a], -1))).norm(dim=-1, keepdim=True)
            return torch.log1p(e)


class Apt(Icm):
    def __init__(self, o, a, h):
        self.trunk = nn.Sequential(nn.Linear(o, 512), nn.LayerNorm(512), nn.Tanh())
        self.build(512, a, h)

    def update(self, s, a, n, w):
        self.step(s, a, n)
        with torch.no_grad():
            return pbe(self.trunk(s))


class Aps:
    def __init__(self, o, a, h):
        self.phi, self.rms = mlp(o, h, h, 10), Rms()
        self.opt = torch.optim.Adam(self.phi.parameters(), lr=1e-4)

    def update(self, s, a, n, w):
        loss = -(F.normalize(self.phi(n), dim=-1) * w).sum(-1).mean()
        self.opt.zero_grad(set_to_none=True)
        loss.backward()
        self.opt.step()
        with torch.no_grad():
            y = self.phi(n)
            return pbe(y, self.rms, 1e-4) + (F.normalize(y, dim=-1) * w).sum(-1, keepdim=True)


class Proto:
    def __init__(self, o, a, h):
        self.pred, self.slow = nn.Linear(o, 128), nn.Linear(o, 128)
        self.slow.load_state_dict(self.pred.state_dict())
        self.proj, self.protos = mlp(128, 512, 128), nn.Linear(128, 512, bias=False)
        self.queue, self.at = torch.zeros(2048, 128), 0
        nets = [self.pred, self.proj, self.protos]
        self.opt = torch.optim.Adam([p for n in nets for p in n.parameters()], lr=1e-4)

    def update(self, s, a, n, w):
        with torch.no_grad():
            self.protos.weight.copy_(F.normalize(self.protos.weight, dim=1))
            x = self.protos(F.normalize(self.slow(n), dim=1)) / 0.1
            q = torch.exp(x - x.max()).T
            q /= q.sum()
            for _ in range(3):
                q *= (1 / q.shape[0] / q.sum(1)).unsqueeze(1)
                q *= (1 / q.shape[1] / q.sum(0)).unsqueeze(0)
            q = (q / q.sum(0, keepdim=True)).T
        z = F.normalize(self.proj(self.pred(s)), dim=1)
        loss = -(q * F.log_softmax(self.protos(z) / 0.1, dim=1)).sum(1).mean()
        self.opt.zero_grad(set_to_none=True)
        loss.backward()
        self.opt.step()
        with torch.no_grad():
            z = F.normalize(self.pred(n), dim=1)
            pick = torch.distributions.Categorical(F.softmax(self.protos(z).T, dim=1)).sample()
            self.queue[self.at : self.at + 512] = z[pick]
            self.at = (self.at + 512) % 2048
            reward = torch.cdist(z, self.queue).topk(3, dim=1, largest=False).values[:, -1:]
            for slow, fast in zip(self.slow.parameters(), self.pred.parameters()):
                slow.lerp_(fast, 0.05)
            return reward


def main():
    args = argparse.ArgumentParser()
    args.add_argument("--state", type=int, default=5)
    args.add_argument("--act", type=int, default=5)
    args.add_argument("--hidden", type=int, default=128)
    args.add_argument("--batch", type=int, default=256)
    args.add_argument("--turns", type=int, default=5)
    args.add_argument("--updates", type=int, default=20)
    args = args.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(1)
    o, a, h, b = 2 * args.state, args.act, args.hidden, args.batch
    result = {}
    for name, kind in {"rnd": Rnd, "icm": Icm, "apt": Apt, "aps": Aps, "proto": Proto}.items():
        k = 10 if name == "aps" else 0
        agent, module = Ddpg(o, a, k, h), kind(o, a, h)
        s, n, act, w = (torch.rand(b, d) * 2 - 1 for d in (o, o, a, k))
        times = []
        for turn in range(args.turns + 1):
            start = time.thread_time()
            for _ in range(args.updates):
                agent.update(s, act, module.update(s, act, n, w), n, w)
            times.append((time.thread_time() - start) * 1e3 / args.updates)
        result[name] = round(sorted(times[1:])[args.turns // 2], 3)
    print(json.dumps({"torch": torch.__version__, "update_cpu_ms": result}))


if __name__ == "__main__":
    main()
