"""Reads a dataset with Python's safetensors and checks it against its manifest.

Run with: python tests/peers/dataset.py DATA      (needs numpy and safetensors)
"""

import hashlib
import json
import pathlib
import sys

import numpy as np
from safetensors import safe_open


def main(folder):
    folder = pathlib.Path(folder)
    manifest = json.loads((folder / "manifest.json").read_text())
    joints, actuators = len(manifest["robot"]["joints"]), len(manifest["robot"]["actuators"])
    shards, low, high = [], np.full(joints, np.inf), np.full(joints, -np.inf)
    for entry in manifest["shards"]:
        path = folder / entry["file"]
        assert hashlib.sha256(path.read_bytes()).hexdigest() == entry["sha256"], path
        with safe_open(path, framework="numpy") as file:
            header = json.loads(file.metadata()["robert"])
            tensors = {name: file.get_tensor(name) for name in file.keys()}
        frames = entry["frames"]
        assert tensors["qpos"].shape == tensors["qvel"].shape == (frames, joints)
        assert tensors["ctrl"].shape == (frames, actuators)
        assert tensors["self_contact"].shape == (frames,)
        offsets = tensors["episode_offsets"]
        assert offsets[0] == 0 and offsets[-1] == frames and (np.diff(offsets) > 0).all()
        assert len(header["agents"]) == len(offsets) - 1 == len(tensors["episode_seed"])
        assert all(np.isfinite(tensors[name]).all() for name in ("qpos", "qvel", "ctrl"))
        assert (np.abs(tensors["ctrl"]) <= 1).all()
        shards.append((header, tensors))
    total = 0
    for episode in manifest["episodes"]:
        header, tensors = shards[episode["shard"]]
        start, length = episode["start"], episode["length"]
        at = int(np.searchsorted(tensors["episode_offsets"], start))
        assert tensors["episode_offsets"][at] == start
        assert tensors["episode_offsets"][at + 1] == start + length
        assert header["agents"][at] == episode["agent"]
        assert tensors["episode_seed"][at] == episode["seed"]
        assert tensors["episode_snapshot"][at] == episode["snapshot_step"]
        qpos = tensors["qpos"][start : start + length]
        low, high = np.minimum(low, qpos.min(0)), np.maximum(high, qpos.max(0))
        total += length
    assert total == manifest["totals"]["frames"]
    assert np.allclose(low, manifest["statistics"]["qpos_min"])
    assert np.allclose(high, manifest["statistics"]["qpos_max"])
    print(f"{folder}: {len(shards)} shards, {len(manifest['episodes'])} trajectories, {total} frames: ok")


if __name__ == "__main__":
    main(sys.argv[1])
