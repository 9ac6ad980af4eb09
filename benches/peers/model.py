"""The network of `src/net`, written independently in PyTorch.

One file, no dependency but torch. Weights of linear maps lie as (inputs, outputs), as in
the model files, so every product is `x @ w`.
"""

import json
import math
import struct

import torch
import torch.nn.functional as F

WINDOW, CURRENT = 51, 30


def read_safetensors(path):
    """Tensors by name, and the metadata."""
    with open(path, "rb") as f:
        data = bytearray(f.read())
    (n,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + n])
    kinds = {"F32": torch.float32, "F64": torch.float64}
    tensors = {}
    for name, t in header.items():
        if name == "__metadata__":
            continue
        a, b = (8 + n + x for x in t["data_offsets"])
        flat = torch.frombuffer(data[a:b], dtype=kinds[t["dtype"]]) if b > a else torch.empty(0)
        tensors[name] = flat.reshape(t["shape"]).clone()
    return tensors, header.get("__metadata__", {})


def shapes(cfg):
    """Names and shapes of all weights."""
    d, k, a = cfg["width"], cfg["bins"], cfg["actions"]
    outputs = k * (1 + a) + (a if cfg["skip"] == "gated" else 0)
    yield "embed.weight", (cfg["inputs"], d)
    yield "embed.bias", (d,)
    yield "position", (WINDOW, d)
    yield "mask", (d,)
    for i in range(cfg["layers"]):
        alone = cfg.get("mixing") == "none"
        for name, shape in [
            ("ln1.weight", (d,)), ("ln1.bias", (d,)),
            ("qkv.weight", (d, 3 * d)), ("qkv.bias", (3 * d,)),
            ("out.weight", (d, d)), ("out.bias", (d,)),
            ("ln2.weight", (d,)), ("ln2.bias", (d,)),
            ("up.weight", (d, 4 * d)), ("up.bias", (4 * d,)),
            ("down.weight", (4 * d, d)), ("down.bias", (d,)),
        ]:
            if not (alone and name.split(".")[0] in ("ln1", "qkv", "out")):
                yield f"layers.{i}.{name}", shape
    yield "norm.weight", (d,)
    yield "norm.bias", (d,)
    yield "head.weight", (d, outputs)
    yield "head.bias", (outputs,)


def forward(w, cfg, tokens, masked):
    """Raw head output, (B, 51, outputs)."""
    d, heads = cfg["width"], cfg["heads"]
    x = tokens @ w["embed.weight"] + w["embed.bias"]
    m = masked.unsqueeze(-1)
    x = torch.where(m > 0, w["mask"].expand_as(x), x) if cfg["mask_replaces"] else x + m * w["mask"]
    x = x + w["position"]
    b = x.shape[0]
    for i in range(cfg["layers"]):
        p = lambda name: w[f"layers.{i}.{name}"]
        if cfg.get("mixing") != "none":
            y = F.layer_norm(x, (d,), p("ln1.weight"), p("ln1.bias"))
            qkv = y @ p("qkv.weight") + p("qkv.bias")
            q, k, v = qkv.view(b, WINDOW, 3, heads, d // heads).permute(2, 0, 3, 1, 4)
            y = F.scaled_dot_product_attention(q, k, v)
            x = x + y.transpose(1, 2).reshape(b, WINDOW, d) @ p("out.weight") + p("out.bias")
        y = F.layer_norm(x, (d,), p("ln2.weight"), p("ln2.bias"))
        y = F.gelu(y @ p("up.weight") + p("up.bias"))
        x = x + y @ p("down.weight") + p("down.bias")
    x = F.layer_norm(x, (d,), w["norm.weight"], w["norm.bias"])
    return x @ w["head.weight"] + w["head.bias"]


def loss(cfg, out, centres, actions, linear, weight, current_only):
    """Focal loss of the bin and squared error of the true bin's offset."""
    k, a = cfg["bins"], cfg["actions"]
    logits, offsets = out[..., :k], out[..., k : k + k * a].unflatten(-1, (k, a))
    bin_ = (actions.unsqueeze(-2) - centres).square().sum(-1).argmin(-1)
    offset = offsets.gather(-2, bin_[..., None, None].expand(*bin_.shape, 1, a)).squeeze(-2)
    guess = centres[bin_] + offset
    if cfg["skip"] == "additive":
        guess = guess + linear
    elif cfg["skip"] == "gated":
        guess = guess + (1 + out[..., k + k * a :]) * linear
    each = (guess - actions).square().mean(-1)
    if k > 1:
        log_p = F.log_softmax(logits, -1).gather(-1, bin_.unsqueeze(-1)).squeeze(-1)
        each = cfg["offset_weight"] * each - (1 - log_p.exp()).square() * log_p
    each = each * weight
    return each[:, CURRENT].mean() if current_only else each.mean()


def flop(cfg):
    """Floating-point operations of one training window: three times the forward pass."""
    d, n = cfg["width"], cfg["layers"]
    return 3 * (24 * d * d * n * WINDOW + 4 * WINDOW * WINDOW * d * n)


def fresh(cfg, seed=0):
    """Weights as a new network has them."""
    g = torch.Generator().manual_seed(seed)
    w = {}
    for name, shape in shapes(cfg):
        if name.endswith("bias"):
            w[name] = torch.zeros(shape)
        elif "ln" in name or name == "norm.weight":
            w[name] = torch.ones(shape)
        else:
            w[name] = 0.02 * torch.randn(shape, generator=g)
    return {k: v.requires_grad_() for k, v in w.items()}


def size(name):
    """The benchmark sizes."""
    layers, width, heads = {"S": (4, 128, 4), "M": (6, 256, 8), "L": (6, 768, 6)}[name]
    return dict(
        layers=layers, width=width, heads=heads, inputs=64, actions=6, bins=1,
        offset_weight=10.0, mask_replaces=False, skip="off",
    )


assert math.isclose(sum(math.prod(s) for _, s in shapes(
    dict(size("L"), inputs=5, actions=5, bins=10))), 42_619_452)
