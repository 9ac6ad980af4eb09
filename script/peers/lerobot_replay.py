"""lerobot itself reads an exported dataset, and its lerobot-replay moves a mock robot with it.

lerobot_replay.py DATASET EXPECTED.json

EXPECTED holds `joints`, the positions `q` of the first episode (T, S), its `task` and the number of `frames` of all
episodes. Every action must be the position one frame later, by the names that the robot expects.
"""

import json
import sys
from dataclasses import dataclass

import numpy as np
from lerobot.datasets import LeRobotDataset
from lerobot.robots import Robot, RobotConfig
from lerobot.scripts import lerobot_replay

SENT = []


@RobotConfig.register_subclass("mock")
@dataclass
class MockConfig(RobotConfig):
    """A robot with these motors."""

    joints: tuple = ()


class Mock(Robot):
    """Keeps what it is sent."""

    config_class, name = MockConfig, "mock"
    is_connected = is_calibrated = True

    def __init__(self, config):
        super().__init__(config)
        self.motors = {f"{j}.pos": float for j in config.joints}

    action_features = observation_features = property(lambda self: self.motors)

    def connect(self, calibrate=True):
        pass

    calibrate = configure = disconnect = lambda self: None

    def get_observation(self):
        return dict.fromkeys(self.motors, 0.0)

    def send_action(self, action):
        assert list(action) == list(self.motors), (list(action), list(self.motors))
        SENT.append([float(v) for v in action.values()])
        return action


def main(root, expected):
    with open(expected, encoding="utf-8") as file:
        want = json.load(file)
    data = LeRobotDataset("local/robert", root=root, video_backend="pyav")
    assert (len(data), data.fps) == (want["frames"], 20), (len(data), data.fps)
    q = np.array(want["q"])
    for frame in range(0, len(q), max(1, len(q) // 10)):
        row = data[frame]
        assert row["task"] == want["task"], row["task"]
        assert np.abs(row["observation.state"].numpy() - q[frame]).max() < 1e-6
        for key in data.meta.video_keys:
            picture = row[key].numpy()
            assert picture.shape[0] == 3 and picture.std() > 0.01, (picture.shape, picture.std())
    lerobot_replay.precise_sleep = lambda seconds: None
    replay = lerobot_replay.DatasetReplayConfig(repo_id="local/robert", episode=0, root=root)
    robot = MockConfig(joints=tuple(want["joints"]))
    lerobot_replay.replay(lerobot_replay.ReplayConfig(robot=robot, dataset=replay, play_sounds=False))
    later = q[np.minimum(np.arange(len(q)) + 1, len(q) - 1)]
    off = float(np.abs(np.array(SENT) - later).max())
    assert len(SENT) == len(q) and off < 1e-6, (len(SENT), off)
    print(f"{len(data)} rows, {len(data.meta.video_keys)} films, {len(SENT)} actions sent, {off:.1e} rad")


main(*sys.argv[1:])
