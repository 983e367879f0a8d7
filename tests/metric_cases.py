"""Random forecasts with their ground truth."""

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from motion_gym.contract import Forecast, Observation, Truth

fast = settings(max_examples=60, deadline=None)


def make(sizes, samples=5, seed=0, weighted=False, all_known=False, spread=1.0):
    """A forecast and a truth of scenes with the given sizes, close enough together for collisions."""
    rng = np.random.default_rng(seed)
    scene = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    agents = int(scene[-1])
    start = rng.uniform(0, 3, (agents, 1, 2))
    future = (start + rng.normal(0, 0.3, (agents, 12, 2)).cumsum(1)).astype(np.float32)
    noise = spread * rng.normal(0, 0.3, (agents, samples, 12, 2)).cumsum(2)
    known = np.ones((agents, 12), bool) if all_known else rng.random((agents, 12)) < rng.random((agents, 1)) * 1.3
    observation = Observation(np.zeros((agents, 8, 2), np.float32), scene, rng.permutation(agents), 0.4)
    truth = Truth(np.where(known[..., None], future, 0).astype(np.float32), known, observation)
    weights = rng.random((agents, samples)).astype(np.float32) if weighted else None
    return Forecast((future[:, None] + noise).astype(np.float32), weights), truth


@st.composite
def cases(draw, weighted=None, all_known=None, agents=7):
    sizes = draw(st.lists(st.integers(1, agents), max_size=5))
    return make(
        sizes,
        draw(st.integers(1, 6)),
        draw(st.integers(0, 2**32 - 1)),
        draw(st.booleans()) if weighted is None else weighted,
        draw(st.booleans()) if all_known is None else all_known,
        draw(st.sampled_from([0.3, 1.0, 4.0])),
    )
