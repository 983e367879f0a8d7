"""Settings of adapters are chosen without the people who are scored."""

import itertools

import pytest

from motion_gym import catalog
from motion_gym.benchmarks.definitions.streams import ONLINE
from motion_gym.benchmarks.identity import shipped_card
from motion_gym.benchmarks.row_specs import domain


def scored(shifts):
    """Worlds of the scored domains with their split."""
    return {(domain(name).world, "test") for arguments in shifts.streams.values() for name in arguments["domains"]}


@pytest.mark.parametrize("name", ONLINE.shifts)
def test_no_setting_is_chosen_on_scored_people(name):
    """A world is another place, or draws the people of each split anew."""
    shifts = ONLINE.shifts[name]
    split = shifts.chosen_on.get("split", "test")
    for chosen, (world, other) in itertools.product(map(domain, shifts.chosen_on["domains"]), scored(shifts)):
        drawn_anew = getattr(type(chosen), "draws_each_split", False) and split != other
        assert chosen.world != world or drawn_anew, f"{chosen.name}, split {split}, and {world}"


@pytest.mark.parametrize("name", ONLINE.shifts)
def test_no_model_that_chooses_settings_or_is_adapted_was_trained_on_scored_people(name):
    shifts = ONLINE.shifts[name]
    sources = set(shifts.fitted_to)
    for weights in {shifts.weights, shifts.chosen_with} - {""}:
        sources |= set(shipped_card(weights, shifts.source)["trained_on"])
    assert sources
    for source, (world, split) in itertools.product(map(catalog.domain, sorted(sources)), scored(shifts)):
        drawn_anew = getattr(type(source), "draws_each_split", False) and split not in ("train", "val")
        assert source.world != world or drawn_anew, f"{source.name} and {world}"
