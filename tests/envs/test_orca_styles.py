"""Styles of the ORCA domain: those of training, and the side of passing."""

import numpy as np
import pytest

from motion_gym import domain as make
from motion_gym.contract import SpecError
from motion_gym.data.domains import spec_of


def test_sources_are_shared_and_validated():
    first, again = (make("orca", d=d, scenes=3).sources() for d in (0.6, 0.8))
    assert [source.d for source in first] == [0.1, 0.3, 0.5] and all(s.scenes == 3 for s in first)
    assert all(one is other for one, other in zip(first, again, strict=True))
    for wrong in ("x", True, [0.3], 0.0):
        with pytest.raises(SpecError, match="must be a number"):
            make("orca", scenes=3).sources(styles=[wrong])


def test_a_side_is_printed_only_where_there_is_one():
    plain, right = make("orca", d=0.6, scenes=20), make("orca", d=0.6, scenes=20, side="right")
    assert spec_of(plain) == "orca:d=0.6,scenes=20" and spec_of(right) == "orca:d=0.6,scenes=20,side=right"
    assert not np.array_equal(plain.windows("test").future, right.windows("test").future)
    assert plain.world == right.world
    with pytest.raises(SpecError, match=r"`side=up` of domain `orca` is not known.*left, right"):
        make("orca", side="up")


def test_sources_can_combine_parameters():
    combined = [{"side": "left", "d": 0.1}, {"side": None, "d": 0.5}]
    sources = make("orca", d=0.6, side="right", scenes=20).sources(styles=combined)
    assert [(source.side, source.d) for source in sources] == [("left", 0.1), (None, 0.5)]
