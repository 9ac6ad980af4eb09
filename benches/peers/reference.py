"""Does the engine agree with PyTorch? Loss and every gradient, in f64, every variant.

    robert bench reference --out DIR
    python benches/peers/reference.py DIR
"""

import json
import pathlib
import sys

import torch

import model


def check(path):
    t, meta = model.read_safetensors(path)
    settings = json.loads(meta["exchange"])
    cfg = settings["net"]
    w = {name: t["weight." + name].requires_grad_() for name, _ in model.shapes(cfg)}
    out = model.forward(w, cfg, t["tokens"], t["masked"])
    value = model.loss(cfg, out, t["centres"], t["actions"], t.get("linear"),
                       t["token_weight"], settings["current_only"])
    value.backward()
    worst = abs(value.item() / t["loss"].item() - 1)
    for name, x in w.items():
        ours = t["grad." + name]
        norm = x.grad.norm().item()
        error = (ours - x.grad).norm().item() / max(norm, 1e-12)
        worst = max(worst, error)
        if norm == 0 or error > 1e-5:
            print(f"  {name}: relative error {error:.2e}, norm {norm:.2e}")
    return worst


torch.set_num_threads(1)
files = sorted(pathlib.Path(sys.argv[1]).glob("*.safetensors"))
failed = not files
for path in files:
    worst = check(path)
    failed |= not worst <= 1e-5
    print(f"{path.stem:32} worst relative error {worst:.1e}")
print("FAILED" if failed else f"all {len(files)} variants agree to 1e-5")
sys.exit(failed)
