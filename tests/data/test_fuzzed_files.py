"""Damaged files of every kind are read, or refused with an error of motion-gym."""

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fuzzed import KINDS, read_changed


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_a_damaged_file_is_read_or_refused(kind, seed):
    with tempfile.TemporaryDirectory() as folder:
        read_changed(kind, Path(folder), seed)
