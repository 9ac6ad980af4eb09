"""This engine against PyTorch on the same machine, in turns.

    python benches/peers/compare.py --robert target/release/robert [--threads 2] [--compile]

Prints, for training at S, M (batch 256) and L (batch 16) and for inference at batch 1, the
median wall and processor time of a step of each, and the ratio PyTorch / ours (above 1:
ours is faster). With --device cuda it times training on a graphics card, here by CUDA, there by
Vulkan, in 32 bits and, with --half, with 16-bit factors (PyTorch's autocast to float16 and its
gradient scaler). PyTorch runs the model of model.py with AdamW and clipping, eager and, with
--compile, through torch.compile; the faster one counts. For one action PyTorch computes all
frames of the last layer and picks the current one, the engine only what that frame needs; the
engine's figure includes features and linear prediction, PyTorch's does not.
"""

import argparse
import json
import resource
import statistics
import subprocess
import sys
import time

import torch

import model


def cpu():
    r = resource.getrusage(resource.RUSAGE_SELF)
    return r.ru_utime + r.ru_stime


def trainer(cfg, batch, compiled, device="cpu", half=False):
    w = {n: x.detach().to(device).requires_grad_() for n, x in model.fresh(cfg).items()}
    decay = [x for n, x in w.items() if n.endswith("weight") and x.dim() == 2]
    rest = [x for n, x in w.items() if not (n.endswith("weight") and x.dim() == 2)]
    opt = torch.optim.AdamW(
        [{"params": decay, "weight_decay": 0.1}, {"params": rest, "weight_decay": 0.0}],
        lr=1e-4, betas=(0.9, 0.95), fused=True)
    tokens = torch.randn(batch, model.WINDOW, cfg["inputs"], device=device)
    masked = torch.zeros(batch, model.WINDOW, device=device)
    actions = torch.zeros(batch, model.WINDOW, cfg["actions"], device=device)
    weight = torch.ones(batch, model.WINDOW, device=device)
    centres = torch.zeros(1, cfg["actions"], device=device)
    scaler = torch.amp.GradScaler(device, enabled=half)

    def value():
        with torch.autocast(device, torch.float16, enabled=half):
            out = model.forward(w, cfg, tokens, masked)
        return model.loss(cfg, out.float(), centres, actions, None, weight, False)

    value = torch.compile(value) if compiled else value

    def step():
        opt.zero_grad(set_to_none=True)
        scaler.scale(value()).backward()
        scaler.unscale_(opt)
        torch.nn.utils.clip_grad_norm_(w.values(), 1.0)
        scaler.step(opt)
        scaler.update()
        if device != "cpu":
            torch.cuda.synchronize()

    return step


def actor(cfg, compiled):
    w = {n: x.detach() for n, x in model.fresh(cfg).items()}
    tokens, masked = torch.randn(1, model.WINDOW, cfg["inputs"]), torch.zeros(1, model.WINDOW)
    forward = lambda: model.forward(w, cfg, tokens, masked)[:, model.CURRENT]
    forward = torch.compile(forward) if compiled else forward

    def step():
        with torch.inference_mode():
            forward()

    return step


def clock(step, secs):
    """Medians of (wall, processor) seconds of a step."""
    wall, spent = [], []
    end = time.perf_counter() + secs
    while time.perf_counter() < end or len(wall) < 3:
        c, t = cpu(), time.perf_counter()
        step()
        wall.append(time.perf_counter() - t)
        spent.append(cpu() - c)
    return statistics.median(wall), statistics.median(spent)


def ours(robert, *args):
    out = subprocess.run([robert, "bench", *args, "--json"], check=True, capture_output=True)
    return json.loads(out.stdout)["sizes"][0]


def main():
    p = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    p.add_argument("--robert", default="target/release/robert")
    p.add_argument("--threads", type=int, default=2)
    p.add_argument("--turns", type=int, default=3)
    p.add_argument("--secs", type=float, default=4)
    p.add_argument("--compile", action="store_true", help="also time torch.compile")
    p.add_argument("--sizes", default="S,M,L")
    p.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    p.add_argument("--half", action="store_true", help="16-bit factors on the card")
    p.add_argument("--batch", type=int, help="windows of a step [256, or 16 at size L]")
    p.add_argument("--json", action="store_true")
    a = p.parse_args()
    card = a.device != "cpu"
    if a.half and not card:
        p.error("--half is for --device cuda")
    extra = ["--device", "gpu"] * card + ["--half"] * a.half
    torch.set_num_threads(a.threads)
    modes = ["eager", "compile"] if a.compile else ["eager"]
    rows = []
    for name in a.sizes.split(","):
        cfg, batch = model.size(name), a.batch or (16 if name == "L" else 256)
        for job in ["train"] if card else ["train", "infer"]:
            steps = {m: trainer(cfg, batch, m == "compile", a.device, a.half) if job == "train"
                     else actor(cfg, m == "compile") for m in modes}
            for step in steps.values():
                step(), step()
            peer, own = {m: [] for m in modes}, []
            for _ in range(a.turns):
                for m in modes:
                    peer[m].append(clock(steps[m], a.secs))
                batches = ["--batch", str(batch)] if job == "train" else []
                r = ours(a.robert, job, "--size", name.lower(), "--secs", str(a.secs),
                         "--threads", str(a.threads), *batches, *extra)
                own.append((r["wall_ms_per_step"], r.get("cpu_ms_per_step", 0)) if job == "train"
                           else (r["ms"], r["cpu_ms"]))
            mid = lambda pairs, i: statistics.median(x[i] for x in pairs)
            best = min(modes, key=lambda m: mid(peer[m], 0))
            row = dict(
                job=job, size=name, batch=batch if job == "train" else 1, pytorch=best,
                pytorch_wall_ms=1e3 * mid(peer[best], 0), pytorch_cpu_ms=1e3 * mid(peer[best], 1),
                wall_ms=mid(own, 0), cpu_ms=mid(own, 1))
            row["wall_ratio"] = row["pytorch_wall_ms"] / row["wall_ms"]
            row["cpu_ratio"] = row["pytorch_cpu_ms"] / row["cpu_ms"] if row["cpu_ms"] else None
            rows.append(row)
            if not a.json and card:
                print(f"{job} {name} batch {row['batch']} on {torch.cuda.get_device_name()}: "
                      f"PyTorch ({best}) {row['pytorch_wall_ms']:.1f} ms, "
                      f"ours {row['wall_ms']:.1f} ms, ratio {row['wall_ratio']:.2f}", flush=True)
            elif not a.json:
                print(f"{job} {name} batch {row['batch']}: PyTorch ({best}) "
                      f"{row['pytorch_wall_ms']:.2f} ms wall, {row['pytorch_cpu_ms']:.2f} cpu; "
                      f"ours {row['wall_ms']:.2f} wall, {row['cpu_ms']:.2f} cpu; "
                      f"ratio {row['wall_ratio']:.2f} wall, {row['cpu_ratio']:.2f} cpu", flush=True)
    if a.json:
        json.dump(rows, sys.stdout, indent=2)


if __name__ == "__main__":
    main()
