"""A control loop of one's own: the trained policy and a PD law on the same simulated arm."""

import numpy as np

import robert_studio as rs
from robert_studio.env import TrackEnv

env = TrackEnv("ur5e", clip="ur5e/reacher")
goals, seen = env.clip.command()
dim = len(env.robot.joints)


def ahead(frame):
    """Goals of the next 20 frames, and where they count; past the end the last one is held."""
    rows = np.minimum(np.arange(frame + 1, frame + 21), len(goals) - 1)
    return goals[rows].astype(float), seen[rows]


def perform(act):
    observation, _ = env.reset(seed=0)
    history, errors, done = [observation[:dim]] * 31, [], False
    while not done:
        frame = len(history) - 31
        observation, reward, _, done, _ = env.step(act(frame, np.array(history[-31:]), observation))
        history.append(observation[:dim])
        errors.append(-reward)
    return np.mean(errors)


policy = rs.Policy("ur5e")
robert = perform(lambda frame, past, _: policy.act(past, *ahead(frame)))

# Gains in actions a rad: what a person would try first.
low, high = env.robot.ctrl_ranges.T
gains, damping = 4000 / high, 40 / high


def pd(frame, past, observation):
    wanted = np.where(seen[min(frame + 1, len(goals) - 1)], goals[min(frame + 1, len(goals) - 1)], past[-1])
    return np.clip(gains * (wanted - past[-1]) - damping * observation[dim : 2 * dim], -1, 1)


print(f"mean error: {policy.name} {robert:.5f} rad, own law {perform(pd):.5f} rad")
