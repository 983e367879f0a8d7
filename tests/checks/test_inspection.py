"""``inspect``: what it says of files that were read wrongly, and that it accuses no shipped domain wrongly."""

from __future__ import annotations

import json

import numpy as np
import pytest

import motion_gym
from motion_gym.checks.inspection import inspect, warnings_of
from motion_gym.contract import DataError, Recording, SpecError
from motion_gym.data.domains import RecordedDomain
from tests.walks import walk_rows, walks_file, write_rows

FEW = dict(people=8, frames=1500)


def report(tmp_path, rows, header="frame,id,x,y", **keywords):
    return inspect(write_rows(tmp_path / "walk.csv", rows, header=header), **{"split": "0 0 1", **keywords})


def only(report, words):
    """The one warning of a report, which holds the words."""
    assert len(report.warnings) == 1, report.warnings
    assert words in report.warnings[0]
    return report.warnings[0]


def test_a_good_file_has_no_warning_and_every_value_is_right(tmp_path):
    found = report(tmp_path, walk_rows(**FEW), fps=25)
    assert not found.warnings
    understood, measured = ({finding.name: finding for finding in part} for part in (found.understood, found.measured))
    assert understood["header"].value == ["frame", "id", "x", "y"]
    assert "by the names in the header" in understood["columns"].text
    assert understood["time"].text == "frame numbers, 25 a second as stated"
    assert understood["steps"].text == "every 10th frame number"
    assert understood["windows of test"].value["agents"] == 8
    assert measured["median speed"].value == pytest.approx(1.3, rel=0.02)
    assert measured["median step"].value == pytest.approx(0.52, rel=0.02)
    assert measured["people per frame"].value["most"] == 8
    assert json.loads(json.dumps(found.as_dict()))["warnings"] == []
    assert "Warnings\n  - none" in str(found)


def test_a_test_split_with_few_people_is_named(tmp_path):
    rows = [row for row in walk_rows(**FEW) if row[1] in (0, 1, 2) or row[0] < 700]
    found = report(tmp_path, rows, fps=25, split="0.5 0 0.5")
    path = tmp_path / "walk.csv"
    text = only(found, f"write --domain \"tracks:path={path},fps=25,split=0 0 1\" (for `inspect`: --split '0 0 1')")
    assert "Only 3 of 8 agents have windows in the split `test`" in text
    scored = motion_gym.domain("tracks", path=str(path), fps=25, split="0.5 0 0.5")
    assert warnings_of(scored) == found.warnings  # `score` prints them, too


def test_the_whole_file_is_not_advised_where_it_is_scored(tmp_path):
    rows = [row for row in walk_rows(**FEW) if row[1] in (0, 1, 2) or row[0] % 700 < 150]
    text = only(report(tmp_path, rows, fps=25), "have windows in the split `test`")
    assert "The other agents are in no window of 20 consecutive steps (7.6 s)" in text and "--domain" not in text


def as_feet(rows):
    return [(f, a, x / 0.3048, y / 0.3048) for f, a, x, y in rows]


def test_feet_at_ten_hertz(tmp_path):
    rows = as_feet(walk_rows(**FEW, fps=10))
    assert "unit=ft" in only(report(tmp_path, rows, fps=10), "times as fast as people walk")
    assert "give fps (as fps=10" in only(report(tmp_path, rows, dt=0.4), "Constant velocity is off by")
    assert not report(tmp_path, rows, fps=10, unit="ft").warnings


def test_centimetres_at_sixteen_frames_a_second(tmp_path):
    rows = [(f, a, 100 * x, 100 * y) for f, a, x, y in walk_rows(**FEW, fps=16)]
    found = report(tmp_path, rows, dt=0.4).warnings
    assert any("unit=cm and fps of about 16" in text for text in found), found
    assert any("unit=cm would give 1.3" in text for text in report(tmp_path, rows, fps=16).warnings)
    assert not report(tmp_path, rows, fps=16, unit="cm").warnings


@pytest.mark.parametrize(
    ("feet", "keywords", "said"),
    [
        (True, {"fps": 50, "unit": "ft"}, "fps of about 25 would give 1.3 m/s. Check fps=50 and unit=ft."),
        (True, {"fps": 50.0, "unit": "ft"}, "fps of about 25 would give 1.3 m/s. Check fps=50 and unit=ft."),
        (True, {"dt": 0.4, "unit": "ft"}, "fps of about 25 instead of dt=0.4 would give 1.3 m/s. Check dt=0.4 and"),
        (True, {"fps": 2.5, "unit": "ft"}, "fps of about 25 would give 1.3 m/s. Check fps=2.5 and unit=ft."),
        (True, {"fps": 25}, "unit=ft would give 1.30 m/s; or fps of about 7.6 would give 1.3 m/s. Check fps=25 and"),
        (True, {"dt": 0.4}, "unit=ft and fps of about 25 instead of dt=0.4 would give 1.3 m/s. Check dt=0.4 and"),
        (False, {"fps": 25, "unit": "ft"}, "unit=m would give 1.30 m/s; or fps of about 82 would give 1.3 m/s. Check"),
        (False, {"fps": 25, "unit": "cm"}, "0.013 m/s. unit=m would give 1.30 m/s. Check fps=25 and unit=cm, and"),
        (False, {"fps": 25, "unit": "km"}, "unit=m would give 1.30 m/s. Check fps=25 and unit=km."),
        (False, {"fps": 25, "scale": 0.3}, "unit=m without scale would give 1.30 m/s; or fps of about 83 would"),
        (False, {"dt": 0.01}, "dt of about 0.04 would give 1.3 m/s. Check dt=0.01 and unit=m."),
    ],
)
def test_units_and_rates_that_would_fit(tmp_path, feet, keywords, said):
    rows = walk_rows(**FEW, wobble=0.01)
    found = report(tmp_path, as_feet(rows) if feet else rows, **keywords)
    (text,) = [text for text in found.warnings if "Check" in text]
    assert f". {said}" in text or f"; {said}" in text or said in text.partition("median speed is ")[2]
    assert "unit=" not in said or f"; or unit={keywords.get('unit', 'm')} " not in text


def test_no_other_rate_is_offered_where_the_file_says_the_times(tmp_path):
    rows = [(f / 25, a, x, y) for f, a, x, y in as_feet(walk_rows(**FEW))]
    text = only(
        report(tmp_path, rows, header="time,id,x,y"), "unit=ft would give 1.30 m/s. Check the times of the file"
    )
    assert "fps" not in text


def test_a_file_in_which_nobody_moves_at_all(tmp_path):
    rows = [(f, a, 1.0, 2.0 * a) for f, a, x, y in walk_rows(**FEW)]
    assert any("Nobody moves in any step" in text for text in report(tmp_path, rows, fps=25).warnings)


def test_the_unit_is_said_to_be_converted(tmp_path):
    def unit(**keywords):
        return next(
            f.text for f in report(tmp_path, walk_rows(**FEW), fps=25, **keywords).understood if f.name == "unit"
        )

    assert [unit(), unit(unit="ft"), unit(unit="px")] == ["m", "ft, converted to m", "px"]
    assert unit(unit="px", scale=0.1) == "px, times 0.1, converted to m"


def test_a_report_is_as_wide_as_the_terminal(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = [row for row in as_feet(walk_rows(**FEW)) if row[1] in (0, 1, 2) or row[0] < 700]
    write_rows("walk.csv", rows)
    text = inspect("walk.csv", fps=25, unit="ft", split="0.5 0 0.5").text(80)
    assert max(map(len, text.splitlines())) <= 80
    assert (
        "\n  columns                   frame or time column 0 `frame`, id column 1 `id`, x\n" + " " * 28 + "c" in text
    )
    assert '--domain "tracks:path=walk.csv,fps=25,unit=ft,split=0 0 1"' in text  # in one line, to be copied


def test_thirty_frames_a_second_that_are_not_thinned(tmp_path):
    found = report(tmp_path, walk_rows(people=8, frames=3000, fps=30), dt=0.4).warnings
    assert any("times slower than people walk" in text and "fps of about 30" in text for text in found), found


class Misread(RecordedDomain):
    """Tracks of one's own at another rate than said."""

    name = "misread"

    def __init__(self, fps: float = 30.0):
        self.fps = fps

    def recordings(self, split):
        """The same tracks for every split."""
        self.check_split(split)
        rows = np.array(walk_rows(people=6, frames=900, fps=self.fps, wobble=0.25))
        return [Recording(rows[:, 0], rows[:, 1], rows[:, 2:], self.dt)]


def test_domains_of_ones_own_are_warned_of_too():
    assert any("fps of about 30" in text for text in warnings_of(Misread()))
    assert not warnings_of(Misread(fps=2.5))


def test_jumps_and_ids_that_come_back(tmp_path):
    rows = walk_rows(**FEW, every=10)
    moved = [(f, a, x + 40 * (a == 3 and f > 800), y) for f, a, x, y in rows]
    text = only(report(tmp_path, moved, fps=25), "1 step is a jump")
    assert "agent 3 moves" in text
    spike = [(f, a, x + 40 * (a == 3 and f == 800), y) for f, a, x, y in rows]
    only(report(tmp_path, spike, fps=25), "2 steps are jumps")
    later = [(f + 25 * 130, a, x, y) for f, a, x, y in rows]
    assert "agent" in only(report(tmp_path, rows + later, fps=25), "come back after a long absence")
    soon = [(f + 25 * 70, a, x, y) for f, a, x, y in rows]
    found = report(tmp_path, rows + soon, fps=25)
    assert not found.warnings and found.as_dict()["measured"]["gaps with nobody"] == 1


def test_irregular_frames_are_named(tmp_path):
    rows = [*walk_rows(**FEW, every=10), (803, 2, 1.0, 1.0)]
    assert "frame 803 in line" in only(report(tmp_path, rows, fps=25), "1 rows are between the regular frames")


def test_constant_columns_and_a_vertical_y(tmp_path):
    rows = [(f, a, x, 1.7, y) for f, a, x, y in walk_rows(**FEW)]
    found = report(tmp_path, rows, header="frame,id,x,y,z", fps=25)
    assert "y is 1.7 in every row" in only(found, "columns='FRAME ID X Y'")
    assert found.as_dict()["understood"]["constant columns"] == ["column 3 `y`"]


def test_a_stated_swap_is_suspected(tmp_path):
    path = write_rows(tmp_path / "walk.txt", [(a, f, x, y) for f, a, x, y in walk_rows(**FEW)], " ", header=None)
    with pytest.raises(DataError, match="cannot be right"):
        inspect(path, fps=25)
    assert any("Frame and id seem to be swapped" in text for text in inspect(path, fps=25, columns="0 1 2 3").warnings)


def test_coarse_and_noisy_positions(tmp_path):
    rng, rows = np.random.default_rng(0), walk_rows(**FEW, every=10)
    coarse = [(f, a, round(x / 0.3) * 0.3, round(y / 0.3) * 0.3) for f, a, x, y in rows]
    assert any("lie on a grid of 0.3 m" in text for text in report(tmp_path, coarse, fps=25).warnings)
    noisy = [(f, a, x + rng.normal(0, 0.2), y + rng.normal(0, 0.2)) for f, a, x, y in rows]
    found = report(tmp_path, noisy, fps=25)
    assert any("Measurement noise is up to" in text for text in found.warnings)
    assert found.as_dict()["measured"]["measurement noise"] == pytest.approx(0.2, rel=0.2)
    assert report(tmp_path, rows, fps=25).as_dict()["measured"]["measurement noise"] < 0.02


def test_people_who_stand_and_wide_places(tmp_path):
    rows = walk_rows(**FEW, every=10)
    still = [(f, a, x if a == 0 else float(a), y if a == 0 else 1.5 * a) for f, a, x, y in rows]
    assert any("of the steps are of agents who stand" in text for text in report(tmp_path, still, fps=25).warnings)
    wide = [(f, a, x + 9000 * a, y) for f, a, x, y in rows]
    assert any("Positions span" in text for text in report(tmp_path, wide, fps=25).warnings)


def test_the_unit_of_the_header_is_compared(tmp_path):
    found = report(tmp_path, walk_rows(**FEW), header="frame,id,x [ft],y [ft]", fps=25)
    assert "unit=m was read: say unit=ft" in only(found, "The header says ft")


def test_an_unknown_unit_of_the_header_is_named_unless_a_scale_says_what_it_is(tmp_path):
    header = "frame,id,x [furlong],y [furlong]"
    found = report(tmp_path, walk_rows(**FEW), header=header, fps=25)
    assert "say scale=, the metres of one furlong" in only(found, "The header says furlong")
    scaled = report(tmp_path, walk_rows(**FEW), header, fps=25, scale=201.2)
    assert not any("furlong" in text for text in scaled.warnings)


def test_the_units_of_all_headers_are_compared(tmp_path):
    for person in range(3):
        rows = [(f, x, y) for f, a, x, y in walk_rows(**FEW) if a == person]
        write_rows(tmp_path / f"p{person}.csv", rows, header="frame,x [ft],y [ft]" if person == 2 else "frame,x,y")
    found = inspect(str(tmp_path / "p*.csv"), fps=25, split="0 0 1")
    assert "p2.csv says ft, others say another or none" in only(found, "and unit=m was read for all 3 files")
    assert "unit=m was read: say unit=yd" in only(
        report(tmp_path, walk_rows(**FEW), "frame,id,x [yards],y [yards]", fps=25), "The"
    )
    with pytest.raises(DataError, match=r"`x \[m\]` is in m and column 3 `y \[inches\]` in in: write both in one"):
        report(tmp_path, walk_rows(**FEW), "frame,id,x [m],y [inches]", fps=25)


@pytest.mark.parametrize(("name", "unseen"), [("lost", 1), ("Occluded", "true"), ("is_valid", 0), ("visible", "False")])
def test_marked_positions_are_named(tmp_path, name, unseen):
    seen = {1: 0, 0: 1}.get(unseen, "yes" if unseen == "False" else "no")
    rows = [(*row, unseen if k % 50 == 7 else seen) for k, row in enumerate(walk_rows(**FEW))]
    count = sum(row[4] == unseen for row in rows)
    found = report(tmp_path, rows, header=f"frame,id,x,y,{name}", fps=25)
    assert f"{count} rows by `{name}`" in only(found, "marked as not seen and are used")
    unmarked = [(*row[:4], seen) for row in rows]
    assert not report(tmp_path, unmarked, header=f"frame,id,x,y,{name}", fps=25).warnings


def test_a_copy_among_files_is_named(tmp_path):
    for name, person in (("a", 0), ("b", 1), ("copy of b", 1)):
        rows = [(f, x, y) for f, a, x, y in walk_rows(**FEW) if a == person]
        write_rows(tmp_path / f"{name}.csv", rows, header="frame,x,y")
    found = inspect(str(tmp_path / "*.csv"), fps=25, split="0 0 1")
    assert any("copy of b.csv has the same content as b.csv" in text for text in found.warnings)
    assert not any("content" in text for text in inspect(str(tmp_path / "?.csv"), fps=25, split="0 0 1").warnings)


def test_few_rows_are_no_grid(tmp_path):
    rows = [row for row in walk_rows(**FEW, every=10) if row[1] == 0]
    assert not any("grid" in text for text in report(tmp_path, rows, fps=25).warnings)


def test_a_header_that_names_frame_and_id_is_not_accused_of_a_swap(tmp_path):
    rows = [(4 * k, lane, 12.0 * k, 3.5 * lane) for k in range(160) for lane in (0, 1)]
    found = report(tmp_path, rows, header="frame,vehicle_id,x,y", fps=10)
    assert not any("swapped" in text for text in found.warnings)
    assert found.as_dict()["understood"]["windows of test"]["agents"] == 2


def test_files_of_one_person_that_all_begin_alike(tmp_path):
    for person in range(4):
        rows = [(k / 25, x, y) for k, (f, a, x, y) in enumerate(walk_rows(**FEW)) if a == person]
        rows = [(t - rows[0][0], x, y) for t, x, y in rows]
        write_rows(tmp_path / f"p{person}.csv", rows, header="time,x,y")
    found = inspect(str(tmp_path / "p*.csv"), split="0 0 1")
    assert any("All 4 files of one person each begin at the same time" in text for text in found.warnings)
    assert "1 recording of 4 files, of one person each, put together" in str(found)


@pytest.mark.parametrize(
    "name", ["hotel", "univ", "zara1", "zara2", "eth6", "orca:scenes=60", "orca:scenes=30,agents=6"]
)
def test_no_false_alarm_on_shipped_domains(name, request):
    if not name.startswith("orca"):
        request.getfixturevalue("eth_ucy")
    assert not inspect(name).warnings and not warnings_of(motion_gym.domain(name))


def test_eth_is_truly_too_fast(eth_ucy):
    assert "times as fast as people walk" in only(inspect("eth"), "The median speed is 2.48 m/s")


def test_what_can_be_inspected():
    assert inspect("tracks", path=walks_file(), fps=25).title == inspect(walks_file(), fps=25).title
    with pytest.raises(DataError, match=r"there is no file nothing\.csv\. Check the name and the folder\."):
        inspect("nothing.csv")
    with pytest.raises(SpecError, match="Did you mean `hotel`"):
        inspect("hotl")
