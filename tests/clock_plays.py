"""Random recordings, and episodes of a clock."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from motion_gym.contract import Forecast, Recording
from motion_gym.stepping.clocks import Settled, Step
from motion_gym.stepping.outstanding import Outstanding

SPELLS = st.sampled_from((1, 7, 8, 9, 12, 19, 20, 22, 30))
some = settings(max_examples=30, deadline=None)


@st.composite
def recordings(draw):
    """One or two places; agents leave, are lost and found again, and frames without an agent are not listed."""
    places = []
    for place in range(draw(st.integers(1, 2))):
        rows = []
        for agent in draw(st.lists(st.integers(0, 9), unique=True, max_size=4)):
            frame = draw(st.integers(0, 12))
            for spell in draw(st.lists(SPELLS, min_size=1, max_size=3)):
                rows += [(3 + 10 * f, agent) for f in range(frame, frame + spell)]
                frame += spell + draw(st.sampled_from((1, 2, 15)))
        frame, agent = np.array(sorted(rows), np.int64).reshape(-1, 2).T
        xy = np.random.default_rng([place, len(rows)]).normal(size=(len(rows), 2)).cumsum(axis=0)
        places.append(Recording(frame, agent, xy, 0.4, listed=True))
    return places


def positions_for(names: list[int], time: int, samples: int = 2) -> np.ndarray:
    """[A, K, 12, 2] forecasts that depend on the agent and the time alone."""
    inner = np.arange(samples * 24).reshape(samples, 12, 2)
    outer = 7.3 * np.array(names, float).reshape(-1, 1, 1, 1) + 0.37 * time
    return (9 * np.sin(outer + 1.9 * inner)).astype(np.float32)


@dataclass
class Played:
    """The steps of an episode of a clock."""

    steps: list[Step] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    ledger: Outstanding = field(default_factory=Outstanding)

    def settled(self) -> list[Settled]:
        return [s.settled for s in self.steps if s.settled is not None]


def play(clock, samples: int = 2) -> Played:
    played, step = Played(), clock.reset()
    while True:
        played.steps.append(step)
        played.times.append(clock.time)
        if not len(step.observation):
            played.ledger = clock.ledger
            return played
        step = clock.step(Forecast(positions_for(step.identity.tolist(), clock.time, samples)))
