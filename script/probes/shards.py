"""The motion in a folder that `robert collect` made, for scripts with numpy and safetensors."""

import json
import pathlib

from safetensors.numpy import load_file


def episodes(folder):
    """`qpos` (T, S), `ctrl` (T, A) and `self_contact` (T) of one trajectory after another."""
    for path in sorted((pathlib.Path(folder) / "shards").glob("*.safetensors")):
        data = load_file(path)
        offsets = data["episode_offsets"]
        for first, end in zip(offsets[:-1], offsets[1:]):
            yield {name: data[name][first:end] for name in ("qpos", "ctrl", "self_contact")}


def request(folder):
    """What the collection was asked for."""
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
