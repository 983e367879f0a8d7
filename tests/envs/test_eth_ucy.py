from __future__ import annotations

import itertools
import math
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import motion_gym
from motion_gym.contract import DataError, SpecError
from motion_gym.data import datasets
from motion_gym.data.recordings import read_recording
from motion_gym.data.storage import data_folder
from motion_gym.scoring.evaluation import evaluate
from tests.windows import windows_of

make: Any = motion_gym.domain

PLACES = ("eth", "hotel", "univ", "zara1", "zara2", "eth6")
TRAINING = {
    "biwi_hotel": (231, 758),
    "crowds_zara01": (503, 1900),
    "crowds_zara02": (713, 4403),
    "crowds_zara03": (430, 1646),
    "students001": (336, 11691),
    "students003": (413, 8988),
    "uni_examples": (159, 423),
}


@pytest.fixture
def copied_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, eth_ucy: None) -> Path:
    """A copy of the data folder, whose files may be changed."""
    shutil.copytree(data_folder() / "eth_ucy", tmp_path / "eth_ucy")
    monkeypatch.setenv("MOTION_GYM_DATA", str(tmp_path))
    return tmp_path / "eth_ucy"


def sigma(domain, split="test"):
    return domain.windows(split).observation.history[..., 2]


@pytest.mark.parametrize(
    ("place", "windows", "agent_windows"),
    [("eth", 70, 181), ("hotel", 301, 1053), ("univ", 947, 24334), ("zara1", 602, 2253), ("zara2", 921, 5833)],
)
def test_test_windows_are_the_published_ones(eth_ucy, place, windows, agent_windows):
    observation = make(place).windows("test").observation
    assert (observation.scenes, len(observation)) == (windows, agent_windows)


def test_training_windows_are_the_published_ones(eth_ucy):
    result = {
        recording.name: (windows.observation.scenes, len(windows.observation))
        for place in make("eth").sources()
        for recording in place.recordings("train")
        if (windows := windows_of([recording], min_agents=2))
    }
    assert result == TRAINING


@pytest.mark.parametrize("place", PLACES)
def test_splits_cut_by_distinct_frames(eth_ucy, place):
    domain = make(place)
    for train, val in zip(domain.recordings("train"), domain.recordings("val"), strict=True):
        whole = read_recording(data_folder() / "eth_ucy" / f"{train.name}.txt", columns=domain.columns)
        frames = sorted(set(whole.frame.tolist()))
        cut = math.floor(0.8 * len(frames))
        assert sorted(set(train.frame.tolist())) == frames[:cut]
        assert sorted(set(val.frame.tolist())) == frames[cut:]
        assert len(train.frame) + len(val.frame) == len(whole.frame)
    tests = domain.recordings("test")
    assert [r.name + ".txt" for r in tests] == list(domain.test_files)
    for test in tests:
        whole = read_recording(data_folder() / "eth_ucy" / f"{test.name}.txt", columns=domain.columns)
        assert np.array_equal(test.frame, whole.frame) and np.array_equal(test.xy, np.round(whole.xy, 4))


@pytest.mark.parametrize(
    ("place", "ade", "fde"),
    [
        ("eth", 0.995, 2.234),
        ("hotel", 0.323, 0.617),
        ("univ", 0.524, 1.165),
        ("zara1", 0.431, 0.960),
        ("zara2", 0.326, 0.728),
        ("eth6", 0.679, 1.348),
    ],
)
def test_constant_velocity_scores_as_published(eth_ucy, place, ade, fde):
    metrics = evaluate("constant_velocity", place).metrics
    assert metrics["ADE"].mean == pytest.approx(ade, abs=0.001)
    assert metrics["FDE"].mean == pytest.approx(fde, abs=0.001)
    if place == "eth6":
        assert metrics["ADE"].agent_windows == 2313


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ("eth", "hotel 1 univ 2 zara1 4 zara2 8"),
        ("hotel", "eth 1 univ 2 zara1 4 zara2 8"),
        ("univ", "eth 1 hotel 2 zara1 4 zara2 8"),
        ("zara1", "eth 1 hotel 2 univ 4 zara2 8"),
        ("zara2", "eth 1 hotel 2 univ 4 zara1 8"),
        ("eth6", "hotel 1 univ 2 zara1 4 zara2 8"),
    ],
)
def test_sources_are_the_other_places_with_the_papers_alphas(place, expected):
    sources = make(place, alpha=64, curvature="squared", min_agents=3, stride=2).sources()
    assert " ".join(f"{s.name} {s.alpha:g}" for s in sources) == expected
    assert {(s.sigma, s.curvature, s.min_agents, s.stride) for s in sources} == {("paper", "squared", 3, 2)}


def test_sources_without_sigma_have_none():
    assert {(s.alpha, s.sigma) for s in make("eth").sources()} == {(None, "none")}
    assert {s.sigma for s in make("eth", sigma="past").sources()} == {"past"}


def test_crossed_design_gives_every_place_every_alpha():
    sources = make("zara1:alpha=16").sources(design="crossed")
    places, alphas = ("eth", "hotel", "univ", "zara2"), (1.0, 2.0, 4.0, 8.0)
    assert [(s.name, s.alpha) for s in sources] == [(p, a) for p in places for a in alphas]
    assert [s.name for s in make("zara1").sources(design="crossed")] == list(places)


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ("eth", ["hotel", "univ", "zara1", "zara2"]),
        ("eth6", ["hotel", "univ", "zara1", "zara2"]),
        ("zara1", ["eth", "hotel", "univ"]),
        ("zara2", ["eth", "hotel", "univ"]),
    ],
)
def test_sources_by_location_show_other_ground(place, expected):
    assert [s.name for s in make(place).sources(by="location")] == expected


@pytest.mark.parametrize("wrong", [{"design": "crosed"}, {"by": "locatoin"}])
def test_unknown_options_of_sources_are_refused(wrong):
    with pytest.raises(SpecError, match=r"Did you mean `(crossed|location)`"):
        make("eth").sources(**wrong)


def slow_sigma(track, alpha, power):
    """The formula of sigma in plain Python, for one agent: from 20 positions to 8 values."""
    velocity = [(0.0, 0.0)]
    for (x0, y0), (x1, y1) in itertools.pairwise(track):
        velocity.append((round(x1 - x0, 4), round(y1 - y0, 4)))
    values = []
    for t in range(8):
        dx = velocity[t + 8][0] - velocity[t][0]
        dy = velocity[t + 8][1] - velocity[t][1]
        values.append(alpha * (math.sqrt(dx * dx + dy * dy) ** power + 1))
    return values


@pytest.mark.parametrize(("curvature", "power"), [("norm", 1), ("squared", 2)])
@pytest.mark.parametrize("place", ["eth", "zara1"])  # data with 2 decimals, and with more
def test_sigma_equals_its_formula(eth_ucy, place, curvature, power):
    domain = make(place, alpha=8, curvature=curvature)
    rows = {}
    for recording in domain.recordings("test"):
        for frame, agent, (x, y) in zip(
            recording.frame.tolist(), recording.agent.tolist(), recording.xy.tolist(), strict=True
        ):
            rows[frame, agent] = (x, y)
    frames = sorted({frame for frame, _ in rows})
    expected = []
    for start in range(len(frames) - 19):
        window = frames[start : start + 20]
        here = sorted(a for f, a in rows if f == window[0] and all((g, a) in rows for g in window))
        if len(here) >= 2:
            expected += [slow_sigma([rows[f, a] for f in window], 8.0, power) for a in here]
    assert np.abs(sigma(domain) - np.array(expected)).max() < 1e-4  # float32 of values up to about 50


def test_the_first_sigma_reveals_the_first_future_step(eth_ucy):
    truth = make("eth:alpha=64").windows("test")
    step = np.linalg.norm(truth.future[:, 0] - truth.observation.xy[:, -1], axis=1)
    assert np.abs(truth.observation.history[:, 0, 2] / 64 - 1 - step).max() < 2e-4  # displacements have 4 decimals


@pytest.mark.parametrize("kind", ["paper", "past"])
@pytest.mark.parametrize("curvature", ["norm", "squared"])
def test_sigma_is_proportional_to_alpha(eth_ucy, kind, curvature):
    one, many = (make("eth", alpha=a, sigma=kind, curvature=curvature) for a in (1, 64))
    assert np.array_equal(64 * sigma(one), sigma(many))
    assert np.array_equal(one.windows("test").observation.xy, make("eth").windows("test").observation.xy)


@pytest.mark.parametrize(("kind", "reads_on"), [("paper", True), ("past", False)])
def test_only_the_papers_sigma_reads_the_future(eth_ucy, kind, reads_on):
    domain = make("hotel", alpha=8, sigma=kind)
    rng = np.random.default_rng(0)
    positions = rng.normal(size=(50, 20, 2))
    known = np.ones((50, 20), bool)
    other = positions.copy()
    other[:, 8:] += rng.normal(size=(50, 12, 2))
    before, after = domain.history(positions, known), domain.history(other, known)
    assert (not np.array_equal(before, after)) == reads_on
    assert domain.card.side_channels == (("sigma",) if reads_on else ())
    assert domain.card.features == ("x", "y", "sigma")


def test_sigma_from_the_past_equals_its_formula(eth_ucy):
    truth = make("eth", alpha=4, sigma="past").windows("test")
    xy = truth.observation.xy.astype(float)
    for track, result in zip(xy, truth.observation.history[..., 2], strict=True):
        velocity = [(round(b[0] - a[0], 4), round(b[1] - a[1], 4)) for a, b in itertools.pairwise(track)]
        change = [0.0, 0.0] + [math.dist(a, b) for a, b in itertools.pairwise(velocity)]
        assert result == pytest.approx([4 * (c + 1) for c in change], abs=2e-3)


def test_reference_scenes_are_excluded_from_test(eth_ucy):
    whole = make("zara1")
    domain = make("zara1", reference_share=0.3)
    ((reference,), (test,), (all_of_it,)) = (
        domain.recordings("reference"),
        domain.recordings("test"),
        whole.recordings("test"),
    )
    assert reference.frame.max() < test.frame.min()
    assert len(np.unique(reference.frame)) == math.floor(0.3 * len(np.unique(all_of_it.frame)))
    assert len(reference.frame) + len(test.frame) == len(all_of_it.frame)
    windows = [domain.windows(split).observation.scenes for split in ("reference", "test")]
    assert min(windows) > 100 and 602 - 19 <= sum(windows) < 602  # up to 19 windows lie across the cut
    assert whole.reference().observation.scenes == 0


def test_stride_and_min_agents_choose_windows(eth_ucy):
    sizes = np.diff(make("hotel").windows("test").observation.scene)
    assert np.diff(make("hotel:min_agents=5").windows("test").observation.scene).tolist() == (
        sizes[sizes >= 5].tolist()
    )
    every, third = (make("eth", stride=s, min_agents=1).windows("test") for s in (1, 3))
    assert 0.25 < len(third.future) / len(every.future) < 0.42
    rows = {row.tobytes() for row in every.future}
    assert all(row.tobytes() in rows for row in third.future)


def test_windows_are_read_only(eth_ucy):
    truth = make("eth").windows("test")
    with pytest.raises(ValueError, match="read-only"):
        truth.future[0] = 0
    with pytest.raises(ValueError, match="read-only"):
        truth.observation.history[0] = 0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"alpha": 0}, "`alpha=0` of domain `eth` must be a number above 0"),
        ({"alpha": -8}, "must be a number above 0"),
        ({"alpha": "strong"}, "`alpha=strong` .* must be a number"),
        ({"alpha": math.nan}, "must be a number"),
        ({"alpha": math.inf}, "must be a number"),
        ({"alpha": True}, "must be a number"),
        ({"alpha": [8]}, "must be a number"),
        ({"alpha": 8, "sigma": "papre"}, "Did you mean `paper`"),
        ({"alpha": 8, "sigma": "none"}, "no effect"),
        ({"alpha": 8, "sigma": False}, "`sigma=False` of domain `eth` is not known"),
        ({"alpha": 8, "curvature": "square"}, "Did you mean `squared`"),
        ({"min_agents": 0}, "`min_agents=0` .* whole number, 1 or more"),
        ({"min_agents": 1.5}, "whole number"),
        ({"stride": 0}, "`stride=0` .* whole number, 1 or more"),
        ({"reference_share": 1.5}, "`reference_share=1.5` .* must be a number, 0 or more, and below 1"),
        ({"reference_share": 1}, "must be a number, 0 or more, and below 1"),
        ({"reference_share": math.nan}, "must be a number, 0 or more, and below 1"),
        ({"reference_share": "half"}, "must be a number, 0 or more, and below 1"),
        ({"alhpa": 8}, "Did you mean `alpha`"),
    ],
)
def test_bad_parameters_are_refused(wrong, message):
    with pytest.raises(SpecError, match=message):
        make("eth", **wrong)


def test_unknown_split_is_refused(eth_ucy):
    with pytest.raises(SpecError, match=r"no split `tset`. Did you mean `test`"):
        make("eth").windows("tset")


def test_missing_data_names_the_remedy(tmp_path, monkeypatch):
    monkeypatch.setenv("MOTION_GYM_DATA", str(tmp_path))
    with pytest.raises(DataError) as caught:
        make("univ").windows("test")
    for part in (str(tmp_path / "eth_ucy" / "students001.txt"), "data fetch eth_ucy", "data add eth_ucy --from DIR"):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("damage", "what"), [(lambda b: b[: len(b) // 2], "truncated"), (lambda b: b.replace(b"8.46", b"8.47"), "edited")]
)
def test_damaged_file_is_named_with_a_remedy(copied_data, damage, what):
    path = copied_data / "biwi_eth.txt"
    content = path.read_bytes()
    assert damage(content) != content
    path.write_bytes(damage(content))
    with pytest.raises(DataError) as caught:
        make("eth").windows("test")
    for part in (str(path), "is damaged", what, "data fetch eth_ucy"):
        assert part in str(caught.value)
    # Other places read this file only for a source.
    assert make("hotel").windows("test").observation.scenes == 301


def test_a_file_damaged_after_reading_is_detected(copied_data):
    make("zara1").windows("test")
    path = copied_data / "crowds_zara01.txt"
    path.write_bytes(path.read_bytes().replace(b"1", b"2", 1))
    os.utime(path)
    with pytest.raises(DataError, match=r"crowds_zara01\.txt is damaged"):
        make("zara1").windows("test")


def test_card_names_files_and_terms(eth_ucy):
    card = make("zara2:alpha=8").card
    known = {f.name: f.sha256 for f in datasets.dataset("eth_ucy").files}
    assert dict(card.files) == {"crowds_zara02.txt": known["crowds_zara02.txt"]}
    assert card.parameters["alpha"] == 8.0 and card.parameters["sigma"] == "paper"
    assert "Pellegrini" in card.terms and card.unit == "m" and card.dt == 0.4
