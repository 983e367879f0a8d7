"""Numbers and dates in forms that mean something else than their value."""

import re

import numpy as np
import pytest

from motion_gym.contract import DataError
from motion_gym.data.tracks.dates import past_midnight
from motion_gym.data.tracks.frame_times import read_times
from motion_gym.data.tracks.number_forms import clock_form, refuse_thousands
from motion_gym.data.tracks.table_files import read_table
from motion_gym.data.tracks.tables import Table
from motion_gym.data.tracks.track_files import Reading, read_track_files


def table_of(tmp_path, fields, name="frame", end=""):
    lines = [
        f"{name};id;x;y{';note' if end else ''}",
        *(f"{field};1;0.5;{k}.25{end}" for k, field in enumerate(fields)),
    ]
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    return read_table(tmp_path / "t.csv")


@pytest.mark.parametrize("end", ["", ";a"])
@pytest.mark.parametrize(
    ("name", "fields", "first"),
    [
        ("frame", ["980", "990", "1.000", "1.010"], "1.000"),
        ("time", ["980", "990", "1.000", "1.010"], "1.000"),
        ("frame", ["980", "990", "1,000", "1,010"], "1,000"),
        ("frame", ["1.000", "1.010", "1.020"], "1.000"),
    ],
)
def test_thousands_separators_are_refused(tmp_path, name, fields, first, end):
    with pytest.raises(DataError, match=rf"column 0 `{name}` is {re.escape(first)}, .*Write 1000, without separator"):
        read_times(table_of(tmp_path, fields, name, end), 0)


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("time", ["1.000", "1.010", "1.020"]),
        ("time", ["99.960", "100.000", "100.040"]),
        ("frame", ["0.960", "1.000", "1.040"]),
        ("time", ["1", "1.125", "1.25"]),
        ("time", ["100", "100.125", "100.25"]),
        ("frame", ["998", "999", "1000"]),
    ],
)
def test_seconds_with_three_decimals_are_no_thousands(tmp_path, name, fields):
    table = table_of(tmp_path, fields, name)
    refuse_thousands(table, 0, counts=name == "frame")
    assert read_times(table, 0).values.tolist() == list(map(float, fields))


def test_positions_with_thousands_separators_are_refused(tmp_path):
    rows = [f"{k};1;{x};{y}.5" for k, (x, y) in enumerate([("900", 1), ("950", 2), ("1.000", 3), ("1.050", 4)])]
    (tmp_path / "t.csv").write_text("\n".join(["frame;id;x;y", *rows]) + "\n")
    with pytest.raises(DataError, match=r"column 2 `x` is 1\.000"):
        read_track_files(tmp_path / "t.csv", Reading(fps=25))


def test_hours_minutes_and_seconds_in_one_number_are_refused(tmp_path):
    day = 43_190 + 0.4 * np.arange(400)
    numbers = [f"{10000 * (t // 3600) + 100 * (t % 3600 // 60) + t % 60:.1f}" for t in day]
    with pytest.raises(DataError, match=r"HHMMSS: .* 120059\.6 is followed by 120100\. Write them as"):
        read_times(table_of(tmp_path, numbers, "time"), 0)
    with pytest.raises(DataError, match="HHMMSS"):
        read_times(table_of(tmp_path, [n.partition(".")[0] for n in numbers[::5]], "time"), 0)
    assert clock_form(day) == clock_form(np.arange(0, 4000, 10)) == clock_form(np.r_[0:59, 102:150]) == ""


def test_a_missing_timestamp_of_a_parquet_column_is_refused(tmp_path):
    times = np.array(["2024-05-31T12:00:00", "NaT"], "datetime64[ms]")
    table = Table(tmp_path / "t", ("time", "id", "x", "y"), [times, *np.ones((3, 2))], np.array([1, 2]), "Parquet")
    with pytest.raises(DataError, match="line 2: column 0 `time`, the time, is missing"):
        read_times(table, 0)


@pytest.mark.parametrize("zone", ["+02", "+0200", "+02:00", "-03:30", "Z"])
@pytest.mark.filterwarnings("error")
def test_time_zones(tmp_path, zone):
    table = table_of(tmp_path, [f"2024-05-31T12:00:00.4{zone}", "2024-05-31T12:00:00.8Z"], "time")
    ahead = {"-03:30": -3.5, "Z": 0}.get(zone, 2)
    assert np.diff(read_times(table, 0).values).item() == 400_000 + ahead * 3_600_000_000


@pytest.mark.filterwarnings("error")
def test_an_unknown_time_zone_is_named(tmp_path):
    with pytest.raises(DataError, match=r"line 3: .* is no date and time .*Write it as"):
        read_times(table_of(tmp_path, ["2024-05-31T12:00:00Z", "2024-05-31T12:00:01+2"], "time"), 0)


def test_times_of_the_day_go_on_past_midnight(tmp_path):
    seconds = 86_390 + 0.4 * np.arange(60)
    texts = [f"{int(t) // 3600 % 24:02}:{int(t) // 60 % 60:02}:{t % 60:06.3f}" for t in seconds]
    rows = [f"{text},{a},{k},{a}" for a in (1, 2) for k, text in enumerate(texts)]
    (tmp_path / "t.csv").write_text("\n".join(["time,id,x,y", *rows]) + "\n")
    (file,) = read_track_files(tmp_path / "t.csv", Reading())
    np.testing.assert_allclose(file.clock.seconds, np.tile(seconds - seconds[0], 2), atol=1e-6)
    assert len(file.recording.frame) == 120
    day = np.arange(0, 86_400, 60) * 10**6
    assert (past_midnight(day) == day).all() and (past_midnight(day[600:800]) == day[600:800]).all()


def test_a_rate_for_a_file_whose_header_says_seconds_is_refused(tmp_path):
    (tmp_path / "t.csv").write_text("time_s,id,x,y\n" + "".join(f"{k / 10},1,{k},0.5\n" for k in range(50)))
    with pytest.raises(DataError, match=r"fps=10 contradicts the file: the header says that column 0 `time_s`"):
        read_track_files(tmp_path / "t.csv", Reading(fps=10))
