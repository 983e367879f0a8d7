"""An adapter of your own: it learns whether people go farther than they are forecast to, and stretches the forecasts.

Run it, from this folder:
    motion-gym adapt constant_velocity --adapter own_adapter:Stretch --stream orca:d=0.3 --stream orca:d=0.6
"""

import copy

import numpy as np

import motion_gym


class Stretch:
    """Multiplies the way that people are forecast to go by a factor.

    Args:
        of: The predictor that is adapted; a copy of it is used.
        rate: Share of the way to the factor that a scene asks for.
    """

    def __init__(self, of, rate: float = 0.02):
        self.inner, self.rate = copy.deepcopy(of), rate
        self.reset()

    def reset(self):
        """Forget all that was learned."""
        self.factor, self.updates = 1.0, 0

    def predict(self, observation, samples=1, seed=0):
        """Forecasts (agents, samples, 12 steps, 2), metres; never learns."""
        last = observation.xy[:, None, -1:]
        forecast = self.inner.predict(observation, samples, seed).positions
        return (last + self.factor * (forecast - last)).astype(np.float32)

    def observe(self, truth):
        """Learn, after the forecast was scored; people may have left before the last step, or at once."""
        if not truth.known.any():
            return
        last = truth.observation.xy[:, -1:]
        way = (self.inner.predict(truth.observation).positions[:, 0] - last)[truth.known]
        went = (truth.future - last)[truth.known]
        wanted = (way * went).sum() / max((way * way).sum(), 1e-6)
        self.factor += self.rate * (wanted - self.factor)
        self.updates += 1


if __name__ == "__main__":
    stream = motion_gym.stream(["orca:d=0.3", "orca:d=0.6"], frames=1000)
    source = motion_gym.predictor("constant_velocity")
    print(motion_gym.evaluate_online(source, stream))
    print(motion_gym.evaluate_online(Stretch(source), stream))
