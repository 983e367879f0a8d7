"""The domain ``tracks``: from files of every form to windows and scores."""

from __future__ import annotations

import gzip
import os
import pickle
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import motion_gym
from motion_gym.catalog import domain, format_spec, parse_spec
from motion_gym.checks.checker import check_domain
from motion_gym.contract import DataError, MotionGymError, SpecError
from motion_gym.data.domains import spec_of
from tests.walks import walk_rows, walks_file, write_rows
from tests.windows import windows_of

CASES = Path(os.environ.get("MOTION_GYM_SHARED", Path(__file__).resolve().parents[3] / "shared")) / "cases"
cases = pytest.mark.skipif(not CASES.is_dir(), reason=f"no files in {CASES}; set MOTION_GYM_SHARED")
ROWS = walk_rows(people=4, frames=1200, every=5)
WHOLE = {"split": "0 0 1"}


def ade(path, **keywords):
    return motion_gym.evaluate("constant_velocity", domain("tracks", path=path, **{**WHOLE, **keywords})).ade


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """The score of the rows in the plainest form: every tenth frame of a metric file at 25 frames a second."""
    score = ade(write_rows(tmp_path_factory.mktemp("plain") / "walk.csv", ROWS), fps=25)
    assert score.agent_windows > 100 and score.mean > 0.01
    return score


FORMS = {
    "text ids": (lambda f, a, x, y: (f, f"ped {a}", x, y), {}),
    "swapped columns": (lambda f, a, x, y: (a, f, x, y), {"header": "id,frame,x,y"}),
    "feet": (lambda f, a, x, y: (f, a, x / 0.3048, y / 0.3048), {}),
    "milliseconds": (lambda f, a, x, y: (40 * f + 1_700_000_000_000, a, x, y), {"header": "timestamp_ms,id,x,y"}),
    "seconds": (lambda f, a, x, y: (f / 25, a, x, y), {"header": "time,id,x,y"}),
    "dates": (
        lambda f, a, x, y: (np.datetime64("2024-05-31T23:59:50") + np.timedelta64(40 * f, "ms"), a, x, y),
        {"header": "when,id,x,y"},
    ),
    "negative frames": (lambda f, a, x, y: (f - 5000, a, x, y), {}),
    "frames as 1.0": (lambda f, a, x, y: (float(f), float(a), x, y), {"separator": "\t", "header": None}),
    "exponents": (
        lambda f, a, x, y: (f"{f:.7e}", f"{a:.3e}", f"{x:.16e}", f"{y:.16e}"),
        {"separator": " ", "header": None},
    ),
    "huge ids": (lambda f, a, x, y: (f, 2**62 + a, x, y), {}),
    "ids beyond integers": (lambda f, a, x, y: (f, f"{2**64 + a}", x, y), {}),
    "further columns": (lambda f, a, x, y: (f, "walks", a, x, y, 0.0), {"header": "frame,label,ped_id,pos_x,pos_y,z"}),
    "carriage returns": (lambda *row: row, {"end": "\r"}),
    "utf-16": (lambda *row: row, {"encoding": "utf-16", "separator": ";"}),
    "utm": (lambda f, a, x, y: (f, a, x + 388_000, y + 3_948_000), {}),
}
KEYWORDS = {"feet": {"unit": "ft"}, "dates": {"columns": "when id x y"}}


@pytest.mark.parametrize("form", FORMS)
def test_one_score_in_every_form(tmp_path, expected, form):
    change, options = FORMS[form]
    path = write_rows(tmp_path / "walk.csv", [change(*row) for row in ROWS], **options)
    timed = {} if form in ("milliseconds", "seconds", "dates") else {"fps": 25}
    score = ade(path, **timed, **KEYWORDS.get(form, {}))
    assert (score.agent_windows, score.agents, score.scenes) == (
        expected.agent_windows,
        expected.agents,
        expected.scenes,
    )
    assert score.mean == pytest.approx(expected.mean, abs=2e-5)


def test_decimal_commas_shuffled_rows_gzip_and_no_last_newline(tmp_path, expected):
    rows = [[str(v).replace(".", ",") for v in row] for row in ROWS]
    np.random.default_rng(0).shuffle(rows)
    text = "frame;id;x;y\n" + "\n".join(";".join(row) for row in rows)
    (tmp_path / "walk.txt").write_bytes(gzip.compress(text.encode()))
    assert ade(tmp_path / "walk.txt", fps=25).mean == pytest.approx(expected.mean, abs=1e-6)


def test_every_unit(tmp_path, expected):
    for unit, metres in {"cm": 0.01, "mm": 0.001, "km": 1000, "in": 0.0254, "yd": 0.9144}.items():
        path = write_rows(tmp_path / unit, [(f, a, x / metres, y / metres) for f, a, x, y in ROWS])
        assert ade(path, fps=25, unit=unit).mean == pytest.approx(expected.mean, abs=2e-5)
    path = write_rows(tmp_path / "px", [(f, a, x * 40, y * 40) for f, a, x, y in ROWS])
    assert ade(path, fps=25, unit="px", scale=0.025).mean == pytest.approx(expected.mean, abs=2e-5)
    pixels = domain("tracks", path=path, fps=25, unit="px", **WHOLE)
    card = motion_gym.evaluate("constant_velocity", pixels)
    assert card.domain.unit == "px" and card.ade.mean == pytest.approx(40 * expected.mean, rel=1e-4)
    assert "px" in str(card) and "MR_2m" not in card.metrics


def test_ids_that_differ_only_in_zeros_are_not_taken_for_one_person(tmp_path):
    rows = [(20 * k, ("1", "01")[k >= 30], 0.5 * k, 0.0) for k in range(60)]
    path = write_rows(tmp_path / "zeros.csv", rows)
    with pytest.raises(DataError, match=r"line 2: column 1 `id`, the id, is '1' here and '01' elsewhere"):
        domain("tracks", path=path, fps=50).windows("test")
    padded = write_rows(tmp_path / "padded.csv", [(f, {"1": "001", "01": "002"}[a], x, y) for f, a, x, y in rows])
    assert domain("tracks", path=padded, fps=50, split="0 0 1").windows("test").observation.scenes == 22


def test_a_rate_that_does_not_divide_gives_nearly_the_same(tmp_path):
    fine = walk_rows(people=6, frames=6000, every=1, fps=100.0)
    exact = ade(write_rows(tmp_path / "a.csv", fine), fps=100).mean
    other = ade(write_rows(tmp_path / "b.csv", [row for row in fine if row[0] % 7 == 0]), fps=100).mean
    assert other == pytest.approx(exact, rel=0.05)


@cases
@pytest.mark.parametrize(
    ("name", "keywords", "windows", "mean"),
    [
        ("obsmat8.txt", {"dt": 0.4}, 126, 0.901),
        ("obsmat8.txt", {"fps": 15}, 126, 0.901),
        ("vel6.txt", {"dt": 0.4, "columns": "frame id x y vx vy"}, 126, 0.901),
        ("vel6.txt", {"dt": 0.4, "columns": (0, 1, 2, 3)}, 126, 0.901),
        ("stray.txt", {"dt": 0.4}, 105, 0.0),
        ("utm_s.txt", {"dt": 0.4}, 202, 0.0),
        ("still.txt", {"dt": 0.4}, 123, 0.0),
        ("walkers.txt", {"fps": 25}, 183, 0.0),
    ],
)
def test_cases_are_read_rightly(name, keywords, windows, mean):
    score = ade(CASES / name, **keywords)
    assert score.agent_windows == windows and score.mean == pytest.approx(mean, abs=6e-4)


@cases
def test_cases_that_hold_no_window_or_do_not_say_enough():
    with pytest.raises(
        DataError, match=r"no window: nobody is there for 20 consecutive steps .*longest unbroken track has 10"
    ):
        domain("tracks", path=CASES / "gap.txt", dt=0.4, **WHOLE).windows("test")
    with pytest.raises(DataError, match="6 columns and no header"):
        domain("tracks", path=CASES / "vel6.txt", dt=0.4).windows("test")
    with pytest.raises(DataError, match="Give fps"):
        domain("tracks", path=CASES / "walkers.txt").windows("test")


def test_a_gap_ends_a_window(tmp_path):
    frames = [*range(0, 300, 10), *range(1050, 1350, 10)]
    path = write_rows(tmp_path / "walk.csv", [(f, 1, 0.05 * f, 0.0) for f in frames])
    place = domain("tracks", path=path, fps=25, **WHOLE)
    assert len(place.windows("test").future) == 2 * 11
    assert motion_gym.evaluate("constant_velocity", place).ade.mean == pytest.approx(0, abs=1e-4)
    card = motion_gym.evaluate_online("constant_velocity", place)
    assert card.ade.mean == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([*ROWS[:40], ROWS[7]], r"line 42: `\d` is there a second time at \d+ \(line 9\); 1 such row in all"),
        ([*ROWS[:9], (50, "", 1, 1)], "line 11: column 1 `id`, the id, is empty"),
        ([*ROWS[:9], (50, 1, "inf", 1)], "line 11: the position is infinite"),
        ([*ROWS[:9], (50, 1, "1,5", 1)], "5 columns where the other lines have 4"),
        ([(f, a, "", "") for f, a, _, _ in ROWS], "none of them has a position"),
    ],
)
def test_bad_rows_are_named(tmp_path, rows, message):
    with pytest.raises(DataError, match=message):
        domain("tracks", path=write_rows(tmp_path / "walk.csv", rows), fps=25).windows("test")


def test_rows_without_a_position_are_left_out_and_counted(tmp_path):
    rows = [(f, a, *(("", "nan") if k % 50 == 7 else (x, y))) for k, (f, a, x, y) in enumerate(ROWS)]
    place = domain("tracks", path=write_rows(tmp_path / "walk.csv", rows), fps=25, **WHOLE)
    (file,) = place.track_files()
    assert file.dropped == sum(k % 50 == 7 for k in range(len(ROWS)))
    assert len(file.agent) + file.dropped == len(ROWS)


def test_swapped_columns_are_refused_where_guessed_and_read_where_stated(tmp_path, expected):
    swapped = write_rows(tmp_path / "walk.txt", [(a, f, x, y) for f, a, x, y in ROWS], " ", header=None)
    with pytest.raises(DataError, match=r"cannot be right: the longest track has .*columns='id frame x y'"):
        domain("tracks", path=swapped, fps=25, **WHOLE).windows("test")
    assert ade(swapped, fps=25, columns="id frame x y").mean == pytest.approx(expected.mean)
    stated = domain("tracks", path=swapped, fps=25, columns="0 1 2 3", **WHOLE)
    assert stated.track_files()[0].swapped


def test_one_person_a_file_becomes_one_recording_for_each_folder(tmp_path, expected):
    (tmp_path / "a").mkdir(), (tmp_path / "b").mkdir()
    for person in range(4):
        rows = [(f, x, y) for f, a, x, y in ROWS if a == person]
        write_rows(tmp_path / "a" / f"p{person}.csv", rows, header="frame,x,y")
        write_rows(tmp_path / "b" / f"p{person}.csv", rows, header="frame,x,y")
    score = ade(str(tmp_path / "a" / "p*.csv"), fps=25)
    assert (score.agent_windows, score.scenes) == (expected.agent_windows, expected.scenes)
    assert len(domain("tracks", path=str(tmp_path / "*" / "p?.csv"), fps=25).track_files()) == 2


def test_files_of_several_people_are_recordings_of_their_own(tmp_path, expected):
    for name in ("a.csv", "b.csv"):
        write_rows(tmp_path / name, ROWS)
    place = domain("tracks", path=str(tmp_path / "*.csv"), fps=25, **WHOLE)
    assert [r.name for r in place.recordings("test")] == ["a.csv", "b.csv"]
    assert len(place.windows("test").future) == 2 * expected.agent_windows
    with pytest.raises(DataError, match="no file of the pattern"):
        domain("tracks", path=str(tmp_path / "*.txt"))


def test_splits_are_parts_of_the_time_with_a_guard_between_them():
    place = domain("tracks", path=walks_file(), fps=25)
    parts = {split: place.recordings(split)[0] for split in ("train", "val", "test", "reference")}
    edges = [parts[s].frame[[0, -1]].tolist() for s in ("train", "val", "test")]
    assert edges[1][0] - edges[0][1] >= 20 and edges[2][0] - edges[1][1] >= 20
    steps = int(place.track_files()[0].recording.frame[-1]) + 1
    assert edges[0][1] == round(0.6 * steps) - 1 and edges[2][0] == round(0.8 * steps) + 20
    assert np.array_equal(parts["reference"].xy, parts["train"].xy)
    assert "test 80 to 100 % of the time, 20 steps left out between them" in place.card.source
    assert place.sources() == [place]
    short = domain("tracks", path=walks_file(), fps=25, step=2.0, split="0.5 0 0.5")
    assert short.recordings("val") == [] and short.dt == 2.0


def test_short_files_have_two_parts(tmp_path):
    place = domain("tracks", path=write_rows(tmp_path / "walk.csv", ROWS), fps=25)
    assert place.shares == (0.5, 0.0, 0.5) and "train 0 to 50 %" in place.card.source
    assert motion_gym.evaluate("linear", place).ade.agent_windows > 0


def test_sources_are_other_files(tmp_path):
    other = write_rows(tmp_path / "other.csv", walk_rows(people=5, frames=3000, every=5, seed=3))
    place = domain("tracks", path=walks_file(), fps=25, sources=str(other))
    assert place.shares == (0, 0, 1)
    (source,) = place.sources()
    assert source.path == str(other) and source.shares == (0.8, 0.2, 0)
    card = motion_gym.evaluate("linear", place)
    assert not card.leaks and card.ade.mean < motion_gym.evaluate("constant_velocity", place).ade.mean * 1.5


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"path": 2024}, r"quote it in a spec"),
        ({"path": ""}, "is not text"),
        ({"fps": 0}, "`fps=0` of domain `tracks` must be a number, 0.0001 or more"),
        ({"fps": 25, "dt": 0.4}, "say the same thing"),
        ({"unit": "feet"}, "`unit=feet` of domain `tracks` is not known"),
        ({"step": -1}, "`step=-1`"),
        ({"scale": "a"}, "`scale=a`"),
        ({"split": "0.6 0.6 0.2"}, "must be three shares"),
        ({"split": (1, 2)}, "must be three shares"),
        ({"sources": 3}, "must be the name of a file"),
        ({"sources": "none*.csv"}, "no file of the pattern"),
        ({"columns": 3}, "must be names or numbers"),
        ({"min_agents": 0}, "`min_agents=0`"),
        ({"colums": "a"}, "has no parameter `colums`. Did you mean `columns`"),
    ],
)
def test_keywords_that_are_not_allowed(keywords, message):
    with pytest.raises(MotionGymError, match=message):
        domain("tracks", **{"path": walks_file(), "fps": 25, **keywords})
    with pytest.raises(SpecError, match=r"needs path: `tracks:path=\.\.\.`"):
        domain("tracks")


@pytest.mark.parametrize(
    "name", ["a,b.csv", "2024", "über weg.csv", 'it\'s "here".csv', "(1).csv", "a=b:c.csv", "true"]
)
def test_paths_of_every_kind_work_in_a_spec(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    write_rows(tmp_path / name, ROWS)
    place = domain("tracks", path=name, fps=25)
    again = domain(spec_of(place))
    assert again.parameters == place.parameters
    assert np.array_equal(again.windows("test").future, place.windows("test").future)


@given(
    st.dictionaries(
        st.sampled_from(["path", "columns", "unit", "fps"]), st.text(max_size=30) | st.integers(), max_size=4
    )
)
@settings(deadline=None, max_examples=300)
@example({"path": "a,b.txt", "columns": "frame 'pos x' y"})
@example({"path": "\\", "unit": "'"})
@example({"path": " 1_000", "unit": "None"})
@example({"path": "a:b=c,d", "unit": "[1"})
@example({"path": "\n", "unit": ""})
def test_specs_read_back_what_was_written(parameters):
    assert parse_spec(format_spec("tracks", parameters)) == ("tracks", parameters)


def test_it_keeps_the_contract_of_a_domain_and_is_pickled():
    place = domain("tracks", path=walks_file(), fps=25)
    check_domain(place)
    twin = pickle.loads(pickle.dumps(place))
    assert twin.parameters == place.parameters and twin.world == place.world
    assert np.array_equal(twin.windows("test").future, windows_of(place.recordings("test")).future)
    assert list(place.card.files) == [walks_file()]


def test_it_is_an_environment():
    env = gymnasium.make("motion_gym/Tracks-v0", path=walks_file(), fps=25, columns="frame id x y")
    observation, _ = env.reset(seed=0)
    assert observation["mask"].any()


def test_missing_and_wrong_files_say_so(tmp_path):
    for path, message in ((tmp_path, "is a folder"), (tmp_path / "no.csv", "there is no file")):
        with pytest.raises(DataError, match=message):
            domain("tracks", path=path, fps=25).windows("test")


@given(st.data())
@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_keywords_on_a_file_give_windows_or_an_error_of_ours(tmp_path, data):
    draw = data.draw
    keywords = {
        "columns": draw(st.sampled_from([None, "frame id x y", "id frame x y", "0 1 2 3", "3 2 1 0", "x y id frame"])),
        "fps": draw(st.sampled_from([None, 1, 2.4, 25, 29.97, 1000])),
        "unit": draw(st.sampled_from(["m", "cm", "px"])),
        "step": draw(st.sampled_from([0.1, 0.4, 1.0])),
        "gap": draw(st.sampled_from([None, 0, 0.3, 5.0])),
    }
    path = write_rows(tmp_path / "walk.csv", ROWS[: draw(st.sampled_from([1, 3, 60, 700]))])
    try:
        truth = domain("tracks", path=path, **WHOLE, **keywords).windows("test")
    except (DataError, SpecError):
        return
    assert np.isfinite(truth.future).all() and len(truth.future)
