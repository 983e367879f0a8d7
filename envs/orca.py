"""ORCA circle crossing: simulated crowds whose style is the distance that agents keep."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym.contract import WINDOW, Recording, SpecError
from motion_gym.data.domains import RecordedDomain, shared
from motion_gym.data.recordings import recording_of_scenes
from motion_gym.data.storage import cached_arrays
from motion_gym.envs.orca_engine.simulation import ENGINE_VERSION, simulate
from motion_gym.specs import number, one_of, whole_number

STARTS = {"train": 10_000, "val": 3_000, "test": 5_000, "reference": 300}
"""Number of starts per split, before scenes that end too near a goal are dropped; as released, but for reference."""
SOURCE_STYLES = (0.1, 0.3, 0.5)
LEAST = 1e-3
"""Smallest d, radius, horizon and speed, because the engine uses float32."""
TIME_STEP = 0.02
FIRST, EVERY = 19, 20
"""Steps before the first frame, and between frames. Frames are 0.4 s apart, and agents rest for the first
0.02 s of the 8 s: the starts and dropped scenes of the released data fit no other offset."""
ARRIVED = 1.0 - TIME_STEP
"""Metres per m/s of speed: a scene is dropped if an agent is this near its goal at the last frame (it was then within
1 s of the goal one step earlier)."""
CLEAR_OF_GOALS = 0.5
"""Smallest distance of a start from the goals of other agents, metres."""
LEAN = {None: 0.0, "left": -1.0, "right": 1.0}
"""Lean of the engine by side of passing. With these, every pair of 400 scenes with d = 0.1 to 0.8 on circles of 5 and
7 m passes on its side (with half of the lean 99.8 % do), and the smallest distance of a pair stays 2 d."""
ANGLE = np.deg2rad(45)
"""Half width of the interval, around 180 degrees, of the angle between two agents."""
TRIES = 30
TRIAL, ROOM = 200, 0.1
"""Number of scenes to test whether there is room for the agents, and the smallest share that must find room at once."""


class Orca(RecordedDomain):
    """Agents that cross a circle and avoid each other by ORCA; simulated on first use.

    ## Description
    Two to 20 agents start on a circle, walk to the opposite point, and avoid each other by optimal reciprocal collision
    avoidance (van den Berg et al. 2011). The *style* is the radius d of the agents: their centres stay 2 d apart, which
    the paper calls a minimum separation of d. With two agents the scenes are
    distributed as the released ones of "Towards Robust and Adaptive Motion Forecasting: A Causal Representation
    Perspective" (CVPR 2022), section 4.2: time step 0.02 s, 20 frames 0.4 s apart, neighbour distance 10 m, speed up
    to 1 m/s, slower within 1 m of the goal. Agent 0 starts at a uniform angle and the others spread evenly from there,
    plus U(-45, 45) degrees times 2 / agents; each coordinate is shifted by U(-0.5, 0.5) m. An agent that overlaps
    another agent, or starts within 0.5 m of its goal, is placed again. Scenes in which an agent has come within 1 m of
    its goal by the last frame are dropped (about 4 % at d = 0.1, 0.5 % at d = 0.6).

    With a ``side`` agents prefer to pass each other on this side: with ``right`` each agent moves to its right, as in
    right-hand traffic. They keep the same distance.

    ## Observation
    x and y in metres, centre of the circle at the origin.

    ## Splits
    ``train`` 10,000 starts, ``val`` 3,000, ``test`` 5,000, and ``reference`` 300, each with its own random stream.
    With two agents every d has the same starts; with more, agents that would overlap are placed again.

    ## Arguments
    Args:
        d: Radius of an agent, metres, > 0.
        agents: Agents of a scene, 2 to 20.
        radius: Radius of the circle, metres, > 0. With 7 the agents meet after the observed steps ("blind").
        horizon: Time horizon of ORCA, seconds, > 0.
        speed: Preferred and highest speed, m/s, > 0.
        seed: Seed of all random values, 0 or more.
        scenes: Number of starts in each split; None for the numbers above.
        side: Side on which agents pass each other, ``"left"`` or ``"right"``; None for no preference.

    ## Credits
    van den Berg, Guy, Lin, Manocha, "Reciprocal n-body collision avoidance", ISRR 2011.
    """

    name = "orca"
    source = "simulated by motion-gym"
    terms = "free"
    oracle = "orca_oracle"
    headline = ("d",)
    same_world = ("d", "agents", "radius", "horizon", "speed", "scenes", "side")
    """With the same seed, all styles have the same starts (with two agents)."""
    draws_each_split = True
    dt = 0.4
    engine = ENGINE_VERSION
    first_frame = FIRST * TIME_STEP
    """Seconds of motion before the first frame."""

    def __init__(
        self,
        d: float = 0.3,
        agents: int = 2,
        radius: float = 5.0,
        horizon: float = 2.0,
        speed: float = 1.0,
        seed: int = 0,
        scenes: int | None = None,
        side: str | None = None,
    ):
        self.d, self.radius, self.horizon, self.speed = (
            number(name, value, LEAST, most, owner="domain `orca`")
            for name, value, most in (
                ("d", d, 10),
                ("radius", radius, 100),
                ("horizon", horizon, 100),
                ("speed", speed, 10),
            )
        )
        self.agents = whole_number("agents", agents, 2, 20)
        self.seed = whole_number("seed", seed, 0, 2**63)
        self.scenes = None if scenes is None else whole_number("scenes", scenes, 1, 1_000_000)
        self.side = None if side is None else one_of("side", side, ("left", "right"), "domain `orca`")

    def recordings(self, split: str) -> list[Recording]:
        """One recording: the scenes of the split one after another, 20 frames each, with a new id for each agent."""
        xy = self.simulated(split)["positions"].astype(np.float64)
        return [recording_of_scenes(xy, self.dt, f"orca {split}")]

    def sources(  # type: ignore[override]
        self, styles: Sequence[float | Mapping[str, Any]] = SOURCE_STYLES
    ) -> list[Orca]:
        """The same domain with the training styles.

        Args:
            styles: Values of d, or parameters to change, as ``{"side": "left", "d": 0.1}``; by default the values of
                the paper, 0.1, 0.3 and 0.5.
        """
        others = [self.replace(**(style if isinstance(style, Mapping) else {"d": style})) for style in styles]
        return [shared(type(self), **other.parameters) for other in others]  # type: ignore[arg-type]

    def simulated(self, split: str) -> dict[str, np.ndarray]:
        """Positions [S, 20, N, 2] float32 of a split, from the cache if possible."""
        self.check_split(split)
        starts = self.scenes or STARTS[split]
        stated = {name: value for name, value in self.parameters.items() if value is not None}
        key = {**stated, "scenes": starts, "name": "orca", "split": split, "engine": ENGINE_VERSION}
        make = functools.partial(self._simulate, split, starts)
        return self.kept(f"simulation of {split}", lambda: cached_arrays(key, make))

    def _simulate(self, split: str, starts: int) -> dict[str, np.ndarray]:
        start = self._starts(np.random.default_rng([self.seed, self.splits.index(split)]), starts)
        simulation = self.simulate(start)
        remaining = np.linalg.norm(simulation.positions[:, -1] + start, axis=-1)
        keep = (remaining > ARRIVED * self.speed).all(axis=1)
        if not keep.any():
            raise SpecError(
                f"In all {starts} scenes of `{split}` an agent has come near its goal after 8 s, and such scenes are "
                f"dropped: give a radius above {self.radius:g} m, a speed below {self.speed:g} m/s, or more scenes."
            )
        return {"positions": simulation.positions[keep].astype(np.float32)}  # exact: the origin is zero here

    def simulate(self, start: np.ndarray, frames: int = WINDOW):
        """Simulate the first frames of scenes with starts [S, N, 2] and opposite goals; returns a ``Simulation``."""
        return simulate(
            start,
            -start,
            radius=self.d,
            time_horizon=self.horizon,
            max_speed=self.speed,
            time_step=TIME_STEP,
            first=FIRST,
            every=EVERY,
            steps=FIRST + EVERY * (frames - 1),
            lean=LEAN[self.side],
        )

    def _starts(self, rng: np.random.Generator, scenes: int) -> np.ndarray:
        _, room = self._place(np.random.default_rng(0), TRIAL)
        if room.mean() < ROOM:
            raise SpecError(
                f"There is no room on a circle of radius {self.radius:g} m for {self.agents} agents of radius "
                f"d={self.d:g} m without overlaps at the start. Give a smaller d, fewer agents or a larger radius."
            )
        start = np.empty((scenes, self.agents, 2))
        waiting = np.arange(scenes)
        while len(waiting):
            drawn, placed = self._place(rng, len(waiting))
            start[waiting[placed]] = drawn[placed]
            waiting = waiting[~placed]
        return start

    def _place(self, rng: np.random.Generator, scenes: int) -> tuple[np.ndarray, np.ndarray]:
        """Draw starts [S, N, 2], agent by agent; also returns whether all agents of a scene were placed, [S] bool."""
        start = np.empty((scenes, self.agents, 2))
        first = rng.uniform(0, 2 * np.pi, scenes)
        placed = np.ones(scenes, bool)
        for agent in range(self.agents):
            waiting = np.flatnonzero(placed)
            for _ in range(TRIES):
                spread = rng.uniform(-1, 1, len(waiting)) * ANGLE * 2 / self.agents if agent else 0.0
                angle = first[waiting] + 2 * np.pi * agent / self.agents + spread
                shift = rng.uniform(-0.5, 0.5, (len(waiting), 2))
                start[waiting, agent] = self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1) + shift
                new, others = start[waiting, agent, None], start[waiting, :agent]
                crowded = (np.linalg.norm(new - others, axis=-1) <= 2 * self.d).any(axis=1)
                crowded |= (np.linalg.norm(new + others, axis=-1) < CLEAR_OF_GOALS).any(axis=1)
                waiting = waiting[crowded]
                if not len(waiting):
                    break
            placed[waiting] = False
        return start, placed
