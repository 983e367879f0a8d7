"""A predictor of your own: one class with one method.

Score it, from this folder:  motion-gym score own_predictor:Turning --domain orca:d=0.6
"""

import numpy as np

import motion_gym


class Turning:
    """Turns gradually from the last step to the heading and mean speed of the whole history.

    Args:
        steps: Number of future steps after which about two thirds of the turn are complete.
    """

    selection = "no weights"  # how the weights were selected; shown with every result

    def __init__(self, steps: float = 4.0):
        self.steps = steps

    def predict(self, observation, samples=1, seed=0):
        """Forecasts (agents, 1 sample, 12 steps, 2), metres."""
        step = np.diff(observation.xy, axis=1)
        total = step.sum(axis=1, keepdims=True)
        heading = total / np.maximum(np.linalg.norm(total, axis=-1, keepdims=True), 1e-6)
        mean = heading * np.linalg.norm(step, axis=-1).mean(axis=1)[:, None, None]
        weight = 1 - np.exp(-np.arange(1, motion_gym.FUTURE + 1) / self.steps)[:, None]
        moves = (1 - weight) * step[:, -1:] + weight * mean
        forecast = observation.xy[:, -1:] + np.cumsum(moves, axis=1)
        return forecast[:, None].astype(np.float32)


if __name__ == "__main__":
    motion_gym.check_predictor(Turning)
    print(motion_gym.evaluate(Turning(), "orca:d=0.6", scenes=500))
    print(motion_gym.evaluate("constant_velocity", "orca:d=0.6", scenes=500))
