"""Times and resampling: what a clock makes of frames and timestamps, and what tracks become at a step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motion_gym.contract import DataError, MotionGymError, SpecError
from motion_gym.data.tracks.frame_times import RawTimes, clock_of, read_times
from motion_gym.data.tracks.resampling import resample
from motion_gym.data.tracks.table_files import read_table

quick = settings(deadline=None, max_examples=40)


def clock(values, agent, fps=None, dt=None, step=0.4, per_second=None):
    return clock_of(RawTimes(np.asarray(values), per_second, "frame numbers"), np.asarray(agent), fps, dt, step, "walk")


def straight(times, speed=(1.0, -0.5)):
    return np.asarray(times, float)[:, None] * np.array(speed)


def resampled(values, agent, xy, step=0.4, gap=None, **rate):
    return resample(clock(values, agent, step=step, **rate), np.asarray(agent), xy, step, gap, "walk")


@given(st.integers(1, 12), st.integers(2, 6), st.integers(-500, 500), st.integers(0, 11))
@quick
def test_where_rates_divide_positions_are_those_of_listed_frames(stride, people, start, enters):
    fps = stride / 0.4
    frame = np.concatenate([start + np.arange(enters * p, 400) for p in range(people)])
    agent = np.repeat(np.arange(people), [400 - enters * p for p in range(people)])
    xy = np.random.default_rng(0).normal(size=(len(frame), 2))
    found = resampled(frame, agent, xy, fps=fps)
    assert (found.xy == xy[found.row]).all() and not len(found.irregular)
    assert (np.diff(np.unique(frame[found.row])) == stride).all()
    for person in range(people):  # every listed frame of the grid, and no other
        rows = found.row[agent[found.row] == person]
        assert len(rows) == ((frame[agent == person] - frame[found.row[0]]) % stride == 0).sum()


@given(st.sampled_from([3.0, 7.0, 12.0, 15.0, 16.0, 23.98, 24.0, 59.94]), st.floats(0.3, 2.0), st.integers(1, 4))
@quick
def test_straight_walkers_stay_straight_and_in_time_at_any_rate(fps, step, people):
    frame = np.tile(np.arange(300), people)
    agent = np.repeat(np.arange(people), 300)
    if step < 1 / fps:
        return
    xy = straight(frame / fps)
    found = resampled(frame, agent, xy, step=step, fps=fps)
    np.testing.assert_allclose(found.xy, straight(found.seconds), atol=1e-9)
    for person in range(people):
        mine = agent[found.row] == person
        assert (np.diff(found.step[mine]) == 1).all() and mine.sum() >= 300 / fps / step - 2
        # 29.97 frames a second make steps of 0.4004 s, which are said to be 0.4 s
        np.testing.assert_allclose(np.diff(found.seconds[mine]), step, rtol=0.006)


def test_no_position_depends_on_a_later_sample():
    rng = np.random.default_rng(1)
    frame, agent = np.tile(np.arange(200), 2), np.repeat([0, 1], 200)
    xy = rng.normal(size=(400, 2)).cumsum(axis=0)
    found = resampled(frame, agent, xy, fps=7.0)
    assert "extrapolated" in found.how
    assert (found.seconds >= frame[found.row] / 7.0 - 1e-9).all()
    for cut in (50, 117):
        other = np.where((frame > cut)[:, None], xy + 100, xy)
        again = resampled(frame, agent, other, fps=7.0)
        past = found.seconds < (cut + 1) / 7.0 - 1e-9
        assert (again.xy[past] == found.xy[past]).all() and not np.array_equal(again.xy, found.xy)


@pytest.mark.parametrize(
    ("lost", "gap", "steps"), [(1, None, 0), (4, None, 1), (4, 0.8, 0), (30, None, 9), (30, 1.0, 10)]
)
def test_nothing_is_filled_over_a_longer_gap(lost, gap, steps):
    frame = np.setdiff1d(np.arange(140), np.arange(70, 70 + lost))
    found = resampled(frame, np.zeros(len(frame), int), straight(frame / 7), gap=gap, fps=7.0)
    missing = int((np.diff(np.unique(found.step)) - 1).sum())
    assert abs(missing - steps) <= 2 if steps else missing == 0
    ahead = found.seconds - frame[found.row] / 7
    assert ahead.max() <= (gap or 0.2) + 1e-9


@pytest.mark.parametrize("gap", [None, 0.3, 5.0])
@pytest.mark.parametrize("fps", [24.0, 25.0])
def test_nothing_is_extrapolated_beyond_the_last_sample(fps, gap):
    frame = np.concatenate([np.arange(0, 300), np.arange(0, 200)])
    agent = np.repeat([0, 1], [300, 200])
    found = resampled(frame, agent, straight(frame / fps), gap=gap, fps=fps)
    for person, last in ((0, 299), (1, 199)):
        assert found.seconds[agent[found.row] == person].max() <= last / fps + 0.2 + 1e-9


@pytest.mark.parametrize(("gap", "missing"), [(None, 1), (0.4, 1), (0.8, 0), (1.0, 0)])
def test_a_gap_is_bridged_where_rates_divide_too(gap, missing):
    frame = np.setdiff1d(np.arange(0, 400, 10), [200])
    xy = np.random.default_rng(0).normal(size=(39, 2)).cumsum(axis=0)
    found = resampled(frame, np.zeros(39, int), xy, gap=gap, fps=25.0)
    assert 40 - len(found.row) == missing
    filled = found.seconds - frame[found.row] / 25 > 1e-6
    np.testing.assert_allclose(found.xy[~filled], xy)
    if not missing:
        np.testing.assert_allclose(found.xy[filled], [2 * xy[19] - xy[18]])


def test_a_gap_longer_than_a_window_is_refused():
    with pytest.raises(SpecError, match=r"gap=1e\+09 s is longer than a window of 20 steps: give at most 8 s"):
        resampled(np.arange(40), np.zeros(40, int), straight(np.arange(40)), gap=1e9, fps=24.0)


@pytest.mark.parametrize("late", [1e-5, 1e-3])
def test_samples_sent_twice_are_one_sample(late):
    rng = np.random.default_rng(0)
    once = np.cumsum(rng.uniform(0.08, 0.12, 600))
    again = once[10::50] + late
    times = np.concatenate([once, again])
    xy = straight(times) + np.concatenate([np.zeros((600, 2)), np.full((12, 2), 0.01)])
    found = resampled(times, np.zeros(612, int), xy, per_second=1)
    expected = resampled(once, np.zeros(600, int), straight(once), per_second=1)
    np.testing.assert_allclose(found.xy, expected.xy, atol=1e-9)
    assert "; 12 rows less than 0.0" in found.how and "left out" not in expected.how


def test_one_stray_row_does_not_spoil_the_grid():
    frame = np.append(np.repeat(np.arange(0, 400, 10), 3), 203)
    agent = np.append(np.tile([0, 1, 2], 40), 1)
    found = resampled(frame, agent, straight(frame), dt=0.4)
    assert len(found.row) == 120 and found.irregular.tolist() == [120]


def test_frames_may_begin_anew_after_a_long_gap():
    frame = np.concatenate([np.arange(0, 300, 10), np.arange(1007, 1307, 10)])
    found = resampled(frame, np.zeros(60, int), straight(frame), fps=25.0)
    assert len(found.row) == 60 and not len(found.irregular)
    assert np.sort(np.diff(found.step)).tolist()[-1] >= 20


def test_agents_at_phases_of_their_own_are_extrapolated():
    frame = np.concatenate([np.arange(0, 400, 10), np.arange(3, 400, 10), np.arange(7, 400, 10)])
    agent = np.repeat([0, 1, 2], 40)
    found = resampled(frame, agent, straight(frame / 25), fps=25.0)
    assert "extrapolated" in found.how
    np.testing.assert_allclose(found.xy, straight(found.seconds), atol=1e-9)
    assert min(np.bincount(agent[found.row])) >= 38


@given(st.floats(0.0, 0.08), st.integers(0, 10_000))
@quick
def test_jitter_at_the_own_rate_tears_no_track(jitter, seed):
    times = np.arange(100) * 0.4 + np.random.default_rng(seed).uniform(-jitter, jitter, 100)
    found = resampled(np.repeat(times, 2), np.tile([0, 1], 100), straight(np.repeat(times, 2)), per_second=1)
    for person in (0, 1):
        steps = np.sort(found.step[found.row % 2 == person])
        assert (np.diff(steps) == 1).all() and len(steps) >= 98


@pytest.mark.parametrize("rate", [0.397, 0.4, 0.403])
def test_a_clock_that_is_a_little_fast_or_slow_tears_no_track(rate):
    times = np.round(1_400_000_000 + np.arange(400) * rate, 3)
    found = resampled(times, np.zeros(400, int), straight(times - times[0]), per_second=1)
    assert found.step.tolist() == list(range(400))


def test_timestamps_of_a_dense_sensor_are_thinned():
    times = np.round(np.arange(0, 40, 1 / 30), 3)
    found = resampled(times, np.zeros(len(times), int), straight(times), per_second=1)
    assert found.how == "every 12th frame number" and len(found.row) == 100


@pytest.mark.parametrize(
    ("rate", "remedy"), [({"fps": 2.0}, "step=0.5"), ({"dt": 1.0}, "step=1"), ({"fps": 1.0}, "step=1")]
)
def test_a_step_finer_than_the_file_is_refused(rate, remedy):
    with pytest.raises(SpecError, match=rf"finer than the file.*Give {remedy} "):
        resampled(np.arange(40), np.zeros(40, int), straight(np.arange(40)), **rate)


@pytest.mark.parametrize("dt", [0.4, 0.1, 0.25])
def test_dt_is_the_most_common_distance_of_listed_frames(dt):
    frame = np.array([0, 6, 12, 24, 30, 36, 60])
    clocked = clock(frame, np.zeros(7, int), dt=dt)
    np.testing.assert_allclose(clocked.seconds, frame / 6 * dt)
    assert clocked.interval == pytest.approx(dt)


def test_a_million_rows_are_resampled_in_seconds(benchmark=None):
    frame, agent = np.tile(np.arange(2000), 500), np.repeat(np.arange(500), 2000)
    for fps in (25.0, 7.0):
        found = resampled(frame, agent, straight(frame / fps), fps=fps)
        assert len(found.row) > 50_000


def times_of(tmp_path, fields, name="frame", delimiter=","):
    lines = [delimiter.join((name, "id", "x", "y")), *(delimiter.join((f, "1", "0.5", "1.5")) for f in fields)]
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    return read_times(read_table(tmp_path / "t.csv"), 0)


@pytest.mark.parametrize(
    ("name", "fields", "seconds"),
    [
        ("time", ["0.0", "0.4", "0.8"], [0, 0.4, 0.8]),
        ("seconds", ["0", "1", "2"], [0, 1, 2]),
        ("time_s", ["10", "11", "12"], [0, 1, 2]),
        ("time [min]", ["0.5", "1.5", "2"], [0, 60, 90]),
        ("Time [µs]", ["100", "400100"], [0, 0.4]),
        ("time_us", ["100", "400100"], [0, 0.4]),
        ("t [msec]", ["100", "500"], [0, 0.4]),
        ("timestamp (milliseconds)", ["100", "500"], [0, 0.4]),
        ("time_ns", ["0", "400000000"], [0, 0.4]),
        ("elapsed_time [hours]", ["0.5", "0.75"], [0, 900]),
        ("time/d", ["0", "2"], [0, 172800]),
        ("timestamp_ms", ["100", "500", "900"], [0, 0.4, 0.8]),
        ("Time [ms]", ["0", "400", "800.0"], [0, 0.4, 0.8]),
        ("frame", ["0.5", "1.0", "1.5"], [0, 0.5, 1]),
        ("t", ["1338213600.25", "1338213600.65"], [0, 0.4]),
        ("time", ["2024-05-31T12:00:00", "2024-05-31T12:00:00.4"], [0, 0.4]),
        ("stamp", ["2024-05-31 23:59:59.900", "2024-06-01 00:00:00.300"], [0, 0.4]),
        ("date", ["2024/05/31 12:00:00Z", "2024/05/31 14:00:01+02:00"], [0, 1]),
        ("time", ["23:00:00.5", "23:00:01"], [0, 0.5]),
    ],
)
def test_columns_that_say_their_time(tmp_path, name, fields, seconds):
    raw = times_of(tmp_path, fields, name)
    found = (raw.values - raw.values[0]) / raw.per_second
    np.testing.assert_allclose(found, seconds, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "fields", "message"),
    [
        ("frame", ["0", "1", "2"], r"whole numbers \(0, 1, 2, ...\).* Give fps .*or dt "),
        ("time", ["0", "1", "2"], "fps=1 for seconds, fps=1000 for milliseconds"),
        ("timestamps", ["0", "1", "2"], "fps=1 for seconds, fps=1000 for milliseconds"),
        ("time [jiffies]", ["0", "1.5"], "a known unit .* The unit `jiffies` in the header is not known. Give fps"),
        ("frame", ["1338213600250", "1338213600650"], "look like milliseconds since 1970: fps=1000"),
        ("stamp", ["1338213600250.5", "1338213600650.5"], "look like milliseconds since 1970: fps=1000"),
        ("stamp", ["1338213600", "1338213601"], "look like seconds since 1970: fps=1"),
        ("t", ["1338213600250000000", "1338213600650000000"], "look like nanoseconds since 1970: fps=1000000000"),
    ],
)
def test_numbers_without_a_rate_are_refused_with_what_to_say(tmp_path, name, fields, message):
    raw = times_of(tmp_path, fields, name)
    with pytest.raises(DataError, match=message):
        clock_of(raw, np.zeros(len(fields), int), None, None, 0.4, "walk")
    rate = {"fps": float(message.rpartition("fps=")[2])} if "since" in message else {"fps": 1000.0}
    assert clock_of(raw, np.zeros(len(fields), int), rate["fps"], None, 0.4, "walk").seconds[0] == 0


@pytest.mark.parametrize(
    "fields", [["0.5", "", "1.5"], ["0.5", "inf", "1.5"], ["0", "abc", "2"], ["2024-05-31", "2024-13-99"]]
)
def test_bad_times_name_their_line(tmp_path, fields):
    with pytest.raises(MotionGymError, match="line 3"):
        times_of(tmp_path, fields)


@pytest.mark.parametrize(
    ("name", "fields", "rate", "stated"),
    [
        ("time_s", ["0.0", "0.1", "0.2"], (10, None), "fps=10"),
        ("timestamp_ms", ["0", "100", "200"], (10, None), "fps=10"),
        ("time [min]", ["0.0", "0.1", "0.2"], (10, None), "fps=10"),
        ("time", ["0.0", "0.1", "0.2"], (10, None), "fps=10"),
        ("t", ["1338213600.25", "1338213600.65"], (25, None), "fps=25"),
        ("when", ["2024-05-31T12:00:00", "2024-05-31T12:00:00.4"], (25, None), "fps=25"),
        ("time_s", ["0.0", "0.1", "0.2"], (None, 0.4), "dt=0.4"),
    ],
)
def test_a_rate_that_contradicts_the_unit_of_the_column_is_refused(tmp_path, name, fields, rate, stated):
    raw = times_of(tmp_path, fields, name)
    with pytest.raises(DataError, match=f"walk: {stated} contradicts the file: .* Drop {stated.partition('=')[0]},"):
        clock_of(raw, np.zeros(len(fields), int), *rate, 0.4, "walk")
    assert clock_of(raw, np.zeros(len(fields), int), None, None, 0.4, "walk").interval > 0


def test_a_rate_that_agrees_with_the_column_is_taken(tmp_path):
    agent = np.zeros(3, int)
    for name, fields, rate in (
        ("time_ms", ["0", "100", "200"], (1000, None)),
        ("time", ["0.", "99.9", "200.1"], (1000, None)),
        ("time_s", ["0.0", "0.41", "0.8"], (None, 0.4)),
        ("frame", ["0.5", "2.5", "4.5"], (20, None)),
    ):
        assert clock_of(times_of(tmp_path, fields, name), agent, *rate, 0.4, "walk").interval < 0.5


def test_nanoseconds_are_exact(tmp_path):
    raw = times_of(tmp_path, ["1700000000000000001", "1700000000000000002"], "time_ns")
    assert (np.diff(raw.values) == 1).all()
