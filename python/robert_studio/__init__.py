"""A few keyframes in, physically simulated motion out.

Angles are rad, lengths m, torques N m; time is counted in frames of 1/20 s, frame 0 is the start. Arrays are
numpy's; those of a take are made once and shared. Errors are :class:`RobertError` and its kinds, with the place in
the message; Ctrl-C stops long work.
"""

from ._native import InvalidInput, MissingDependency, RobertError, __version__
from .clip import Clip
from .data import Dataset, collect, fit, train
from .env import TrackEnv, register
from .policy import Policy
from .robot import Robot, import_robot
from .take import Take, evaluate, export, rollout

FPS = 20
HISTORY = 30
LOOKAHEAD = 20

__all__ = [
    "FPS", "HISTORY", "LOOKAHEAD", "Clip", "Dataset", "InvalidInput", "MissingDependency", "Policy", "RobertError",
    "Robot", "Take", "TrackEnv", "__version__", "collect", "evaluate", "export", "fit", "import_robot", "register", "rollout", "train",
]

register()
