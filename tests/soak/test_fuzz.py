"""Damaged files of every kind, many of them; and random recordings on both clocks."""

from __future__ import annotations

import shutil

import pytest
from hypothesis import HealthCheck, given, settings

from motion_gym.stepping.clocks import WindowsClock
from motion_gym.stepping.stream_clock import StreamClock
from tests.clock_plays import play, recordings
from tests.fuzzed import KINDS, read_changed
from tests.windows import windows_of


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files(kind, tmp_path, tally, tries):
    for seed in range(100 * tries):
        folder = tmp_path / str(seed)
        folder.mkdir()
        with tally(f"a damaged file is read or refused: {kind}", seed):
            read_changed(kind, folder, seed)
        shutil.rmtree(folder)


def test_clocks(tally, tries):
    @settings(max_examples=100 * tries, deadline=None, suppress_health_check=list(HealthCheck))
    @given(recordings())
    def settles_everything(places):
        with tally("random recordings on both clocks: each forecast settles once"):
            stream, truth = play(StreamClock(places)), windows_of(places, min_agents=1)
            assert stream.ledger.matured == len(truth.future) and len(stream.ledger) == 0
            assert stream.ledger.settled == StreamClock(places).count
            assert play(WindowsClock(truth)).ledger.settled == len(truth.future)

    settles_everything()
