"""The motion in a folder that `robert collect` made, for scripts with numpy."""

import json
import pathlib
import struct

import numpy as np

KINDS = {"F32": "<f4", "U8": "u1", "I64": "<i8"}


def tensors(path):
    """The tensors of a safetensors file by name."""
    raw = path.read_bytes()
    (length,) = struct.unpack("<Q", raw[:8])
    header, body = json.loads(raw[8:8 + length]), memoryview(raw)[8 + length:]
    found = {}
    for name, t in header.items():
        if name != "__metadata__":
            start, end = t["data_offsets"]
            found[name] = np.frombuffer(body[start:end], KINDS[t["dtype"]]).reshape(t["shape"])
    return found


def episodes(folder):
    """`qpos` (T, S), `ctrl` (T, A) and `self_contact` (T) of one trajectory after another."""
    for path in sorted((pathlib.Path(folder) / "shards").glob("*.safetensors")):
        data = tensors(path)
        offsets = data["episode_offsets"]
        for first, end in zip(offsets[:-1], offsets[1:]):
            yield {name: data[name][first:end] for name in ("qpos", "ctrl", "self_contact")}


def request(folder):
    return json.loads((pathlib.Path(folder) / "collect.json").read_text())


def robot(folder):
    """The id of the robot that moved."""
    return request(folder)["robot"]


def command(folder):
    """The command that recorded the folder."""
    config = request(folder)["config"]
    agents = ",".join(config["agents"])
    return (f"robert collect --robot {robot(folder)} --agent {agents} --transitions {config['transitions']}"
            f" --seed {config['seed']} --out {folder}")
