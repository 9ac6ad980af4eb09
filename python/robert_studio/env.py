"""A Gymnasium environment: follow the goals of a clip.

``gymnasium.make("robert/ur5e-track-v0")``, for each built-in robot; ``clip=`` takes a clip or the name of a task.
"""

from __future__ import annotations

from typing import Any, Optional, Union

import numpy as np

from . import _native
from ._native import InvalidInput
from .clip import Clip
from .policy import LOOKAHEAD
from .robot import Robot

_CLIPS = {
    "pointmass": "pointmass/circle",
    "ur5e": "ur5e/reacher",
    "ur5e_light": "ur5e_light/reacher",
    "shadow_hand": "shadow_hand/fire",
}

try:
    import gymnasium
    from gymnasium import spaces

    _Base: Any = gymnasium.Env
except ImportError:  # the rest of the package does without
    gymnasium = None  # type: ignore[assignment]
    _Base = object


class TrackEnv(_Base):
    """Torque control of a robot along a clip, 20 actions a second.

    Observation, float64: positions (S), velocities (S), the goals of the next 20 frames minus the position, 0
    where masked (20 S), and 1 for each goal that is not masked (20 S). Action, float32: -1 to 1 of each control
    range (A). Reward: minus the mean |error| over the goals of the frame that was reached, 0 if it has none. An
    episode is truncated at the clip's end and never terminates. The start pose is that of the clip, plus up to
    ``noise`` (rad or m) for each joint.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(
        self,
        robot: str = "ur5e",
        clip: Union[Clip, str, None] = None,
        noise: float = 0.0,
        plant: Optional[str] = None,
        render_mode: Optional[str] = None,
    ):
        if gymnasium is None:
            raise ImportError("the environment needs gymnasium: pip install gymnasium")
        if clip is None and robot not in _CLIPS:
            raise InvalidInput(f"robot {robot} has no clip of its own: name one, or give a Clip")
        if isinstance(clip, str) or clip is None:
            clip = Clip.task(clip or _CLIPS[robot], robot)
        self.clip, self.robot, self.noise, self.render_mode = clip, Robot(robot), noise, render_mode
        order = [clip.joints.index(joint) for joint in self.robot.joints]
        goals, seen = clip.command()
        self._goals, self._seen = goals[:, order].astype(np.float64), seen[:, order]
        self._start = clip.start()[order].astype(np.float64)
        self._simulation = _native.Simulation(self.robot._native, plant)
        self._frame = 0
        dim, actions = len(self.robot.joints), len(self.robot.actuators)
        size = 2 * dim + 2 * LOOKAHEAD * dim
        self.observation_space = spaces.Box(-np.inf, np.inf, (size,), np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (actions,), np.float32)

    def reset(self, *, seed: Optional[int] = None, options: Optional[dict] = None) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        start = self._start + self.np_random.uniform(-self.noise, self.noise, len(self._start))
        low, high = self.robot.ranges.T
        self._simulation.reset(np.clip(start, low, high).tolist())
        self._frame = 0
        return self._observation(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        self._simulation.step(np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0).tolist())
        self._frame += 1
        frame = min(self._frame, len(self._goals) - 1)
        error = np.abs(self._simulation.state() - self._goals[frame])[self._seen[frame]]
        reward = -float(error.mean()) if error.size else 0.0
        return self._observation(), reward, False, self._frame >= len(self._goals) - 1, {"frame": self._frame}

    def _observation(self) -> np.ndarray:
        q, qd = self._simulation.state(), self._simulation.velocity()
        rows = np.minimum(np.arange(self._frame + 1, self._frame + 1 + LOOKAHEAD), len(self._goals) - 1)
        seen = self._seen[rows]
        goals = np.where(seen, self._goals[rows] - q, 0.0)
        return np.concatenate([q, qd, goals.ravel(), seen.ravel().astype(np.float64)])

    def render(self) -> Optional[np.ndarray]:
        """The robot as it stands, (480, 640, 3); for ``render_mode="rgb_array"``."""
        if self.render_mode is None:
            return None
        from .take import rollout

        q = self._simulation.state()
        still = Clip.from_array(self.robot, np.stack([q, q]))
        return rollout(still, "zero", robot=self.robot).render(0, overlay="none")


def register() -> None:
    """Makes the environments known to Gymnasium, where it is installed."""
    if gymnasium is None:
        return
    for robot in _CLIPS:
        name = f"robert/{robot}-track-v0"
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point="robert_studio.env:TrackEnv", kwargs={"robot": robot})
