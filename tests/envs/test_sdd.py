"""The domain ``sdd``: selections, splits, units and images, on the real files and on small ones."""

from __future__ import annotations

import itertools
import re
import shutil

import numpy as np
import pytest

import motion_gym
from motion_gym.catalog import domain
from motion_gym.checks.checker import check_domain
from motion_gym.contract import DataError, MotionGymError, SpecError
from motion_gym.data.domains import spec_of
from motion_gym.data.overlap import shared_people
from motion_gym.envs.sdd import SPEEDS
from tests.cli.command_line import call, fail
from tests.drone import add_clips, line, people, write_clip

SCORES = {
    "0.25-0.75": (521, 23.57, 48.67, 0.9246, 1.908),
    "1.25-1.75": (728, 27.22, 54.46, 0.9261, 1.856),
    "2.25-2.75": (396, 53.73, 120.5, 2.027, 4.551),
    "3.25-3.75": (514, 70.59, 161.1, 2.511, 5.706),
}
"""Windows of each speed domain, and ADE and FDE of constant velocity in pixels and in metres."""
RAW = {"deathCircle_2": 21, "hyang_8": 7, "hyang_9": 4, "quad_0": 8, "quad_1": 12, "quad_3": 2}
"""Windows of the tables in each clip whose annotations are here."""


@pytest.fixture
def clips(tmp_path, monkeypatch):
    """A data folder with two clips of our own."""
    monkeypatch.setenv("MOTION_GYM_DATA", str(tmp_path / "data"))
    return add_clips(tmp_path)


def small(**keywords):
    return domain("sdd", form="clips", **keywords)


@pytest.mark.parametrize("speed", SPEEDS)
def test_speed_domains_have_the_published_windows_and_known_scores(sdd, speed):
    for unit, (ade, fde) in {"px": SCORES[speed][1:3], "m": SCORES[speed][3:]}.items():
        score = motion_gym.evaluate("constant_velocity", f"sdd:speed={speed},unit={unit}")
        assert score.domain.unit == unit and score.ade.agent_windows == SCORES[speed][0]
        assert score.ade.mean == pytest.approx(ade, rel=1e-3) and score.fde.mean == pytest.approx(fde, rel=1e-3)


def test_successors_selections(sdd):
    def windows(spec):
        return len(domain(spec).windows("test").future)

    assert windows("sdd:scene=deathCircle,video=0,class=pedestrian") == 201
    assert windows("sdd:scene=deathCircle,video=0,class=biker") == 314
    assert windows("sdd:class=biker,speed=0.5-3.5") == 1529 and windows("sdd:class=biker,speed=4-8") == 696
    assert windows("sdd:class=all,split=0 0 1") == 6507


def test_annotations_agree_with_the_window_tables(sdd):
    table = domain("sdd", class_="all", split="0 0 1")
    (tables, raw) = ({r.name: r for r in d.recordings("test")} for d in (table, table.replace(form="clips")))
    for clip, count in RAW.items():
        rows, whole = tables[clip], raw[clip]
        assert len(rows.frame) == 20 * count
        known = {(f, a): tuple(xy) for f, a, xy in zip(whole.frame, whole.agent, whole.xy.tolist(), strict=True)}
        assert all(known[f, a] == tuple(p) for f, a, p in zip(rows.frame, rows.agent, rows.xy.tolist(), strict=True))


def test_classes_of_annotations_agree_with_those_of_the_tables(sdd):
    for name in ("pedestrian", "biker"):
        agents = [
            {(r.name, a) for r in domain("sdd", class_=name, form=form).recordings("test") for a in r.agent.tolist()}
            for form in ("windows", "clips")
        ]
        assert {pair for pair in agents[0] if pair[0] in RAW} <= agents[1]


@pytest.mark.parametrize("form", ["windows", "clips"])
@pytest.mark.parametrize("target", [{"speed": "1.25-1.75"}, {"class_": "biker"}, {"scene": "quad"}, {}])
def test_sources_and_splits_share_no_people_with_the_test_split(sdd, form, target):
    place = domain("sdd", form=form, **target)
    scored = place.recordings("test")
    shown = [r for source in place.sources() for part in ("train", "val") for r in source.recordings(part)]
    assert shown and scored and not shared_people(shown, scored)
    people = [{(r.name, a) for r in recordings for a in r.agent.tolist()} for recordings in (shown, scored)]
    assert not people[0] & people[1]


def test_splits_share_neither_people_nor_frames(clips):
    place = small()
    parts = {part: place.recordings(part) for part in ("train", "val", "test")}
    people, spans = [], []
    for recordings in parts.values():
        people.append({(r.name, a) for r in recordings for a in r.agent.tolist()})
        spans.append([(r.frame.min(), r.frame.max()) for r in recordings if r.name == "coupa_2"])
    assert all(people[:1]) and not people[0] & people[1] and not (people[0] | people[1]) & people[2]
    ends = [span for part in spans for span in part]
    assert ends == sorted(ends) and all(a[1] < b[0] for a, b in itertools.pairwise(ends))


def test_only_selected_people_are_shown(clips):
    bikers = small(class_="biker")
    assert {a for r in bikers.recordings("test") for a in r.agent.tolist()} == {10, 11, 12}
    assert [r.name for r in small(scene="hyang").recordings("test")] == ["hyang_2"]
    slow = small(scene="coupa", speed=(0.2, 0.6))
    assert {a for r in slow.recordings("test") for a in r.agent.tolist()} == {2, 3, 4, 5, 6}


def test_gaps_end_a_window_and_lost_boxes_are_no_positions(clips):
    lost = [line(0, frame, 50 + frame // 12, 100, lost=int(300 <= frame < 330)) for frame in range(720)]
    write_clip(clips / "raw", "hyang_2", lost)
    (recording,) = small(scene="hyang").recordings("test")
    assert np.diff(recording.frame).max() == 48 and len(recording.frame) == 57
    assert len(small(scene="hyang").windows("test").future) == (25 - 19) + (32 - 19)


def test_a_spec_is_read_back(clips):
    spec = "sdd:class=biker,form=clips"
    place = domain(spec)
    assert spec_of(place) == spec and place.parameters["class_"] == "biker"
    assert domain(spec_of(domain(spec, speed=(0.1, 1)))).speed == "0.1-1"
    assert domain("sdd", class_=["biker", "pedestrian"]).class_ == "biker pedestrian"


def test_the_contract_holds(clips):
    check_domain(small())


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"scene": "quads"}, r"`scene=quads` of domain `sdd` is not known. Did you mean `quad`"),
        ({"class_": "cyclist"}, r"`class=cyclist` of domain `sdd` is not known"),
        ({"video": 99}, "`video=99` must be a whole number"),
        ({"speed": "fast"}, "`speed=fast` of domain `sdd` must be a range"),
        ({"speed": "4-2"}, "`speed=4-2`"),
        ({"unit": "ft"}, "`unit=ft` of domain `sdd` is not known. Known: m, px"),
        ({"image": "yes"}, "`image=yes` of domain `sdd` must be true or false"),
        ({"split": "1 1 1"}, "three shares"),
        ({"form": "pickle"}, "`form=pickle` of domain `sdd` is not known"),
    ],
)
def test_a_wrong_parameter_is_named(keywords, message):
    with pytest.raises(SpecError, match=message):
        domain("sdd", **keywords)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"scene": "quad"}, "no annotations of scene=quad, video=all.*motion-gym data add sdd --from DIR"),
        ({"class_": "skater"}, "class=skater: nobody is selected. .* by class: 3 biker, 14 pedestrian"),
        ({"speed": "7-8"}, "nobody is selected, none of 17 of the class with speed=7-8"),
        ({"form": "windows"}, r"train\.csv is missing. Run `motion-gym data add sdd --from DIR`"),
        ({"unit": "m"}, r"estimated_scales\.yaml is missing"),
    ],
)
def test_missing_people_and_files_are_named(clips, keywords, message):
    with pytest.raises(MotionGymError, match=message):
        domain("sdd", **{"form": "clips", **keywords}).recordings("train")
        domain("sdd", **{"form": "clips", **keywords}).recordings("test")


def test_metres_are_estimated_by_clip(sdd):
    (metres,), (pixels,) = (domain("sdd", unit=u, scene="quad", video=1).recordings("test") for u in ("m", "px"))
    assert metres.xy == pytest.approx(0.042530206 * pixels.xy)
    assert "estimated scales" in domain("sdd", unit="m").card.source


def test_adding_says_the_terms_and_refuses_bad_files(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MOTION_GYM_DATA", str(tmp_path / "data"))
    path = write_clip(tmp_path / "annotations", "gates_0", people(2))
    out = call(capsys, f"data add sdd --from {tmp_path / 'annotations'}")
    assert "no commercial use" in out and re.search(r"sdd: 1 of \d+ files are here and whole", out)
    assert (tmp_path / "data/sdd/raw/gates/video0/annotations.txt").read_bytes() == path.read_bytes()
    write_clip(tmp_path / "annotations", "gates_3", ["0 1 2"])
    assert (
        "annotations.txt, line 1: 3 columns instead of 10"
        in fail(capsys, f"data add sdd --from {tmp_path / 'annotations'}").err
    )
    write_clip(tmp_path / "other", "quad_0", people(2))
    assert re.search(r"quad.video0.annotations.txt: expected \d+ bytes", fail(
        capsys, f"data add sdd --from {tmp_path / 'other'}"
    ).err)  # fmt: skip
    assert "no commercial use" in fail(capsys, "data fetch sdd").err


def test_an_image_of_another_clip_is_refused(clips):
    shutil.copy(clips / "reference/hyang_2.jpg", clips / "reference/coupa_2.jpg")
    with pytest.raises(DataError, match=r"coupa_2\.jpg does not match its clip: it ends at \[480, 480\] pixels"):
        small(image=True).windows("test")
