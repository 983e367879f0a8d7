"""The study of driving styles: measures of tracks with known answers, and its table."""

import json

import numpy as np
import pytest

from motion_gym.benchmarks.reports import traffic_tables
from motion_gym.benchmarks.studies.driving_styles import MEASURES, driving_styles, measured
from motion_gym.contract import Recording
from tests.traffic import SPEC, needs_highway_env

pytestmark = pytest.mark.filterwarnings("ignore:Mean of empty slice")  # a vehicle that follows nobody
FRAMES = 50


def recorded(*paths):
    """A recording of paths [50, 2] of vehicles that are all there from the first frame to the last."""
    frame, agent = np.divmod(np.arange(FRAMES * len(paths)), len(paths))
    return Recording(frame, agent, np.stack(paths, axis=1).reshape(-1, 2), 0.4)


def path(start, speed, lane=0.0, acceleration=0.0):
    time = 0.4 * np.arange(FRAMES)
    return np.stack([start + speed * time + acceleration / 2 * time**2, np.broadcast_to(lane, FRAMES)], axis=-1)


def means(recording, **options):
    values, vehicle = measured(recording, **{"lane_width": 4.0, "vehicle_length": 5.0, "following": 4.0, **options})
    assert list(values) == list(MEASURES)
    return {name: [float(np.nanmean(v[vehicle == i])) for i in np.unique(vehicle)] for name, v in values.items()}


def test_gap_and_headway_are_bumper_to_bumper_in_the_own_lane():
    found = means(recorded(path(0, 20), path(45, 20), path(20, 20, lane=4.0)))
    assert found["gap"][0] == pytest.approx(40) and found["headway"][0] == pytest.approx(2)
    assert np.isnan(found["gap"][1:]).all(), "nobody is in front"
    assert found["speed"] == pytest.approx([20] * 3) and found["acceleration"] == pytest.approx([0] * 3, abs=1e-9)


def test_a_vehicle_far_behind_follows_nobody():
    assert np.isnan(means(recorded(path(0, 20), path(200, 20)))["headway"]).all()


def test_acceleration_and_braking_count_the_same():
    found = means(recorded(path(0, 10, acceleration=1.5), path(500, 40, lane=4.0, acceleration=-1.5)))
    assert found["acceleration"] == pytest.approx([1.5, 1.5])


def test_changes_of_lane_are_counted_by_minute():
    lane = np.where(np.arange(FRAMES) < 25, 0.0, 3.8)
    found = means(recorded(path(0, 20, lane=lane), path(300, 20)))
    seconds = 0.4 * (FRAMES - 2)
    assert found["lane_changes"] == pytest.approx([60 / seconds, 0])


def test_the_table_shows_measures_and_counts_of_each_style():
    needs_highway_env()
    domains = {style: f"highway:style={style},runs=1,seconds=20" for style in ("calm", "aggressive")}
    study = driving_styles(domains, ["calm"], 4.0, 5.0, 4.0, {"roundabout": SPEC})
    study = json.loads(json.dumps(study, allow_nan=False))
    assert set(study["counts"]) == {"calm", "aggressive", "roundabout"} and set(study["counts"]["calm"]) == {
        "train",
        "test",
    }
    calm, aggressive = (study["measures"][style]["speed"] for style in domains)
    assert calm[1] < calm[0] < calm[2] < aggressive[1], "intervals of the speeds do not overlap"
    headways = [study["measures"][style]["headway"] for style in domains]
    assert headways[1][2] < headways[0][1], "nor do those of the headways"
    table = traffic_tables.driving_styles(study)
    assert [row[0] for row in table.rows] == ["calm", "aggressive"]
    assert f"{calm[0]:.2f} [{calm[1]:.2f}, {calm[2]:.2f}]" == table.rows[0][5]
    assert any(note.startswith("train: at least") for note in table.notes)
