"""Collected motion, and learning from it."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Iterator, Optional, Sequence, Union

import numpy as np
from numpy.typing import NDArray

from . import _native
from .clip import PathLike
from .robot import Robot, as_robot
from .take import Progress

Rows = NDArray[np.float32]


class Dataset:
    """Trajectories in mapped files: data are read when they are used, and never copied.

    ``dataset[i]`` is trajectory i as (q, qd, action): (n, S), (n, S), (n, A); float32, rad or m, actions -1 to 1.
    """

    def __init__(self, path: PathLike):
        described = json.loads(_native.dataset(os.fspath(path)))
        self.manifest: dict[str, Any] = described["manifest"]
        self._shards = [_map(Path(p)) for p in described["shards"]]

    @property
    def joints(self) -> list[str]:
        """Names of the state; (S)."""
        return self.manifest["robot"]["joints"]

    @property
    def actuators(self) -> list[str]:
        """Names of the action; (A)."""
        return self.manifest["robot"]["actuators"]

    @property
    def frames(self) -> int:
        """Frames in all."""
        return self.manifest["totals"]["frames"]

    def __len__(self) -> int:
        return len(self.manifest["episodes"])

    def __getitem__(self, i: int) -> tuple[Rows, Rows, Rows]:
        episode = self.manifest["episodes"][i]
        shard = self._shards[episode["shard"]]
        rows = slice(episode["start"], episode["start"] + episode["length"])
        return shard["qpos"][rows], shard["qvel"][rows], shard["ctrl"][rows]

    def windows(self, length: int = 51) -> Iterator[tuple[Rows, Rows]]:
        """For each trajectory all windows of ``length`` frames as views: q (n - length + 1, length, S) and actions
        (n - length + 1, length, A)."""
        for i in range(len(self)):
            q, _, action = self[i]
            if len(q) >= length:
                yield _sliding(q, length), _sliding(action, length)


def _sliding(rows: Rows, length: int) -> Rows:
    return np.lib.stride_tricks.sliding_window_view(rows, length, axis=0).swapaxes(1, 2)


def _map(path: Path) -> dict[str, Rows]:
    """The arrays of a safetensors file, mapped."""
    with open(path, "rb") as file:
        size = int.from_bytes(file.read(8), "little")
        header = json.loads(file.read(size))
    kinds = {"F32": np.float32, "F16": np.float16, "U8": np.uint8}
    out = {}
    for name, tensor in header.items():
        if name != "__metadata__" and tensor["dtype"] in kinds:
            start = 8 + size + tensor["data_offsets"][0]
            out[name] = np.memmap(path, kinds[tensor["dtype"]], "r", start, tuple(tensor["shape"]))
    return out


def collect(
    robot: Union[Robot, PathLike],
    out: PathLike,
    *,
    agents: Sequence[str] = (),
    transitions: int = 400_000,
    seed: int = 0,
    plants: Optional[str] = None,
    threads: Optional[int] = None,
    progress: Optional[Progress] = None,
) -> Dataset:
    """Lets agents explore (noise by default for the built-in robots) and records what they did in the folder
    ``out``. ``plants`` varies the robot (``mass=0.7..1.4``). The same arguments give the same bits."""
    _native.collect(as_robot(robot)._native, os.fspath(out), list(agents), transitions, seed, plants, threads, progress)
    return Dataset(out)


def fit(
    kind: str,
    data: PathLike,
    *,
    out: Optional[PathLike] = None,
    seed: int = 0,
    threads: Optional[int] = None,
    progress: Optional[Progress] = None,
) -> dict[str, Any]:
    """Fits ``ridge``, ``nearest`` or ``mlp-inverse`` to a dataset. Returns ``policy``, ``out`` and the held-out error;
    ``rollout(clip, f"{kind}:{out}")`` uses the fit."""
    path = None if out is None else os.fspath(out)
    return json.loads(_native.fit(kind, os.fspath(data), path, seed, threads, progress))


def train(
    robot: Union[Robot, PathLike],
    data: PathLike,
    out: PathLike,
    *,
    preset: str = "quick",
    settings: Optional[dict[str, Any]] = None,
    evaluations: int = 10,
    threads: Optional[int] = None,
    progress: Optional[Progress] = None,
) -> dict[str, Any]:
    """Trains a network into the run folder ``out``; ``settings`` change the preset (``{"steps": 1000}``). After Ctrl-C
    the run can be continued: ``robert train --resume``. ``rollout(clip, f"robert:{out}")`` uses the network."""
    pairs = [f"{key}={value}" for key, value in (settings or {}).items()]
    robot = as_robot(robot)
    return json.loads(
        _native.train(robot._native, os.fspath(data), os.fspath(out), preset, pairs, evaluations, threads, progress)
    )
