from __future__ import annotations

import gzip
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motion_gym.contract import DataError, Recording, SpecError
from motion_gym.data.recordings import check_recording, read_recording

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("MOTION_GYM_SHARED", ROOT.parent / "shared"))
REAL = SHARED / "data" / "eth_ucy"
TRAINING = ("biwi_hotel", "crowds_zara01", "crowds_zara02", "crowds_zara03", "students001", "students003")
ROWS = {
    "biwi_eth": 5492,
    "biwi_hotel": 6543,
    "crowds_zara01": 5153,
    "students003": 17953,
    "uni_examples": 2747,
}
real = pytest.mark.skipif(not REAL.is_dir(), reason=f"no real data in {REAL}; set MOTION_GYM_SHARED")
here = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=100)

GOOD = ["0 1 0.5 1.5", "0 2 1.5 2.5", "10 1 0.6 1.6", "10 2 1.6 2.6", "20 1 0.7 1.7"]


def write(folder: Path, lines: list[str], end: str = "\n") -> Path:
    path = folder / "place.txt"
    path.write_text("".join(line + end for line in lines), encoding="utf-8", newline="")
    return path


def columns_of(recording: Recording) -> list[tuple[float, ...]]:
    return [
        (int(f), int(a), float(x), float(y))
        for f, a, (x, y) in zip(recording.frame, recording.agent, recording.xy, strict=True)
    ]


finite = st.floats(-60_000, 60_000)  # nearer to each other than a recording may be wide
tables = st.dictionaries(
    st.tuples(st.integers(0, 50), st.integers(-5, 2**53 - 1)),
    st.tuples(finite, finite),
    min_size=1,
    max_size=12,
)


@given(tables, st.sampled_from(["\t", " ", "   ", ",", ", "]), st.sampled_from(["\n", "\r\n"]), st.randoms())
@here
def test_what_is_written_is_read(tmp_path, table, separator, end, random) -> None:
    rows = [(*key, *value) for key, value in table.items()]
    random.shuffle(rows)
    rows.sort(key=lambda row: row[0])  # frames rise, agents within a frame are in any order
    path = write(tmp_path, [separator.join(map(repr, row)) for row in rows], end)
    recording = read_recording(path, dt=0.1)
    assert columns_of(recording) == sorted(rows)
    assert (recording.frame.dtype, recording.agent.dtype, recording.xy.dtype) == (
        np.int64,
        np.int64,
        np.float64,
    )
    assert (recording.dt, recording.name) == (0.1, "place")
    check_recording(recording)


def corrupt(fields: list[str], kind: str) -> list[str]:
    frame, agent, x, y = fields
    return {
        "text": [frame, agent, "abc", y],
        "decimal comma": [frame, agent, x, "1,5"],
        "nan": [frame, agent, "nan", y],
        "infinity": [frame, agent, x, "-inf"],
        "few columns": [frame, agent, x],
        "many columns": [*fields, "1"],
        "frame": [frame + ".5", agent, x, y],
        "id": [frame, "1e300", x, y],
    }[kind]


KINDS = ("text", "decimal comma", "nan", "infinity", "few columns", "many columns", "frame", "id")


@given(st.integers(3, 40), st.data(), st.sampled_from(KINDS))
@here
def test_a_bad_line_is_named(tmp_path, steps, data, kind) -> None:
    lines = [f"{10 * step} 1 {step / 7} 2.5" for step in range(steps)]
    bad = data.draw(st.integers(0, steps - 1))
    lines[bad] = " ".join(corrupt(lines[bad].split(), kind))
    blank = data.draw(st.integers(0, bad))
    lines.insert(blank, "")  # blank lines are skipped, but counted
    path = write(tmp_path, lines)
    with pytest.raises(DataError) as caught:
        read_recording(path)
    assert str(caught.value).startswith(f"{path}, line {bad + 2}: ")
    assert repr(lines[bad + 1]) in str(caught.value)


@given(st.data())
@here
def test_the_first_of_two_bad_lines_is_named(tmp_path, data) -> None:
    lines = [f"{10 * step} 1 {step / 7} 2.5" for step in range(20)]
    bad = data.draw(st.lists(st.integers(0, 19), min_size=2, max_size=2, unique=True))
    for index in bad:
        lines[index] = " ".join(corrupt(lines[index].split(), data.draw(st.sampled_from(KINDS))))
    with pytest.raises(DataError, match=f"line {min(bad) + 1}: "):
        read_recording(write(tmp_path, lines))


@given(st.data())
@here
def test_a_truncated_file_is_refused(tmp_path, data) -> None:
    whole = "".join(f"{line}\n" for line in GOOD)
    cut = data.draw(st.integers(1, len(whole) - 1).filter(lambda cut: whole[cut - 1] != "\n"))
    path = write(tmp_path, [whole[:cut]], end="")
    with pytest.raises(DataError, match=rf"line {whole[:cut].count(chr(10)) + 1}: "):
        read_recording(path)


@pytest.mark.parametrize("cut", [None, -1, -4])
def test_a_last_line_without_newline_says_truncated(tmp_path: Path, cut: int | None) -> None:
    path = write(tmp_path, ["\n".join(GOOD)[:cut]], end="")
    with pytest.raises(DataError, match=r"line 5: the file ends in the middle .* truncated: .* newline"):
        read_recording(path)


def test_duplicate_names_both_lines(tmp_path: Path) -> None:
    lines = [*GOOD[:2], "", *GOOD[2:4], "10 1 9 9", GOOD[4]]
    with pytest.raises(DataError, match=r"line 6: frame 10 has agent 1 a second time \(line 4\): '10 1 9 9'"):
        read_recording(write(tmp_path, lines))


@pytest.mark.parametrize("separator", [" ", "\t", ","])
def test_unsorted_frames_name_the_line_and_the_remedy_works(tmp_path: Path, separator: str) -> None:
    swapped = ["1.0e+02 3 8 8", *GOOD, "5.0e0 1 9 9"]
    path = write(tmp_path, [line.replace(" ", separator) for line in swapped])
    with pytest.raises(DataError, match=r"line 2: frame 0 comes after frame 100 \(line 1\).*`LC_ALL=C sort") as caught:
        read_recording(path)
    command = str(caught.value).split("`")[1]
    subprocess.run(["sh", "-c", command], cwd=tmp_path, check=True)
    rows = sorted(tuple(map(float, line.split())) for line in swapped)
    assert columns_of(read_recording(tmp_path / "sorted.txt")) == rows


def test_sort_remedy_follows_the_columns(tmp_path: Path) -> None:
    path = write(tmp_path, ["1.5 0.5 7 20", "1.6 0.6 7 10"])
    with pytest.raises(DataError, match=r"sort -k4,4g -k3,3g place\.txt"):
        read_recording(path, columns=(3, 2, 0, 1))


@pytest.mark.parametrize("content", ["", "\n \n"])
def test_empty_file(tmp_path: Path, content: str) -> None:
    with pytest.raises(DataError, match=r"place\.txt is empty\. Expected lines of numbers"):
        read_recording(write(tmp_path, [content], end=""))


def test_decimal_comma_in_the_first_line(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"line 1: column 2 \(counted from 0\) is '0,5', not a number.*decimal point"):
        read_recording(write(tmp_path, ["0 1 0,5 1.5", *GOOD[1:]]))


def test_header_line(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"line 1: .*Delete the header line"):
        read_recording(write(tmp_path, ["frame,id,x,y", "0,1,2,3"]))


def test_binary_file(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(bytes(range(256)) * 8)
    with pytest.raises(DataError, match=r"a\.npz, line 1: "):
        read_recording(tmp_path / "a.npz")


def test_byte_order_mark_is_skipped(tmp_path: Path) -> None:
    assert len(read_recording(write(tmp_path, ["\ufeff" + GOOD[0], *GOOD[1:]])).frame) == 5


def test_no_such_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="there is no file"):
        read_recording(tmp_path / "none.txt")
    with pytest.raises(DataError, match=rf"^{tmp_path} is a folder"):
        read_recording(tmp_path)


def test_too_few_columns_for_the_choice(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"line 1: 4 columns, but columns=\(0, 1, 2, 4\) needs 5"):
        read_recording(write(tmp_path, GOOD), columns=(0, 1, 2, 4))


@pytest.mark.parametrize("columns", [(0, 1, 2), (0, 1, 2, 2), (0, 1, 2, -1)])
def test_columns_that_are_not_four(tmp_path: Path, columns: tuple[int, ...]) -> None:
    with pytest.raises(SpecError, match="four different column numbers"):
        read_recording(write(tmp_path, GOOD), columns=columns)


@pytest.mark.parametrize("dt", [0, -0.4, float("nan"), float("inf")])
def test_dt_must_be_positive(tmp_path: Path, dt: float) -> None:
    with pytest.raises(SpecError, match="dt="):
        read_recording(write(tmp_path, GOOD), dt=dt)


def built(**changes: object) -> Recording:
    columns: dict[str, object] = {
        "frame": np.array([0, 0, 10, 10]),
        "agent": np.array([1, 2, 1, 2]),
        "xy": np.arange(8.0).reshape(4, 2),
        "dt": 0.4,
        "name": "mine",
    }
    return Recording(**{**columns, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"xy": np.array([[0, 0], [0, 0], [0, np.nan], [0, 0]])}, "mine, row 2: y is nan"),
        ({"xy": np.zeros((4, 3))}, r"shapes \(4,\), \(4,\) and \(4, 3\)"),
        ({"agent": np.array([1, 2, 1])}, r"shapes \(4,\), \(3,\) and \(4, 2\)"),
        ({"agent": np.array([1.0, 2.5, 1, 2])}, r"mine, row 1: agent is 2\.5, not a whole number below 2\*\*53"),
        ({"agent": np.array([1.0, 2, np.nan, 2])}, r"mine, row 2: agent is nan"),
        ({"frame": np.array([0, 0, 1, 2**63], np.uint64)}, r"row 3: frame is 9223372036854775808, .* below 2\*\*63"),
        ({"frame": ["a", "b", "c", "d"]}, "frame holds <U1; convert it to numbers"),
        (
            {"xy": np.array([[0, 0], [0, 0], [0, 2e5], [0, 0]])},
            r"row 2: the position \[0.0, 200000.0\] is more than 131,",
        ),
        ({"xy": np.full((4, 2), 4e6), "origin": np.zeros(2)}, "row 0: .* leave `origin` out"),
        ({"origin": np.zeros(3)}, "give two finite numbers"),
        (
            {"frame": np.array([10, 10, 0, 0])},
            r"row 2: frame 0 comes after frame 10 \(row 1\)\. Sort all columns",
        ),
        ({"agent": np.array([1, 2, 2, 1])}, r"row 3: agent 1 comes after agent 2 .*\(row 2\)\. Sort all"),
        ({"agent": np.array([1, 1, 1, 2])}, r"row 1: frame 0 has agent 1 a second time \(row 0\)"),
        ({"frame": np.zeros(0, int), "agent": np.zeros(0, int), "xy": np.zeros((0, 2))}, "no rows"),
        ({"dt": 0.0}, "dt=0.0"),
    ],
)
def test_recordings_built_in_memory_are_checked(changes: dict[str, object], message: str) -> None:
    check_recording(built())
    with pytest.raises((DataError, SpecError), match=message):
        check_recording(built(**changes))


@pytest.mark.parametrize("kind", ["int8", "uint8", "int32", "uint64", "float32", "float64", "list"])
def test_columns_of_any_number_type_are_converted(kind: str) -> None:
    def column(values: list[int]) -> object:
        return values if kind == "list" else np.array(values, kind)

    recording = built(frame=column([0, 0, 10, 10]), agent=column([1, 2, 1, 2]), xy=column([[0, 1]] * 4))
    check_recording(recording)
    assert recording.frame.dtype == recording.agent.dtype == np.int64
    assert recording.xy.dtype == np.float64
    assert columns_of(recording) == [(0, 1, 0, 1), (0, 2, 0, 1), (10, 1, 0, 1), (10, 2, 0, 1)]


@given(st.floats(-1e7, 1e7), st.floats(-1e7, 1e7))
def test_the_origin_is_the_first_row_rounded_and_a_cut_keeps_it(x: float, y: float) -> None:
    whole = built(xy=np.array([x, y]) + np.arange(8.0).reshape(4, 2) * 900)
    assert (whole.origin % 1000 == 0).all() and np.abs(whole.xy[0] - whole.origin).max() <= 500
    cut = replace(whole, frame=whole.frame[2:], agent=whole.agent[2:], xy=whole.xy[2:])
    assert cut.origin.tolist() == whole.origin.tolist()


@real
@pytest.mark.parametrize(("name", "rows"), ROWS.items())
def test_real_files_are_read_whole(name: str, rows: int) -> None:
    recording = read_recording(REAL / f"{name}.txt")
    table = np.array((REAL / f"{name}.txt").read_text().split(), dtype=float).reshape(-1, 4)
    assert len(recording.frame) == rows and recording.origin.tolist() == [0, 0]
    assert columns_of(recording) == sorted(map(tuple, table))
    check_recording(recording)


@real
def test_the_original_annotation_of_eth_is_read_by_columns() -> None:
    recording = read_recording(REAL / "biwi_eth_obsmat_6frame.txt", columns=(0, 1, 2, 4))
    check_recording(recording)
    assert len(recording.frame) == 8908
    assert recording.xy[0] == pytest.approx([8.4568443, 3.5880664])


@pytest.mark.parametrize("name", ["a.gz", "a.bz2", "a.xz"])
def test_compression_is_that_of_the_content_whatever_the_name(tmp_path: Path, name: str) -> None:
    text = "".join(f"{line}\n" for line in GOOD).encode()
    for content in (text, gzip.compress(text)):
        (tmp_path / name).write_bytes(content)
        assert len(read_recording(tmp_path / name).frame) == 5
    (tmp_path / name).write_bytes(gzip.compress(text * 99)[:-20])
    with pytest.raises(DataError, match="damaged or incomplete"):
        read_recording(tmp_path / name)


@pytest.mark.parametrize("more", ["0.5", "0.5 0.1 0.2 9"])
def test_columns_are_named_where_there_are_not_four(tmp_path: Path, more: str) -> None:
    path = write(tmp_path, [f"{line} {more}" for line in GOOD])
    with pytest.raises(
        DataError, match=r"line 1: \d columns, and `columns` does not say which.*columns=\(0, 1, 2, 3\)"
    ):
        read_recording(path)
    assert len(read_recording(path, columns=(0, 1, 2, 3)).frame) == 5
