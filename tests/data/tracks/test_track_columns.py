from __future__ import annotations

import numpy as np
import pytest

from motion_gym.contract import DataError, MotionGymError, SpecError
from motion_gym.data.tracks.swapped_columns import swap_evidence
from motion_gym.data.tracks.table_files import read_table
from motion_gym.data.tracks.track_columns import find_columns, parse_columns, plain_name, role_of


def table_of(tmp_path, text):
    (tmp_path / "walk.csv").write_text(text)
    return read_table(tmp_path / "walk.csv")


def places(columns):
    return columns.time, columns.agent, columns.x, columns.y


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("frame,id,x,y", (0, 1, 2, 3)),
        ("id,frame,label,x_est,y_est,vx_est,vy_est", (1, 0, 3, 4)),
        ("recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,xVelocity,yVelocity", (2, 1, 4, 5)),
        ("track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width", (2, 0, 4, 5)),
        ("Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y", (1, 0, 4, 5)),
        ("PersID,Frame,X/m,Y/m,Z/m", (1, 0, 2, 3)),
        ("Time [s],Pedestrian ID,pos_x [cm],pos_y [cm]", (0, 1, 2, 3)),
        (",frame,ped,y,x", (1, 2, 4, 3)),
        ("x,y,frame,id,x_px,y_px", (2, 3, 0, 1)),
        ("easting,northing,t,name", (2, 3, 0, 1)),
        ("FRAME;ID;X;Y", (0, 1, 2, 3)),
    ],
)
def test_headers_of_known_forms(tmp_path, header, expected):
    separator = ";" if ";" in header else ","
    width = len(header.split(separator))
    rows = [separator.join(str(10 * row + column) for column in range(width)) for row in range(3)]
    columns = find_columns(table_of(tmp_path, "\n".join([header, *rows]) + "\n"), None)
    assert places(columns) == expected and not columns.stated


def test_a_frame_number_is_preferred_where_its_rate_is_given(tmp_path):
    table = table_of(tmp_path, "frame,time,id,x,y\n0,0.0,1,1,1\n1,0.04,1,1,2\n")
    assert find_columns(table, None).time == 1
    assert find_columns(table, None, timed=True).time == 0


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("frame,id,u,v", r"no name plainly says x and y. The header is: frame, id, u, v. Say which"),
        ("when,id,x,y", "no name plainly says frame or time"),
        ("frame,who,x,y", "no name plainly says id"),
        ("frame,id,lat,lon", "Longitude and latitude are degrees"),
        ("frame,ped_id,track_id,x,y", "several columns that may be the id: `ped_id`, `track_id`"),
        ("frame,id,x_world,y_world,x_est,y_est", "several columns that may be the x"),
    ],
)
def test_headers_that_do_not_say(tmp_path, header, message):
    width = header.count(",") + 1
    rows = [",".join(["0", *(str(10 * row + column) for column in range(1, width))]) for row in range(3)]
    with pytest.raises(DataError, match=message):
        find_columns(table_of(tmp_path, "\n".join([header, *rows]) + "\n"), None)


def test_a_column_that_may_be_the_id_is_named(tmp_path):
    for field in ("u-{}", "{}"):
        rows = [f"{k / 10},{field.format(k % 3)},{k}.5,1.25" for k in range(30)]
        table = table_of(tmp_path, "\n".join(["timestamp,uuid,x,y", *rows]) + "\n")
        with pytest.raises(
            DataError, match=r"no name plainly says id, and `uuid` may be it: .* columns='FRAME X Y' if"
        ):
            find_columns(table, None)
        assert places(find_columns(table, parse_columns("timestamp uuid x y"))) == (0, 1, 2, 3)
        assert places(find_columns(table, parse_columns("timestamp x y"))) == (0, None, 2, 3)
    one = table_of(
        tmp_path,
        "row,time,label,speed,lost,x,y\n" + "".join(f"{k},{k}.5,ped,{k % 3}.25,{k % 2},{k}.5,1.5\n" for k in range(9)),
    )
    assert places(find_columns(one, None)) == (1, None, 5, 6)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("frame,id,x,y,w,h", "header of boxes: x, y, w and h.*Write a file with the centre"),
        ("frame,id,x,y,width,height", "header of boxes: x, y, width and height"),
        ("frame,id,xmin,ymin,xmax,ymax", "no name plainly says x and y.*If they are boxes, write the centre"),
    ],
)
def test_boxes_are_refused_with_what_to_do(tmp_path, header, message):
    rows = ["1,2,3,4,5,6", "2,2,3,4,5,6", "3,2,3,4,5,6"]
    table = table_of(tmp_path, "\n".join([header, *rows]) + "\n")
    with pytest.raises(DataError, match=message):
        find_columns(table, None)
    assert places(find_columns(table, (0, 1, 2, 3))) == (0, 1, 2, 3)


def test_names_of_other_scripts_match_exactly(tmp_path):
    table = table_of(tmp_path, "frame,ταυ,ψ,x,y\n1,2,3,4,5\n2,2,3,4,5\n")
    assert places(find_columns(table, parse_columns("frame ψ x y"))) == (0, 2, 3, 4)
    other = table_of(tmp_path, "frame,ταυ,x,y\n1,2,4,5\n2,2,4,5\n")
    with pytest.raises(SpecError, match="has no column `ψ`"):
        find_columns(other, parse_columns("frame ψ x y"))


FOUR = "id,frame,x,y,speed\n1,0,2,3,9\n1,1,2,4,9\n"


@pytest.mark.parametrize("columns", ["frame id x y", "id frame x y", "1 0 2 3", (1, "id", "X", "y"), ["0", 1, 2, 3]])
def test_named_columns_are_put_by_their_role(tmp_path, columns):
    found = find_columns(table_of(tmp_path, FOUR), parse_columns(columns))
    assert places(found) == (1, 0, 2, 3) and found.stated


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("id frame x speed", "`id` stands at the place of the frame or time, and its name says id"),
        ("frame x id y", None),
        ("frame id x z", "has no column `z`"),
        ("frame id x", "`id` stands at the place of x"),
        ("frame id x x", "a column of .* twice"),
        ("frame id x y speed", "names 5 columns"),
        ("frame id x 7", "has 5 columns, 0 to 4, and `columns` names 7"),
    ],
)
def test_columns_that_do_not_fit_a_header(tmp_path, columns, message):
    table = table_of(tmp_path, FOUR)
    if message is None:  # each name says its role: they are put in order
        assert places(find_columns(table, parse_columns(columns))) == (1, 0, 2, 3)
        return
    with pytest.raises(SpecError, match=message):
        find_columns(table, parse_columns(columns))


@pytest.mark.parametrize("columns", [3, None, "", (), [1.5, 2, 3], "a 'b", (True, 1, 2, 3)])
def test_columns_of_other_types(columns):
    with pytest.raises(SpecError, match="must be names or numbers"):
        parse_columns(columns)


SIX = "0 1 0.5 1.5 9 8\n10 1 0.6 1.5 9 8\n"


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ("frame id x y vx vy", (0, 1, 2, 3)),
        ("id frame x y - -", (1, 0, 2, 3)),
        ("frame - x - y -", (0, None, 2, 4)),
        ((0, 1, 2, 4), (0, 1, 2, 4)),
        ("0 2 3", (0, None, 2, 3)),
        ("time id x y - -", (0, 1, 2, 3)),
    ],
)
def test_a_layout_of_a_file_without_header(tmp_path, columns, expected):
    assert places(find_columns(table_of(tmp_path, SIX), parse_columns(columns))) == expected


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (None, r"has 6 columns and no header.*columns='frame id x y - -'"),
        ("frame id x y", "names 4 columns, and .* has 6 and no header"),
        ("frame id x z vx vy", "has no y"),
        ("fram id x y vx vy", "has no frame or time"),
        ("frame id x x y -", "names two columns x"),
        ((0, 1, 2, 6), "has 6 columns, 0 to 5"),
        ((0, 1, 2, -1), "has 6 columns, 0 to 5"),
        ((0, 1, 2, 2), "four different column numbers"),
        ((0, 1, "x", "y"), "mixes names and numbers"),
    ],
)
def test_layouts_that_do_not_fit(tmp_path, columns, message):
    with pytest.raises(MotionGymError, match=message):
        find_columns(table_of(tmp_path, SIX), None if columns is None else parse_columns(columns))


def test_an_obsmat_is_recognised_by_what_is_constant(tmp_path):
    row = "{} {} {:.2f} 0.0 {:.2f} 0.5 0.0 0.1\n"
    text = "".join(row.format(6 * k, a, k / 2 + a, k / 3) for k in range(4) for a in range(2))
    assert places(find_columns(table_of(tmp_path, text), None)) == (0, 1, 2, 4)
    with pytest.raises(DataError, match="8 columns and no header"):
        find_columns(table_of(tmp_path, text.replace(" 0.0 ", " 0.0 ").replace(" 0.5 0.0 ", " 0.5 0.3 ", 1)), None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ped1 0 1.5 2\nped1 1 1.5 2.5\n", "columns are not frame .or time., id, x and y: column 0 is not a number"),
        ("0 ped1 walks 2\n1 ped1 walks 2.5\n", "columns 2 and 3 are not both numbers"),
        ("1 2 3\n2 2 3\n", "has 3 columns and no header"),
    ],
)
def test_four_columns_that_are_something_else(tmp_path, text, message):
    with pytest.raises(DataError, match=message):
        find_columns(table_of(tmp_path, text), None)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("Frame #", "frame"), ("obj_id", "id"), ("vx", None), ("x_velocity", None), ("width", None), ("sceneId", None)],
)
def test_roles_of_names(name, expected):
    assert role_of(name) == expected


def test_units_in_names():
    assert plain_name("X [cm]") == ("x", "cm") and plain_name("y/ft") == ("y", "ft")
    assert plain_name("time [ms]") == ("time_ms", "ms")


def crowd(people, frames, apart, step):
    frame, person = (grid.reshape(-1) for grid in np.meshgrid(np.arange(frames), np.arange(people), indexing="ij"))
    xy = np.stack([step * frame, apart * person], axis=1).astype(float)
    return frame * 10, person, xy


@pytest.mark.parametrize(
    ("people", "frames", "apart", "step"),
    [(3, 60, 1.0, 0.5), (60, 30, 3.0, 0.4), (1, 40, 1.0, 0.5), (30, 12, 2.0, 0.4)],
)
def test_a_swap_is_seen_and_the_right_order_is_not_accused(people, frames, apart, step):
    frame, person, xy = crowd(people, frames, apart, step)
    assert swap_evidence(frame, person, xy) == ""
    if frames >= 20:
        assert "the longest track has" in swap_evidence(person, frame, xy)
