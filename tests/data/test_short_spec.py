"""The short spec of a domain makes the same domain."""

import shlex
from typing import Any

import pytest

import motion_gym
from motion_gym.data.domains import argument_of, spec_of
from motion_gym.envs.tracks import Tracks

make: Any = motion_gym.domain


@pytest.mark.parametrize(
    ("spec", "short"),
    [
        ("eth", "eth"),
        ("eth:alpha=64", "eth:alpha=64.0"),
        ("eth:alpha=64,sigma=paper", "eth:alpha=64.0"),
        ("eth:sigma=past", "eth:alpha=1.0,sigma=past"),
        ("eth:alpha=8,sigma=past", "eth:alpha=8.0,sigma=past"),
        ("zara1:min_agents=1", "zara1:min_agents=1"),
        ("orca", "orca:d=0.3"),
        ("orca:scenes=5,d=0.6", "orca:d=0.6,scenes=5"),
    ],
)
def test_short_spec_makes_the_same_domain(spec, short):
    domain = make(spec)
    assert spec_of(domain) == short
    assert make(short).parameters == domain.parameters


def test_short_spec_of_a_domain_with_required_parameters():
    class Own(motion_gym.data.domains.RecordedDomain):
        name = "own"

        def __init__(self, path, dt=0.4):
            self.path, self.dt = path, dt

    assert spec_of(Own("a.txt")) == "own:path=a.txt"
    assert spec_of(Own("a.txt", 0.5)) == "own:path=a.txt,dt=0.5"


@pytest.mark.parametrize(
    ("name", "argument"),
    [
        ("my walk.csv", '--domain "tracks:path=my walk.csv"'),
        ("a,b.csv", "--domain \"tracks:path='a,b.csv'\""),
        ("$HOME.csv", "--domain 'tracks:path=$HOME.csv'"),
    ],
)
def test_an_argument_of_the_command_line_is_quoted_for_a_shell(name, argument):
    domain = Tracks(name)
    assert argument_of(domain) == argument
    assert shlex.split(argument) == ["--domain", spec_of(domain)]
