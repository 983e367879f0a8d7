"""No forecast or score depends on later ground truth: runs over two domains that are equal up to a time."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest

import motion_gym as mg
from motion_gym import catalog
from motion_gym.online import evaluation as online
from motion_gym.online.evaluation import evaluate_online
from motion_gym.online.streams import Segment, Stream
from tests.bias import Bias
from tests.street import Street
from tests.taped import Taped, fitted_linear, scenes_of

CROWD = "orca:d=0.3,scenes=6"
STREET = Street(frames=140)
SOURCE = "modular_invariant"
PLAIN = "constant_velocity"
STGAT = "erm_no_sigma:weights=original/zara2"
FOR_STGAT = [
    ("none", "matured"),
    ("finetune:every=6,least=4", "matured"),
    ("finetune:every=6,least=4", "stepwise"),
    ("ema_anchor:every=3", "matured"),
    ("kalman", "matured"),
    ("kalman", "stepwise"),
    ("ekf:every=6,least=6,agents=2", "matured"),
]


def otherwise(place, after, leave):
    """A copy of a domain with different positions after a listed frame; people may also leave."""
    other = copy.copy(place)

    def recordings(split):
        (recording,) = place.recordings(split)
        tick = np.unique(recording.frame, return_inverse=True)[1].reshape(-1)
        rng = np.random.default_rng(after)
        xy = np.where((tick > after)[:, None], recording.xy + rng.normal(0, 3, recording.xy.shape), recording.xy)
        keep = (tick <= after) | (rng.random(recording.agent.max() + 1)[recording.agent] > 0.5 * leave)
        columns = {"frame": recording.frame[keep], "agent": recording.agent[keep], "xy": xy[keep]}
        return [dataclasses.replace(recording, **columns)]

    other.recordings = recordings
    return other


def seen_before(make, place, frames, after, leave=False, **options):
    """Differences up to ``after`` between runs over two domains that are equal until then, and the compared number."""
    tapes, cards, times = [], [], []
    place = catalog.domain(place)
    for world in (place, otherwise(place, after, leave)):
        taped, played = Taped(make(world)), Stream([Segment(world, 0, frames)])
        cards.append(evaluate_online(taped, played, **options))
        tapes.append(taped.tape)
        times.append(played.clock.times)
    until = int((times[0] <= after).sum())
    found = []
    for number, (one, other) in enumerate(zip(*(t.forecasts[:until] for t in tapes), strict=True)):
        assert times[0][number] == times[1][number] and np.array_equal(one[0], other[0])
        if not np.array_equal(one[1], other[1]):
            found.append(f"forecast at {times[0][number]}")
    scored = [
        {(made, value) for made, value in zip(c.made, c.values, strict=True) if made <= after - 12} for c in cards
    ]
    if scored[0] != scored[1]:
        found.append("scores")
    told = sum(index < until for index, _ in tapes[0].told)
    return found, {"told": told, "scored": len(scored[0]), "later": tapes[0].forecasts[-1], "card": cards[0]}


@pytest.mark.parametrize("adapter", catalog.ADAPTERS)
def test_no_forecast_or_score_depends_on_truth_that_comes_later(adapter):
    def make(world):
        return catalog.adapter("refine:steps=1" if adapter == "refine" else adapter, SOURCE)

    found, there = seen_before(make, CROWD, 120, 90)
    assert found == []
    assert there["told"] > 4 and there["scored"] == 8 and (there["card"].updates > 0) == (adapter != "none")


@pytest.mark.parametrize(("adapter", "labels"), FOR_STGAT)
def test_nor_does_one_of_stgat_where_people_come_and_go(eth_ucy, adapter, labels):
    def make(world):
        return catalog.adapter(adapter, STGAT)

    found, there = seen_before(make, "hotel", 72, 56, leave=True, labels=labels)
    assert found == []
    assert there["told"] > 10 and there["scored"] > 10 and (there["card"].updates > 2) == (adapter != "none")


@pytest.mark.parametrize("labels", online.LABELS)
@pytest.mark.parametrize(("adapter", "scope"), [("kalman", "stream"), *((Bias, scope) for scope in online.SCOPES)])
def test_nor_does_a_linear_one(adapter, labels, scope):
    def make(world):
        return catalog.adapter(adapter, fitted_linear())

    found, there = seen_before(make, STREET, 140, 90, leave=True, labels=labels, scope=scope)
    assert found == []
    assert there["told"] > 50 and there["scored"] > 50 and there["card"].updates > 50


class Foresees(Bias):
    """Learns from the ground truth of a scene before the forecast, without a change of its state."""

    def __init__(self, of, world, frames):
        super().__init__(of)
        self.truths = scenes_of(Stream([Segment(world, 0, frames)]).clock)

    def predict(self, observation, samples=1, seed=0):
        learned = copy.copy(self)
        learned.errors = copy.copy(self.errors)
        learned.observe(self.truths[int(observation.time[0])])
        return Bias.predict(learned, observation, samples, seed)


def test_whoever_learns_from_a_scene_before_it_is_scored_is_found():
    def make(world):
        return Foresees(mg.predictor(PLAIN), world, 140)

    found, _ = seen_before(make, STREET, 140, 90)
    assert {"forecast at 89", "forecast at 90"} <= set(found) and "forecast at 77" not in found
