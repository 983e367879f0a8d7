from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import motion_gym
from motion_gym.contract import Recording, SpecError
from motion_gym.data.domains import RecordedDomain
from motion_gym.stepping.wrappers import ScoreParallel


def walkers(people=3, steps=30):
    frame = np.repeat(np.arange(steps), people)
    agent = np.tile(np.arange(people), steps)
    return Recording(frame, agent, np.stack([0.5 * frame, 2.0 * agent], axis=1), 0.4)


class Files(RecordedDomain):
    name = "files"

    def __init__(self, path: str, alpha: float = 1.0, min_agents: int = 1, stride: int = 1):
        self.path, self.alpha, self.min_agents, self.stride = path, alpha, min_agents, stride

    def recordings(self, split):
        return [walkers()] if split == "test" else []


class Noisy(Files):
    same_world = ("alpha",)


class Renamed(Noisy):
    name, place = "renamed", "files"


@pytest.mark.parametrize("method", ["windows", "reference", "history"])
def test_a_domain_that_cuts_its_own_windows_is_refused_with_the_remedy(method):
    with pytest.raises(SpecError, match=rf"Domain class Own must not define `{method}`: (give|declare)"):
        type("Own", (RecordedDomain,), {method: lambda self, *arguments: None})


def test_the_card_counts_what_is_scored_and_what_was_recorded():
    domain = Files("a", min_agents=4)
    assert domain.card.counts == {}
    domain.windows("test")
    domain.windows("train")
    assert domain.card.counts == {
        "train": dict.fromkeys(("scenes", "agent_windows", "agents", "recorded_agent_windows", "recorded_agents"), 0),
        "test": {"scenes": 0, "agent_windows": 0, "agents": 0, "recorded_agent_windows": 33, "recorded_agents": 3},
    }


def test_real_counts_of_eth(eth_ucy):
    domain = motion_gym.domain("eth")
    domain.windows("test")
    counts = domain.card.counts["test"]
    assert (counts["agent_windows"], counts["recorded_agent_windows"]) == (181, 364)
    assert (counts["agents"], counts["recorded_agents"]) == (36, 360)


def test_the_world_is_the_place_with_the_parameters_that_choose_its_people(tmp_path, monkeypatch):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    monkeypatch.chdir(tmp_path)
    assert Files("a").world == Files(str(tmp_path / "a")).world != Files("b").world
    assert Files("a", alpha=2.0).world != Files("a").world
    assert Noisy("a", alpha=2.0).world == Noisy("a").world != Noisy("b").world
    assert Renamed("a", alpha=3.0).world == Noisy("a").world


def test_worlds_of_the_shipped_domains():
    def world(spec):
        return motion_gym.domain(spec).world

    assert world("eth") == world("eth6") == world("eth:alpha=64,stride=2") == "eth"
    assert len({world(place) for place in ("eth", "hotel", "univ", "zara1", "zara2")}) == 5
    assert world("orca:d=0.1") == world("orca:d=0.6") != world("orca:seed=1")


@pytest.mark.parametrize("parameters", [{"stride": 0}, {"stride": 1.5}, {"min_agents": -1}])
def test_windows_that_cannot_be_cut_are_refused(parameters):
    with pytest.raises(SpecError, match=f"`{next(iter(parameters))}="):
        Files("a", **parameters).windows("test")


class Pixels(Files):
    name, unit = "pixels", "px"

    def recordings(self, split):
        turning = [replace(r, xy=100 * r.xy + (r.frame % 7)[:, None]) for r in super().recordings(split)]
        return turning


def test_a_domain_in_pixels_is_scored_in_pixels():
    card = motion_gym.evaluate("constant_velocity", Pixels("a"))
    assert f"ADE {card.metrics['ADE'].mean:.3f} [" in str(card) and "] px, FDE" in str(card) and "] m" not in str(card)
    assert set(card.metrics) == {"ADE", "FDE"}, "a miss and a collision are distances in metres"
    assert {m["unit"] for m in card.as_dict()["metrics"].values()} == {"px"}
    env = ScoreParallel(motion_gym.parallel_env(Pixels("a")))
    env.reset()
    env.step({agent: np.zeros((1, 12, 2), np.float32) for agent in env.agents})
    assert set(env.score()) == {"ADE", "FDE"}
