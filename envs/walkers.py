"""People who walk at a constant speed, which a forecaster should get right before it is trusted anywhere."""

from __future__ import annotations

import numpy as np

from motion_gym.contract import WINDOW, Recording
from motion_gym.data.domains import RecordedDomain
from motion_gym.data.recordings import recording_of_scenes
from motion_gym.specs import number, whole_number


class Walkers(RecordedDomain):
    """People who walk at a constant speed, straight on or along an arc, alone or in company; simulated.

    ## Description
    Each scene has 20 steps of 0.4 s and a first heading of its own, uniform over all directions. Its people start side
    by side, follow the same path, and do not react to each other. With ``turn`` all people of a scene turn left, or
    all turn right, with equal probability. Each recorded coordinate has an error of the annotation from N(0, noise^2),
    which is independent over steps and people.

    Nothing here has to be learned: without noise the error of constant velocity is zero on straight paths, but for
    the rounding of observations to float32. A forecaster that fails here extrapolates beyond what it was trained on, as
    to people who are alone, far apart, or fast.

    ## Observation
    x and y in metres; a scene starts near the origin.

    ## Splits
    ``train``, ``val``, ``test`` and ``reference``: ``scenes`` scenes each, from random streams of their own.

    ## Arguments
    Args:
        people: People of a scene, 1 to 50.
        gap: Distance between neighbours, metres, > 0 and at most 200.
        speed: Speed of everyone, m/s, 0 to 100.
        turn: Change of the heading, degrees per second, 0 to 180; 0 for straight paths.
        noise: Standard deviation of the annotation error along each axis, metres, 0 to 100.
        scenes: Number of scenes in each split.
        seed: Seed of all random values, 0 or more.

    ## Credits
    None.
    """

    name = "walkers"
    source = "simulated by motion-gym"
    terms = "free"
    headline = ("people", "speed")
    draws_each_split = True

    def __init__(
        self,
        people: int = 1,
        gap: float = 2.0,
        speed: float = 1.3,
        turn: float = 0.0,
        noise: float = 0.02,
        scenes: int = 500,
        seed: int = 0,
    ):
        owner = f"domain `{self.name}`"
        self.people = whole_number("people", people, 1, 50)
        self.gap = number("gap", gap, 0, 200, above=True, owner=owner)
        self.speed = number("speed", speed, 0, 100, owner=owner)
        self.turn = number("turn", turn, 0, 180, owner=owner)
        self.noise = number("noise", noise, 0, 100, owner=owner)
        self.scenes = whole_number("scenes", scenes, 1, 100_000)
        self.seed = whole_number("seed", seed, 0, 2**63)

    def recordings(self, split: str) -> list[Recording]:
        """One recording: the scenes of the split one after another, 20 frames each, with a new id for each person."""
        self.check_split(split)
        rng = np.random.default_rng([self.seed, self.splits.index(split)])
        heading = rng.uniform(0, 2 * np.pi, (self.scenes, 1, 1))
        turn = np.deg2rad(self.turn) * self.dt * rng.choice([-1, 1], (self.scenes, 1, 1))
        steps = np.arange(-1, WINDOW - 1).reshape(1, WINDOW, 1)  # the first observed step has the first heading
        path = self.speed * self.dt * np.cumsum(_unit(heading + turn * steps), axis=1)
        aside = self.gap * np.arange(self.people)[:, None] * _unit(heading + np.pi / 2)
        xy = path[:, :, None] + aside[:, None]
        xy += rng.normal(scale=self.noise, size=xy.shape)
        return [recording_of_scenes(xy, self.dt, f"walkers {split}")]

    def sources(self) -> list[RecordedDomain]:
        """The same domain, whose splits share no people."""
        return [self]


def _unit(angle: np.ndarray) -> np.ndarray:
    """Unit vectors [..., 2] of angles [..., 1], radians."""
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=-1)
