"""Policies in a control loop of one's own."""

from __future__ import annotations

from typing import Optional, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from .clip import PathLike
from .robot import Robot, as_robot

HISTORY, LOOKAHEAD = 30, 20


class Policy:
    """A policy that is asked once every 50 ms.

    ``policy`` is a name as in :func:`rollout`; without a name it is the robot's trained policy.
    """

    def __init__(self, robot: Union[Robot, PathLike], policy: Optional[str] = None, seed: int = 0):
        self.robot = as_robot(robot)
        self._native = _native.Policy(self.robot._native, policy, seed)

    @property
    def name(self) -> str:
        """The name that tables show."""
        return self._native.label

    def reset(self, seed: int = 0) -> None:
        """Clears the policy's memory. Call it before another motion."""
        self._native.reset(seed)

    def act(
        self,
        history: ArrayLike,
        goals: ArrayLike,
        mask: ArrayLike,
        velocity: Optional[ArrayLike] = None,
    ) -> NDArray[np.float64]:
        """The action for the next 50 ms, -1 to 1 of each actuator's control range; (A).

        ``history`` (31, S) are the states of the last 30 frames and the present one, rad or m; ``goals`` (20, S) those
        of the next 20 frames; ``mask`` (20, S) is True where there is a goal. ``velocity`` (S) is for policies that
        use a model of the robot; without it, it is computed from the last two states. Inside the gaps of a clip the
        rollout also knows the goal before the window and leads from there to the next one. Here a joint without a goal
        is led from its own state. Policies with an observer (``+observer=30``) or an ensemble remember earlier calls,
        and assume that what they answered was applied one frame before the next call."""
        dim = len(self.robot.joints)
        past = np.ascontiguousarray(history, dtype=np.float64)
        if past.shape != (HISTORY + 1, dim):
            raise ValueError(f"history is {past.shape}, not {(HISTORY + 1, dim)}")
        wanted = np.ascontiguousarray(goals, dtype=np.float64)
        seen = np.ascontiguousarray(mask, dtype=np.bool_)
        if wanted.shape != (LOOKAHEAD, dim) or seen.shape != (LOOKAHEAD, dim):
            raise ValueError(f"goals are {wanted.shape} and the mask {seen.shape}, not {(LOOKAHEAD, dim)}")
        speed = None if velocity is None else np.ascontiguousarray(velocity, dtype=np.float64)
        return self._native.act(past[:HISTORY], past[HISTORY], wanted, seen, speed)
