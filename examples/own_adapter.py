"""An adapter of your own: learns a factor between forecast and true displacements, and scales the forecasts.

Run it, from this folder:
    motion-gym adapt constant_velocity --adapter own_adapter:Stretch --stream orca:d=0.3 --stream orca:d=0.6
"""

import copy

import numpy as np

import motion_gym


class Stretch:
    """Multiplies the displacements of a forecast by a factor.

    Args:
        of: The predictor to adapt, which is copied.
        rate: Learning rate of the factor.
    """

    def __init__(self, of, rate: float = 0.02):
        self.inner, self.rate = copy.deepcopy(of), rate
        self.reset()

    def reset(self):
        """Restore the initial state."""
        self.factor, self.updates = 1.0, 0

    def predict(self, observation, samples=1, seed=0):
        """Forecasts (agents, samples, 12 steps, 2), metres. Does not learn."""
        last = observation.xy[:, None, -1:]
        forecast = self.inner.predict(observation, samples, seed).positions
        return (last + self.factor * (forecast - last)).astype(np.float32)

    def observe(self, truth):
        """Learn from revealed ground truth, after the forecast is scored. Future steps may be unknown."""
        if not truth.known.any():
            return
        last = truth.observation.xy[:, -1:]
        forecast = (self.inner.predict(truth.observation).positions[:, 0] - last)[truth.known]
        true = (truth.future - last)[truth.known]
        best = (forecast * true).sum() / max((forecast * forecast).sum(), 1e-6)
        self.factor += self.rate * (best - self.factor)
        self.updates += 1


if __name__ == "__main__":
    stream = motion_gym.stream(["orca:d=0.3", "orca:d=0.6"], frames=1000)
    source = motion_gym.predictor("constant_velocity")
    print(motion_gym.evaluate_online(source, stream))
    print(motion_gym.evaluate_online(Stretch(source), stream))
