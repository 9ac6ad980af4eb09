"""Rolling clips out: takes, comparison, pictures, exports."""

from __future__ import annotations

import json
import os
from functools import cached_property
from pathlib import Path
from typing import Any, Callable, Iterable, Mapping, Optional, Union

import numpy as np
from numpy.typing import NDArray

from . import _native
from .clip import Clip, PathLike
from .robot import Robot, as_robot

Progress = Callable[[int, int, str], None]


class Take:
    """A recorded rollout of T frames. Its arrays are made once; do not write to them.

    A take of ``rollout`` and one that was read from a file are the same.
    """

    def __init__(self, native: _native.Take):
        self._native = native

    @classmethod
    def load(cls, path: PathLike, robot: Union[Robot, PathLike, None] = None) -> Take:
        """Reads an MCAP take; a damaged one raises :class:`InvalidInput` with the byte."""
        native = None if robot is None else as_robot(robot)._native
        return cls(_native.Take.load(os.fspath(path), native))

    def save(self, path: PathLike) -> None:
        """Writes the take as MCAP, for Foxglove, Lichtblick and Rerun."""
        self._native.save(os.fspath(path))

    def _array(self, name: str, *shape: int) -> NDArray[np.float64]:
        array = self._native.array(name).reshape(*shape)
        array.flags.writeable = False
        return array

    @cached_property
    def robot(self) -> Robot:
        """The robot."""
        return Robot._of(self._native.robot)

    @property
    def frames(self) -> int:
        """The number of frames, T."""
        return self._native.frames

    @property
    def policy(self) -> str:
        """The policy that performed the clip."""
        return self._native.policy

    @property
    def clip(self) -> Optional[Clip]:
        """The clip that was performed."""
        native = self._native.clip
        return None if native is None else Clip(native, self.robot)

    @cached_property
    def times(self) -> NDArray[np.float64]:
        """Seconds; (T)."""
        return np.arange(self.frames) / 20

    @cached_property
    def q(self) -> NDArray[np.float64]:
        """Reached joint positions, rad or m; (T, S)."""
        return self._array("q", self.frames, -1)

    @cached_property
    def qd(self) -> NDArray[np.float64]:
        """Joint velocities, rad/s or m/s; (T, S)."""
        return self._array("qd", self.frames, -1)

    @cached_property
    def command(self) -> NDArray[np.float64]:
        """Goals, rad or m, NaN where masked; (T, S)."""
        return self._array("command", self.frames, -1)

    @cached_property
    def error(self) -> NDArray[np.float64]:
        """|reached - commanded|, rad or m, NaN where masked; (T, S)."""
        return self._array("error", self.frames, -1)

    @cached_property
    def ctrl(self) -> NDArray[np.float64]:
        """Controls, N m or N; (T - 1, A)."""
        return self._array("ctrl", self.frames - 1, -1)

    @cached_property
    def action(self) -> NDArray[np.float64]:
        """Actions, -1 to 1; (T - 1, A)."""
        return self._array("action", self.frames - 1, -1)

    @cached_property
    def effort(self) -> NDArray[np.float64]:
        """Torque or force on each joint, N m or N; (T - 1, S)."""
        return self._array("effort", self.frames - 1, -1)

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies; (B)."""
        return self._native.bodies

    @cached_property
    def poses(self) -> NDArray[np.float64]:
        """World poses of the bodies: x y z (m) and the quaternion w x y z; (T, B, 7)."""
        return self._array("poses", self.frames, -1, 7)

    @cached_property
    def precision(self) -> dict[str, Any]:
        """Figures of the error: ``precision`` (mean |error| over all goals, rad or m), ``masked_mae``, ``p95``, ..."""
        return json.loads(self._native.precision())

    def render(
        self,
        frames: Union[int, Iterable[int], None] = None,
        size: tuple[int, int] = (640, 480),
        overlay: str = "ghost,error,trail,caption",
        camera: str = "fit",
    ) -> NDArray[np.uint8]:
        """Pictures of frames (all of them by default), (n, height, width, 3); of one frame (height, width, 3).

        ``overlay`` lists ghost, error, onion, bare, trail, caption, axes, contacts, or none; ``camera`` is fit, fixed,
        top, orbit, follow:BODY or a camera of the model."""
        if frames is None:
            wanted = list(range(self.frames))
        else:
            wanted = [frames] if isinstance(frames, int) else list(frames)
        width, height = size
        pixels = self._native.render(wanted, width, height, overlay, camera)
        pictures = pixels.reshape(len(wanted), height, width, 3)
        return pictures[0] if isinstance(frames, int) else pictures

    def html(self) -> bytes:
        """A page that plays the take; it needs no network."""
        return self._native.html(self._title())

    def show(self, height: int = 480) -> Any:
        """The page in a notebook."""
        import base64

        from IPython.display import HTML

        page = base64.b64encode(self.html()).decode()
        frame = f'<iframe src="data:text/html;base64,{page}" width="100%" height="{height}" style="border:0"></iframe>'
        return HTML(frame)

    def export(self, to: str, path: PathLike, **options: Any) -> dict[str, Any]:
        """As :func:`export` of this take alone."""
        return export([self], to, path, title=self._title(), **options)

    def _title(self) -> str:
        clip = self.clip
        return (clip.name if clip is not None else "") or "take"

    def __repr__(self) -> str:
        return f"Take({self._title()!r} by {self.policy}, {self.frames} frames)"


_DEFAULTS: dict[str, Any] = {
    "what": "achieved", "fps": None, "bodies": "mujoco", "lead_in": 0.0, "goal": False, "effort": False, "rename": {},
    "action": "position", "degrees": False, "lerobot_version": "3.0", "task": None, "ur_move": "servoj",
}


def export(takes: Iterable[Take], to: str, path: PathLike, title: str = "take", **options: Any) -> dict[str, Any]:
    """Writes takes in another format: glb, bvh, usda, lafan, npz, ros, bag, ur, csv, json, lerobot or minari. Of several
    takes lerobot and minari make one dataset; the others take the first. Options are those of ``robert export``:
    ``what``, ``fps``, ``bodies``, ``lead_in`` (s), ``goal``, ``effort``, ``rename``, ``action``, ``degrees``,
    ``lerobot_version``, ``task``, ``ur_move``. Gives ``files``, ``frames``, what the numbers mean, and the
    command that opens them."""
    unknown = set(options) - set(_DEFAULTS)
    if unknown:
        raise TypeError(f"no option {', '.join(sorted(unknown))}; there are {', '.join(_DEFAULTS)}")
    natives = [take._native for take in takes]
    settings = {**_DEFAULTS, **options}
    files, frames, meaning, opens = _native.export(natives, to, os.fspath(path), title, settings)
    return {"files": [Path(f) for f in files], "frames": frames, "meaning": meaning, "open": opens}


def rollout(
    clip: Clip,
    policy: Optional[str] = None,
    *,
    robot: Union[Robot, PathLike, None] = None,
    seed: int = 0,
    plant: Optional[str] = None,
    progress: Optional[Progress] = None,
) -> Take:
    """Performs a clip in the simulation.

    ``policy`` is a name as on the command line (``pd``, ``computed-torque``, ``robert+guide``, ``ridge:FILE``); by
    default it is ``auto``, which tries several in simulation, repeats the clip with the best and corrects its goals.
    ``plant`` changes the simulated robot (``mass=1.25,damping=0.5``); ``progress`` is called with (done, total, note). Other Python threads run meanwhile. The same clip, policy and seed give
    the same bits as ``robert rollout``."""
    body = clip.robot if robot is None else as_robot(robot)
    return Take(_native.rollout(body._native, clip._native, policy, seed, plant, progress))


def evaluate(
    clips: Union[Mapping[str, Clip], Iterable[Clip]],
    policies: Iterable[str],
    *,
    seeds: int = 1,
    plant: Optional[str] = None,
    floors: bool = True,
    threads: Optional[int] = None,
    progress: Optional[Progress] = None,
) -> list[dict[str, Any]]:
    """A row for each policy and clip: ``policy``, ``task``, ``precision`` (rad or m), ``excess`` over iLQR's floor,
    ``masked_mae``, ``wall_secs``, ... — ready for ``pandas.DataFrame``. All clips are of one robot."""
    if isinstance(clips, Mapping):
        named = dict(clips)
    else:
        named: dict[str, Clip] = {}
        for i, clip in enumerate(clips):
            name = clip.name or f"clip {i}"
            if name in named:
                raise ValueError(f"two clips are called {name!r}: give them in a dict, under different names")
            named[name] = clip
    if not named:
        return []
    body = next(iter(named.values())).robot
    pairs = [(name, clip._native) for name, clip in named.items()]
    text = _native.evaluate(body._native, pairs, list(policies), seeds, plant, floors, threads, progress)
    rows = []
    for result in json.loads(text):
        for task in result["tasks"]:
            name = task.pop("name")
            rows.append({"policy": result["policy"], "task": name, "uses_model": result["uses_model"], **task})
    return rows
