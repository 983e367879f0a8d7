"""The results page: leaderboard, ranks, own rows, hostile names and scenes; tests/page has what a browser shows."""

import base64
import json
import re
import subprocess
import sys
import urllib.error
import urllib.request
import zlib

import numpy as np
import pytest

import motion_gym
from motion_gym.benchmarks import own_rows, running
from motion_gym.benchmarks.page import board, page, scenes
from motion_gym.benchmarks.reports.colors import PALETTE, color_of, styles_of
from motion_gym.benchmarks.store import run_of, write
from motion_gym.contract import DataError, SpecError
from motion_gym.metrics.errors import ade


def command(*arguments, **options):
    run = [sys.executable, "-m", "motion_gym", *map(str, arguments)]
    return subprocess.run(run, capture_output=True, text=True, timeout=300, **options)


def data_of(text):
    packed = re.search(r'<script type="text/plain" id="data">(.*?)</script>', text)[1]
    return json.loads(zlib.decompress(base64.b64decode(packed)))


@pytest.fixture(scope="module")
def places():
    return board.entries_of(running.run("places", only=()))


def test_entries_hold_the_numbers_of_the_stored_runs(places):
    (entry,) = (e for e in places if (e.method, e.column) == ("kalman_residual", "hotel"))
    runs = [
        run for part, runs in running.run("places", only=()).parts for run in runs
        if run["predictor"].startswith("kalman_residual") and part.column_of(run) == "hotel"
    ]  # fmt: skip
    assert entry.ade.tolist() == [run["metrics"]["ADE"]["mean"] for run in runs] and len(runs) == 5
    assert entry.versus[1] == min(run["versus_baseline"]["ADE"]["low"] for run in runs)
    text = " ".join(entry.conditions)
    for part in ("protocol honest", "k = 20", "unit m", "agent-windows", "scoring version", "epoch", "computed 20"):
        assert part in text


def test_ranks_are_shared_by_rows_that_cannot_be_told_apart(places):
    for column in ("eth6", "hotel", "zara2"):
        rows = sorted((e for e in places if e.column == column), key=lambda e: e.ade.mean())
        assert rows[0].rank == 1
        for row in rows:
            better = [o for o in rows if o is not row and (o.versus or (0, 0, 0))[2] < (row.versus or (0, 0, 0))[1]]
            assert row.rank == 1 + len([o for o in better if o.ade.mean() < row.ade.mean()])
    ranks = [e.rank for e in places if e.column == "eth"]  # few people walked there
    assert ranks.count(1) > 1


def test_oracles_and_leaking_rows_are_not_ranked():
    entries = board.entries_of(running.run("style", only=()))
    assert all(e.rank is None for e in entries if e.kind == "oracle")
    published = [e for e in entries if e.protocol == "paper"]
    assert published and all(e.rank is None for e in published if any("leak" in text for text in e.conditions))


def test_an_own_row_with_a_hostile_name_stands_on_the_page_as_text(tmp_path):
    name = "</script><script>alert(1)</script>|`x`"
    results = running.run("style", only=())
    runs = results.parts[0][1]
    original = next(run for run in runs if run["predictor"] == "linear")
    identity = {**original["identity"], "predictor": name, "session": "abc"}
    write(tmp_path / "style", run_of(identity, {**original, "predictor": name}))
    shown = own_rows.with_stored("style", tmp_path)
    text = page.html([shown], {})
    assert "<script>alert(1)" not in text
    texts = data_of(text)["board"]["texts"]
    assert name in texts and board.OWN in texts
    assert "&lt;script&gt;alert(1)" in text  # in the table


def test_a_page_without_results_and_a_folder_that_is_none_are_refused(tmp_path):
    with pytest.raises(DataError, match="no stored results"):
        page.html([], {})
    run = command("report", tmp_path / "none", "--out", tmp_path / "page.html")
    assert run.returncode == 2 and "no folder of results" in run.stderr and not (tmp_path / "page.html").exists()


def test_the_page_needs_no_network_and_stays_small(tmp_path):
    run = command("report", "--out", tmp_path / "page.html")
    assert run.returncode == 0 and "page.html" in run.stdout
    text = (tmp_path / "page.html").read_text()
    assert len(text.encode()) < 3e6
    assert not re.search(r'(src|href)="(https?:)?//', text)
    data = data_of(text)
    linked = set(re.findall(r'href="#leaderboard\?benchmark=(\w+)"', text))
    assert linked == {data["board"]["texts"][row[0]] for row in data["board"]["rows"]} and "planning" not in linked
    assert len(data["scenes"]) >= 50
    for scene in data["scenes"]:
        assert set(scene["methods"]) <= set(data["colors"])
    real = {"eth", "hotel", "univ", "zara1", "zara2", "eth6", "sdd"}
    assert not any(re.split(r"\W", scene["title"].rpartition(" of ")[2])[0] in real for scene in data["scenes"])


def test_a_window_scene_holds_the_forecasts_that_are_scored():
    chosen = [scenes.Windows("Two", "orca:d=0.6,scenes=40", ("constant_velocity", "orca_oracle"), 2)]
    content = scenes.compute(chosen)
    assert json.loads(json.dumps(content, allow_nan=False)) == content and len(content["scenes"]) == 2
    scene = content["scenes"][0]
    number = int(re.search(r"scene (\d+)", scene["title"])[1])
    windows = motion_gym.domain("orca:d=0.6,scenes=40").windows("test")
    truth = motion_gym.data.windows.pick_scenes(windows, [number])
    forecast = motion_gym.predictor("constant_velocity").predict(truth.observation)
    stored = np.array(scene["forecasts"]["constant_velocity"])[:, 0].reshape(-1, 12, 2) / scene["scale"]
    np.testing.assert_allclose(stored, forecast.most_likely(), atol=0.006)
    errors = np.linalg.norm(stored - np.array(scene["future"]).reshape(-1, 12, 2) / scene["scale"], axis=2).mean(axis=1)
    np.testing.assert_allclose(errors, ade(forecast, truth), atol=0.02)


def test_a_stream_scene_has_the_errors_of_the_online_evaluation():
    domains = ("orca:d=0.3,scenes=60", "orca:d=0.6,scenes=60")
    methods = ("constant_velocity", "kalman:of=modular_invariant")
    (scene,) = scenes.compute([scenes.Shift("Streams", domains, methods, 200, 60)])["scenes"]
    played = motion_gym.stream(list(domains), "sudden", 200)
    for name, adapter in (("constant_velocity", "constant_velocity"), ("kalman:of=modular_invariant", None)):
        runner = adapter or motion_gym.adapter("kalman", "modular_invariant")
        card = motion_gym.evaluate_online(runner, played)
        means = list(scene["means"][name].values())
        assert means == pytest.approx([segment.ade.mean for segment in card.segments], abs=2e-3)
    gauge = scene["gauges"]["kalman:of=modular_invariant"]["relative change of the last layer"]
    assert len(gauge) == len(scene["frames"]) and gauge[-1] > 0
    assert scene["marks"][0][1].startswith("after")


def test_scenes_of_ones_own_are_written_and_read(tmp_path):
    arguments = ["report", tmp_path, "--scenes", "--domain", "orca:d=0.6,scenes=40", "--count", "2"]
    run = command(*arguments, "--predictor", "linear", "--out", tmp_path / "page.html")
    assert run.returncode == 0, run.stderr
    assert [scene["methods"] for scene in scenes.read(tmp_path)["scenes"]] == [["linear"]] * 2
    (tmp_path / scenes.FILE).write_bytes(b"no")
    with pytest.raises(DataError, match="not a file of scenes"):
        scenes.read(tmp_path)
    refused = command(*arguments, "--predictor", "lineer", "--out", tmp_path / "page.html")
    assert refused.returncode == 2 and "lineer" in refused.stderr


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--domain", "orca"], "add --scenes"),
        (["--scenes", "--predictor", "linear"], "needs a `--domain`"),
        (["--scenes", "--domain", "orca", "--count", "0"], "count"),
    ],
)
def test_options_that_do_not_fit_are_refused(arguments, message, tmp_path):
    run = command("report", tmp_path, *arguments, "--out", tmp_path / "page.html")
    assert run.returncode == 2 and message in run.stderr


def test_scenes_of_an_empty_split_are_refused():
    with pytest.raises(SpecError):
        scenes.compute([scenes.Windows("None", "orca:d=0.6,scenes=40", ("erm",), 1)])  # erm needs sigma


def test_serve_shows_the_page_to_this_machine_alone(tmp_path):
    path = tmp_path / "page.html"
    path.write_text("<p>here</p>")
    (tmp_path / "secret").write_text("no")
    run = [sys.executable, "-u", "-m", "motion_gym", "serve", str(path), "--port", "0"]
    with subprocess.Popen(run, stdout=subprocess.PIPE, text=True) as server:
        try:
            address = re.search(r"http://127\.0\.0\.1:\d+/", server.stdout.readline())[0]
            assert urllib.request.urlopen(address).read() == b"<p>here</p>"
            for other in ("secret", "../secret", "%2e%2e/secret"):
                with pytest.raises(urllib.error.HTTPError):
                    urllib.request.urlopen(address + other)
        finally:
            server.terminate()
    missing = command("serve", tmp_path / "none.html")
    assert missing.returncode == 2 and "motion-gym report" in missing.stderr


def test_methods_of_one_figure_differ_and_keep_their_color():
    rows = ["constant_velocity", "constant_velocity:velocity=4", "none", "modular", "modular_invariant", "own:Thing"]
    styles = styles_of(rows)
    assert len(set(styles.values())) == len(rows)
    assert all(styles[row][0] == color_of(row) and color_of(row) in PALETTE for row in rows)
    assert color_of("modular:weights=style,seed=3") == color_of("modular")
