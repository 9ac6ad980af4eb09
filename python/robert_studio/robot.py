"""Robots."""

from __future__ import annotations

import json
import os
import shutil
import sysconfig
from typing import Any, Optional, Sequence, Union

import numpy as np
from numpy.typing import NDArray

from . import _native

# Foreign models are compiled in a process of their own, by the command that was installed with this package.
_program = shutil.which("robert", path=sysconfig.get_path("scripts")) or shutil.which("robert")
if _program:
    _native.set_executable(_program)


class Robot:
    """A robot: its joints (the state, S of them) and actuators (the action, A of them).

    ``id`` is a robot of the program (``pointmass``, ``ur5e``, ``ur5e_light``, ``shadow_hand``) or the folder that
    ``robert import`` or ``robert new`` made. Raises :class:`InvalidInput` for any other folder.
    """

    def __init__(self, id: Union[str, os.PathLike[str]]):
        self._native = _native.Robot(os.fspath(id))

    @classmethod
    def _of(cls, native: _native.Robot) -> Robot:
        robot = cls.__new__(cls)
        robot._native = native
        return robot

    @staticmethod
    def builtin() -> list[str]:
        """Ids of the robots of the program."""
        return _native.Robot.builtin()

    @property
    def id(self) -> str:
        """The robot's id."""
        return self._native.id

    @property
    def joints(self) -> list[str]:
        """Names of the state, in order; (S)."""
        return self._native.joints

    @property
    def units(self) -> list[str]:
        """``rad`` or ``m`` for each joint; (S)."""
        return self._native.units

    @property
    def ranges(self) -> NDArray[np.float64]:
        """Limits of each joint, rad or m; infinite for joints without; (S, 2)."""
        return np.array(self._native.ranges).reshape(-1, 2)

    @property
    def actuators(self) -> list[str]:
        """Names of the action, in order; (A)."""
        return self._native.actuators

    @property
    def ctrl_ranges(self) -> NDArray[np.float64]:
        """Controls at actions -1 and 1, N m or N; (A, 2)."""
        return np.array(self._native.ctrl_ranges).reshape(-1, 2)

    @property
    def mjcf(self) -> str:
        """The text of its MJCF model."""
        return self._native.mjcf

    def home(self) -> NDArray[np.float64]:
        """The pose at rest, rad or m; (S)."""
        return np.array(self._native.home())

    def poses(self) -> dict[str, NDArray[np.float64]]:
        """Named poses of the profile; (S) each."""
        return {name: np.array(self._native.pose(name)) for name in self._native.pose_names()}

    def policies(self) -> list[dict]:
        """The policies for this robot: ``name`` as :func:`rollout` takes it, ``suits``, ``default``."""
        rows = self._native.policies()
        return [{"name": f"{n}:{m}" if m else n, "suits": s, "default": d} for n, m, s, d in rows]

    def __repr__(self) -> str:
        return f"Robot({self.id!r}, {len(self.joints)} joints, {len(self.actuators)} actuators)"


def as_robot(robot: Union[Robot, str, os.PathLike[str]]) -> Robot:
    """A robot, or what names one."""
    return robot if isinstance(robot, Robot) else Robot(robot)


def _names(of: Union[str, Sequence[str]]) -> list[str]:
    """A single name is one, and not its letters."""
    return [of] if isinstance(of, str) else list(of)


def import_robot(
    source: Union[str, os.PathLike[str]],
    out: Union[str, os.PathLike[str]],
    *,
    id: Optional[str] = None,
    root: Union[str, os.PathLike[str], None] = None,
    packages: Optional[dict[str, str]] = None,
    fixed_base: bool = False,
    base_height: float = 0.0,
    effort: Optional[float] = None,
    weld: Union[str, Sequence[str]] = (),
    without: Union[str, Sequence[str]] = (),
    without_meshes: bool = False,
    torque: bool = False,
    drives: str = "modelled",
) -> dict[str, Any]:
    """Makes the robot folder ``out`` from a URDF or MJCF. Reports what was ``dropped``, ``assumed`` and ``changed``.

    ``root`` is the folder that must contain all includes and meshes (the file's own by default), ``packages`` gives
    the folders of ROS packages. ``base_height`` is m above the floor, ``effort`` the limit of motors whose source names
    none (N m; enough to carry the robot by default). The joints of ``weld`` are welded at their zeros. The bodies of
    ``without`` are left out, with everything that refers to them (MJCF), and with ``without_meshes`` meshes whose files
    are missing. ``torque`` replaces servos by motors. Joints whose file describes no drive get an assumed one, or stay
    as they are with ``drives="file"``. The model is compiled in a process of its own, by the command ``robert`` that was
    installed with this package. Raises :class:`InvalidInput` with file, line and column."""
    report = _native.import_robot(
        os.fspath(source), os.fspath(out), id, None if root is None else os.fspath(root), packages or {}, fixed_base,
        base_height, effort, _names(weld), _names(without), without_meshes, torque, drives,
    )
    return json.loads(report)
