"""Clips: the document that a person edits."""

from __future__ import annotations

import json
import os
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from .robot import Robot, as_robot

PathLike = Union[str, os.PathLike[str]]


class Clip:
    """Keyframes on a grid of 1/20 s, masks between them.

    Edits return the clip, so that they can be chained; an edit that would break the clip raises
    :class:`InvalidInput` and leaves it as it was.
    """

    def __init__(self, native: _native.Clip, robot: Optional[Robot] = None):
        self._native = native
        self._robot = robot

    @classmethod
    def new(cls, robot: Union[Robot, PathLike], frames: int, name: str = "") -> Clip:
        """An empty clip of ``frames`` frames."""
        robot = as_robot(robot)
        clip = cls(_native.Clip(robot._native, frames), robot)
        clip.name = name
        return clip

    @classmethod
    def load(cls, path: PathLike, robot: Union[Robot, PathLike, None] = None) -> Clip:
        """Reads ``*.clip.json``; errors have file, line and column. ``robot`` is needed if the clip's own is not
        built in."""
        return cls(_native.Clip.load(os.fspath(path)), None if robot is None else as_robot(robot))

    @classmethod
    def task(cls, name: str, robot: Optional[str] = None) -> Clip:
        """A shipped task: ``fire``, ``ur5e/reacher``."""
        return cls(_native.Clip.task(name, robot))

    @classmethod
    def suite(cls, robot: str, suite: str) -> dict[str, Clip]:
        """The clips of a shipped suite, such as ``manual``, by name."""
        return {name: cls(native) for name, native in _native.Clip.suite(robot, suite)}

    @classmethod
    def from_array(cls, robot: Union[Robot, PathLike], q: ArrayLike, tolerance: float = 0.0) -> Clip:
        """A clip that commands these rows, (T, S), 20 per second; NaN is no goal. With a positive ``tolerance`` (rad or
        m) it keeps only the keys that are needed: straight lines between them stay within it of every row."""
        robot = as_robot(robot)
        rows = np.asarray(q, dtype=float).tolist()
        return cls(_native.Clip.dense(robot._native, rows, tolerance), robot)

    @property
    def name(self) -> str:
        """The clip's title."""
        return self._native.name

    @name.setter
    def name(self, name: str) -> None:
        self._native.name = name

    @property
    def robot(self) -> Robot:
        """The clip's robot."""
        if self._robot is None:
            self._robot = Robot(self._native.robot)
        return self._robot

    @property
    def joints(self) -> list[str]:
        """Names of the joints, in the order of the columns."""
        return self._native.joints

    @property
    def frames(self) -> int:
        """The number of frames."""
        return self._native.frames

    @property
    def keys(self) -> list[int]:
        """Frames of the keys."""
        return self._native.keys

    def key(self, frame: int, q: ArrayLike, hold: int = 1, fill: Optional[str] = None) -> Clip:
        """Commands ``q`` (S; rad or m; NaN says nothing about a joint) at a frame and at the ``hold`` - 1 frames after it.
        ``fill`` is the fill after that: mask, linear, cubic or hold. The next key with a value for a joint ends the hold
        and the fill of this joint."""
        self._native.key(frame, np.asarray(q, dtype=float).tolist(), hold, fill)
        return self

    def reach(
        self,
        frame: int,
        site: str,
        pos: ArrayLike,
        quat: Optional[ArrayLike] = None,
        *,
        hold: int = 1,
        fill: Optional[str] = None,
        pose: Optional[str] = None,
    ) -> Clip:
        """Commands where a point of the robot should be: ``pos`` (3; m, world) of a site of its model, and ``quat`` (4;
        w x y z) if the orientation matters. Joint values are found near the named ``pose``, else near the neighbouring
        keys. A key at this frame is replaced."""
        goal: dict[str, Any] = {"site": site, "pos": pos}
        if quat is not None:
            goal["quat"] = quat
        key: dict[str, Any] = {"frame": frame, "reach": [goal], "hold": hold}
        key.update({name: value for name, value in (("fill", fill), ("pose", pose)) if value is not None})
        return self.apply("keys.add", keys=[key], replace=True)

    def apply(self, op: str, **args: Any) -> Clip:
        """One edit of the studio, as in ``robert clip apply``: ``clip.apply("tangent.set", frames=[20],
        joints=["x"], tangent="flat")``. An unknown operation or argument raises ``ValueError`` with the valid names."""
        edit = json.dumps({"op": op, "args": args}, default=_plain)
        try:
            robot = self.robot._native
        except _native.RobertError:
            robot = None  # only end-effector goals and mirroring need it, and say so
        self._native.apply(edit, robot)
        return self

    def mask(self, start: int, stop: int, joints: Optional[list[str]] = None) -> Clip:
        """Removes the goals of frames ``start`` to ``stop`` - 1, for all joints or for some."""
        self._native.mask(start, stop, joints)
        return self

    def fill(self, fill: str) -> Clip:
        """Sets the fill after keys without their own: mask, linear, cubic or hold."""
        self._native.fill(fill)
        return self

    def command(self) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """The commanded values, (T, S; rad or m), and which are goals, (T, S). End-effector goals are solved."""
        q, seen, frames = self._native.command(self.robot._native if self._native.has_reach else None)
        return q.reshape(frames, -1), seen.reshape(frames, -1)

    def start(self) -> NDArray[np.float32]:
        """The pose before frame 0, (S,; rad or m): the clip's own, else that of its first goals."""
        return self._native.start(self.robot._native if self._native.has_reach else None)

    def text(self) -> str:
        """The file's text."""
        return self._native.text()

    def save(self, path: PathLike) -> None:
        """Writes the clip to a file."""
        self._native.save(os.fspath(path))

    def __repr__(self) -> str:
        return f"Clip({self.name!r}, {self._native.robot}, {self.frames} frames, {len(self.keys)} keys)"


def _plain(value: Any) -> Any:
    """numpy's values for JSON; NaN, which says nothing about a joint, is null there."""
    if not isinstance(value, (np.ndarray, np.generic)):
        raise TypeError(f"{type(value).__name__} is no value of an edit")
    return np.where(value != value, None, value.astype(object)).tolist()
