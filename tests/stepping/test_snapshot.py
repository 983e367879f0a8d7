"""Snapshots of objects and of the global random state, and their changes."""

import copy
import random
import sys
import types

import numpy as np
import pytest

from motion_gym.stepping.snapshot import changed, global_randomness, shared_arrays, snapshot


class Holder:
    """State that hides its attributes."""

    __slots__ = ("value",)

    def __init__(self, value):
        self.value = value


def test_content_is_compared_not_identity():
    thing = Holder({"a": [1, 2.0, None], "b": np.arange(3), "c": Holder("x"), "d": {1, 2}, "e": float("nan")})
    assert snapshot(thing) == snapshot(copy.deepcopy(thing))


@pytest.mark.parametrize(
    ("change", "path"),
    [
        (lambda s: s["list"].__setitem__(0, 9), "value['list'][0]"),
        (lambda s: s["array"].__setitem__(1, 9), "value['array']"),
        (lambda s: s["rng"].random(), "value['rng']"),
        (lambda s: s["old"].random(), "value['old']"),
        (lambda s: s.pop("list"), "value['list'][0]"),
        (lambda s: setattr(s["inner"], "value", 2), "value['inner'].value"),
    ],
)
def test_changes(change, path):
    thing = Holder({"list": [1], "array": np.arange(3), "rng": np.random.default_rng(0), "old": random.Random(0)})
    thing.value["inner"] = Holder(1)
    before = snapshot(thing)
    change(thing.value)
    assert changed(before, snapshot(thing)) == [path]


def test_what_is_added_is_a_cache():
    thing = Holder({"list": [1], "later": None})
    before = snapshot(thing)
    thing.value["list"].append(2)
    thing.value["later"] = 3
    thing.value["new"] = 4
    assert changed(before, snapshot(thing)) == []


def test_long_keys_are_cut_and_still_differ():
    keys = [bytes(500) + end for end in (b"a", b"b")]
    paths = list(snapshot({key: 1 for key in keys}))
    assert len(set(paths)) == 2 and max(map(len, paths)) < 70


def test_circles_end():
    thing = Holder([])
    thing.value.append(thing)
    assert snapshot(thing) == {}


def test_shared_memory():
    array = np.arange(4)
    assert shared_arrays(Holder(array), Holder(array[1:])) == ["value"]
    assert shared_arrays(Holder(array), Holder(array.copy())) == []
    array.flags.writeable = False
    assert shared_arrays(Holder(array), Holder(array)) == []


def test_torchs_generator_is_watched_where_torch_is_there(monkeypatch):
    class Generator:
        state = np.zeros(3)

        def manual_seed(self, seed):
            self.state = np.full(3, seed)

    generator = Generator()
    torch = types.SimpleNamespace(
        default_generator=generator,
        get_rng_state=lambda: types.SimpleNamespace(numpy=lambda: generator.state.copy(), kept=generator.state.copy()),
        set_rng_state=lambda state: setattr(generator, "state", state.kept),
    )
    monkeypatch.setitem(sys.modules, "torch", torch)
    generator.manual_seed(9)
    with global_randomness(4) as used:
        assert (generator.state == 4).all()
        generator.state[1] = 2
    assert used == ["torch"]
    assert (generator.state == 9).all()
