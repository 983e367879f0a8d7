"""A synthetic place for tests of streams: people always walk through it, and some leave soon."""

import numpy as np

from motion_gym.contract import Recording
from motion_gym.data.domains import RecordedDomain


class Street(RecordedDomain):
    """People who come every few frames, walk at a pace of their own, and leave.

    Args:
        style: What is another one in the same place: how fast they walk.
        seed: Of the place.
        frames: Listed frames.
        places: Recordings; the frames are shared out among them.
        noise: Value of a third feature; None for none.
        dt: Seconds per step.
    """

    name = "street"
    headline = ("style",)
    same_world = ("style", "noise")

    def __init__(
        self,
        style: float = 1.0,
        seed: int = 0,
        frames: int = 800,
        places: int = 1,
        noise: float | None = None,
        dt: float = 0.4,
    ):
        self.style, self.seed, self.frames, self.places, self.noise, self.dt = style, seed, frames, places, noise, dt
        self.feature_names = () if noise is None else ("noise",)

    def recordings(self, split):
        """The recordings of the test split; other splits are empty."""
        self.check_split(split)
        return self.kept("walks", self._walks) if split == "test" else []

    def _walks(self):
        rng, length, recordings = np.random.default_rng([self.seed, self.frames]), self.frames // self.places, []
        for _ in range(self.places):
            rows = []
            for agent, enters in enumerate(range(-20, length, 6)):
                way = rng.normal(0, 0.3, (int(rng.integers(5, 45)), 2)) + rng.normal(0, 0.6, 2) * self.style
                path = rng.normal(0, 5, 2) + way.cumsum(axis=0)
                rows += [(enters + t, agent, *xy) for t, xy in enumerate(path) if 0 <= enters + t < length]
            rows.sort()
            frame, agent, *xy = (np.array(column) for column in zip(*rows, strict=True))
            recordings.append(Recording(frame * 10, agent, np.stack(xy, axis=1), self.dt, "street"))
        return recordings

    def features(self, history):
        """The third feature."""
        return np.full((*history.shape[:2], len(self.feature_names)), self.noise or 0.0)
