"""A predictor of your own: one class with one method.

Score it, from this folder:  motion-gym score own_predictor:Turning --domain orca:d=0.6
"""

import numpy as np

import motion_gym


class Turning:
    """Walks on at the speed of the last step, and keeps turning as it did over the last two, ever less."""

    def __init__(self, fade: float = 0.7):
        self.fade = fade

    def predict(self, observation, samples=1, seed=0):
        """Forecast every agent; the same input gives the same answer."""
        step = np.diff(observation.xy, axis=1)
        angle = np.arctan2(step[..., 1], step[..., 0])
        turn = (angle[:, -1] - angle[:, -2] + np.pi) % (2 * np.pi) - np.pi
        turned = turn[:, None] * np.cumsum(self.fade ** np.arange(1, motion_gym.FUTURE + 1))
        heading = angle[:, -1:] + turned
        speed = np.linalg.norm(step[:, -1:], axis=-1)
        moves = speed[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        forecast = observation.xy[:, -1:] + np.cumsum(moves, axis=1)
        return forecast[:, None].astype(np.float32)  # (agents, 1 sample, 12 steps, 2)


if __name__ == "__main__":
    motion_gym.check_predictor(Turning)
    print(motion_gym.evaluate(Turning(), "orca:d=0.6", scenes=500))
