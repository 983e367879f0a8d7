from __future__ import annotations

import bz2
import gzip
import importlib.util
import json
import lzma
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from motion_gym.contract import DataError, SpecError
from motion_gym.data.tracks.table_files import read_table

here = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60)
ROWS = [(0, "ped 3", 1.5, -2.25), (0, "ped 7", 0.125, 3.0), (10, "ped 3", 1.75, -2.5)]


def saved(folder: Path, text: str, encoding: str = "utf-8", name: str = "walk.csv") -> Path:
    (folder / name).write_bytes(text.encode(encoding))
    return folder / name


def text_of(separator: str, header: bool = True, comma: bool = False, end: str = "\n") -> str:
    rows = [[str(field).replace(".", ",") if comma else str(field) for field in row] for row in ROWS]
    if separator == " ":
        rows = [[f'"{field}"' if " " in field else field for field in row] for row in rows]
    lines = [separator.join(row) for row in rows]
    return "".join(line + end for line in ([separator.join(("frame", "id", "x", "y"))] if header else []) + lines)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32", "latin-1"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(("separator", "comma"), [(",", False), (";", True), (";", False), ("\t", True), (" ", True)])
def test_the_same_table_in_every_form(tmp_path, encoding, end, separator, comma):
    table = read_table(saved(tmp_path, text_of(separator, comma=comma, end=end), encoding))
    assert table.names == ("frame", "id", "x", "y")
    assert table.whole_numbers(0).tolist() == [0, 0, 10]
    assert list(table.texts(1)) == ["ped 3", "ped 7", "ped 3"]
    assert table.numbers(2).tolist() == [1.5, 0.125, 1.75] and table.numbers(3).tolist() == [-2.25, 3.0, -2.5]
    assert table.lines.tolist() == [2, 3, 4] and table.complete


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress])
@pytest.mark.parametrize("name", ["walk.csv", "walk.csv.gz", "walk.bz2"])
def test_compression_is_found_by_content(tmp_path, pack, name):
    (tmp_path / name).write_bytes(pack(text_of(",").encode()))
    assert len(read_table(tmp_path / name)) == 3
    plain = saved(tmp_path, text_of(","), name=name)
    assert read_table(plain).compression == ""


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress])
def test_a_truncated_archive_is_refused(tmp_path, pack):
    content = pack(text_of(",").encode() * 50)
    for cut in (len(content) // 2, len(content) - 5):
        (tmp_path / "walk").write_bytes(content[:cut])
        with pytest.raises(DataError, match="damaged or incomplete"):
            read_table(tmp_path / "walk")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\n \n\t\n", "is empty"),
        (b"# only\n# comments\n", "is empty but for comments"),
        (bytes(range(256)) * 8, "is binary"),
        (b"PK\x03\x04\x00\x00rest", "zip archive: unpack it"),
        ("1,2,3,4\n".encode("utf-16-le"), "UTF-16 text, save it with a byte order mark"),
        (b"\xff\xfe1\x00,", "begins as utf-16 and is damaged"),
        (b"1\n2\n3\n", "is not a table of numbers"),
        (b"1,2\n2,3\n", "is not a table of numbers"),
        (b"a text that says something\nand a second line\n", "is not a table of numbers"),
        (b"frame,id,x,y\n", r"walk has a header, 'frame,id,x,y', and no rows\. Expected a row for each person"),
        (b"# of a camera\n\nframe\tid\tpos_x [m]\tpos_y [m]", "has a header, .*, and no rows"),
        (b"a text of one line\n", "is not a table of numbers"),
        (b"frame,id,x\n0,1,2,3,4\n5,1,2,3,4\n", "line 1: the header has 3 columns and the rows have 5"),
    ],
)
def test_what_is_no_table(tmp_path, content, message):
    (tmp_path / "walk").write_bytes(content)
    with pytest.raises(DataError, match=message):
        read_table(tmp_path / "walk")


def test_missing_files_folders_and_other_types(tmp_path):
    with pytest.raises(DataError, match=r"there is no file .*none\.csv\. Check the name and the folder\."):
        read_table(tmp_path / "none.csv")
    saved(tmp_path, "")
    with pytest.raises(DataError, match=r"there is no file .*wlak\.csv\. Did you mean `.*walk\.csv`\?$"):
        read_table(tmp_path / "wlak.csv")
    with pytest.raises(DataError, match=r"there is no file .*Check the name and the folder\."):
        read_table(tmp_path / "folder" / "walk.csv")
    with pytest.raises(DataError, match=r"is a folder\. Give a file, or a pattern"):
        read_table(tmp_path)
    with pytest.raises(DataError, match=r"cannot be read|there is no file"):  # by the version of Python
        read_table(str(tmp_path / "a\0b"))
    with pytest.raises(SpecError, match="quote it in a spec"):
        read_table(2024)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("20 1 2", r"line 4: 3 columns where the other lines have 4: '20 1 2'"),
        ("20 1 2 3 4", r"line 4: 5 columns where the other lines have 4"),
    ],
)
def test_a_line_of_another_width_is_named(tmp_path, line, message):
    with pytest.raises(DataError, match=message):
        read_table(saved(tmp_path, f"0 1 0 0\n\n10 1 1 0\n{line}\n30 1 3 0\n40 1 4 0\n"))


def test_a_truncated_last_line_is_named_and_a_complete_one_is_read(tmp_path):
    whole = "".join(f"{10 * k} 1 {k}.5 0.25\n" for k in range(5))
    with pytest.raises(DataError, match=r"line 5: the file ends in the middle of this line, after 3 of 4 .*truncated"):
        read_table(saved(tmp_path, whole[:-6]))
    table = read_table(saved(tmp_path, whole[:-1]))
    assert len(table) == 5 and not table.complete


@pytest.mark.parametrize("row", [4, 39, 1500])
@pytest.mark.parametrize("separator", [",", ";", " "])
@pytest.mark.parametrize("field", ['"ok', '"o\nk"'])
def test_a_quoted_field_that_does_not_end_in_its_line_is_named(tmp_path, row, separator, field):
    lines = [separator.join((str(k), "1", f"{k}.5", "0.25", "ok")) for k in range(max(row + 1, 40))]
    lines[row] = lines[row].replace("ok", field)
    with pytest.raises(DataError, match=rf"line {row + 3}: a quoted field does not end in this line: '{row}"):
        read_table(saved(tmp_path, "# walk\n\n" + "\n".join(lines) + "\n"))


def test_comments_blank_lines_and_a_commented_header(tmp_path):
    text = "# recorded at 16 fps\n# ID Frame X Y Z\n\n1 0 0.5 1.5 1.7\n# a note\n1 1 0.6 1.5 1.7\n"
    table = read_table(saved(tmp_path, text))
    assert table.names == ("ID", "Frame", "X", "Y", "Z") and table.lines.tolist() == [4, 6]
    assert "recorded at 16 fps" in table.comments


def test_a_comment_that_is_no_header(tmp_path):
    assert read_table(saved(tmp_path, "# three small words\n0 1 0.5 1.5\n1 1 0.6 1.5\n")).names is None


def test_row_names_and_a_last_delimiter_are_no_columns(tmp_path):
    table = read_table(saved(tmp_path, '"frame" "id" "x" "y"\n"1" 0 1 0.5 1.5\n"2" 1 1 0.6 1.5\n'))
    assert table.names == ("", "frame", "id", "x", "y")
    assert len(read_table(saved(tmp_path, "0,1,0.5,1.5,\n1,1,0.6,1.5,\n")).columns) == 4
    assert read_table(saved(tmp_path, "f,id,x,y,\n0,a,0.5,1.5,\n1,a,0.6,1.5,\n")).names == ("f", "id", "x", "y")


@pytest.mark.parametrize("field", ["", "nan", "NaN", "NA", "null", "None", "?", "-"])
def test_missing_values(tmp_path, field):
    table = read_table(saved(tmp_path, f"frame,id,x,y\n0,1,{field},2\n1,1,0.5,2\n2,1,1.5,2\n"))
    assert np.isnan(table.numbers(2)).tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("field", "delimiter"), [("abc", ","), ("1_000", ","), ("٣", ","), ("1,5", ";"), ("1.000,5", ";")]
)
def test_what_is_no_number_is_named(tmp_path, field, delimiter):
    lines = [f"{k},1,{k}.5,0".replace(",", delimiter) for k in range(20)]
    lines[7] = delimiter.join(("7", "1", field, "0"))
    table = read_table(saved(tmp_path, "\n".join(lines) + "\n"))
    with pytest.raises(DataError, match=r"line 8: column 2 is '.*', not a number"):
        table.numbers(2)


@pytest.mark.parametrize(
    ("fields", "whole"),
    [
        (["1.0", "2.0"], [1, 2]),
        (["1e3", "2"], [1000, 2]),
        (["-5", "+7"], [-5, 7]),
        (["9223372036854775807", "1"], [2**63 - 1, 1]),
        (["9223372036854775808", "1"], None),
        (["9007199254740993.0", "1"], None),
        (["1.5", "2"], None),
        (["", "2"], None),
        (["a", "2"], None),
    ],
)
def test_whole_numbers_are_exact_or_none(tmp_path, fields, whole):
    table = read_table(saved(tmp_path, "".join(f"{k},{field},0.5,1\n" for k, field in enumerate(fields))))
    found = table.whole_numbers(1)
    assert whole is None if found is None else found.tolist() == whole


numbers = st.floats(-1e9, 1e9).map(lambda value: value + 0.0)


@given(
    st.lists(st.tuples(st.integers(-1000, 1000), st.integers(0, 2**62), numbers, numbers), min_size=1, max_size=20),
    st.sampled_from(["\t", " ", "   ", ",", ", ", ";"]),
    st.sampled_from(["\n", "\r\n", "\n\n"]),
    st.sampled_from(["utf-8", "utf-16", "utf-8-sig"]),
)
@here
@example([(0, 1, 0.5, -0.5)], ",", "\n", "utf-8")
def test_what_is_written_is_read(tmp_path, rows, separator, end, encoding):
    text = "".join(separator.join(map(repr, row)) + end for row in rows)
    table = read_table(saved(tmp_path, text, encoding))
    columns = [table.whole_numbers(0), table.whole_numbers(1), table.numbers(2), table.numbers(3)]
    assert [tuple(column[row] for column in columns) for row in range(len(rows))] == rows


@given(st.text(max_size=300) | st.binary(max_size=300))
@here
@example('0,1,2,3\n"unclosed,1,2,3\n')
@example("{}\n")
@example('{"track": 3}\n')
def test_any_content_is_read_or_refused_by_name(tmp_path, content):
    path = tmp_path / "any"
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))
    try:
        table = read_table(path)
    except DataError as error:
        assert str(error).startswith(str(path))
    else:
        assert len(table.columns) >= 3 and all(len(column) == len(table) for column in table.columns)


def test_trajnet_rows_of_ground_truth(tmp_path):
    entries = [{"scene": {"id": 0, "p": 1, "s": 0, "e": 20, "fps": 2.5}}]
    entries += [{"track": {"f": 10 * k, "p": 1, "x": k / 4, "y": 1.0}} for k in range(3)]
    entries += [{"track": {"f": 30, "p": 1, "x": 9.0, "y": 9.0, "prediction_number": 0, "scene_id": 0}}]
    table = read_table(saved(tmp_path, "".join(json.dumps(entry) + "\n" for entry in entries), name="a.ndjson"))
    assert table.whole_numbers(0).tolist() == [0, 10, 20] and table.fps == 2.5 and table.lines.tolist() == [2, 3, 4]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"track": {"f": 0, "p": 1, "x": 0.5}}\n', "line 1: KeyError"),
        ('{"track": {"f": 0, "p": 1, "x": 0.5, "y": 1}\n', "line 1: .*Expected TrajNet"),
        ('{"scene": {"id": 0, "p": 1, "s": 0, "e": 20, "fps": 2.5}}\n', "no rows"),
    ],
)
def test_ndjson_that_is_no_trajnet_file(tmp_path, text, message):
    with pytest.raises(DataError, match=message):
        read_table(saved(tmp_path, text))


def test_parquet_is_read_or_says_what_it_needs(tmp_path):
    if importlib.util.find_spec("pyarrow") is None:
        (tmp_path / "walk.parquet").write_bytes(b"PAR1" + bytes(20) + b"PAR1")
        with pytest.raises(DataError, match=r"needs pyarrow: pip install 'motion-gym\[parquet\]'"):
            read_table(tmp_path / "walk.parquet")
        return
    import pyarrow
    from pyarrow import parquet

    columns = {"frame": [0, 10, 20], "id": ["a", "a", "b"], "x": [0.5, None, 1.5], "y": [1.0, 2.0, 3.0]}
    parquet.write_table(pyarrow.table(columns), tmp_path / "walk.parquet")
    table = read_table(tmp_path / "walk.parquet")
    assert table.names == tuple(columns) and table.whole_numbers(0).tolist() == [0, 10, 20]
    assert list(table.texts(1)) == ["a", "a", "b"] and np.isnan(table.numbers(2)).tolist() == [False, True, False]
    (tmp_path / "walk.parquet").write_bytes(b"PAR1 broken")
    with pytest.raises(DataError, match="Parquet file that cannot be read"):
        read_table(tmp_path / "walk.parquet")
