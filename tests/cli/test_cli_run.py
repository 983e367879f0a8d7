"""The verb that runs a benchmark, as it is typed."""

import contextlib
import importlib.util
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from motion_gym.cli.main import main
from tests.cli.command_line import fail

OWN = '''
import copy

import numpy as np

from motion_gym.benchmarks.objects import Benchmark, Part, Shifts

COLUMNS = {"0.1": "orca:d=0.1,scenes=40", "0.6": "orca:d=0.6,scenes=40"}
PART = Part("Small crowds", COLUMNS, ("constant_velocity", "linear"))
SMALL = Benchmark("small", "A small benchmark of a user", (PART,))
STREAMS = Benchmark(
    "streams",
    "Short streams of a user",
    shifts={
        "style": Shifts(
            "Small crowds",
            "modular_invariant",
            "style",
            {"sudden": {"domains": ["orca:d=0.3,scenes=40", "orca:d=0.6,scenes=40"], "kind": "sudden", "frames": 200}},
            "modular_invariant:weights=online/orca",
            (),
        )
    },
)


class Steady:
    """Walks on at a part of its last velocity."""

    selection = "nothing was selected"

    def predict(self, observation, samples=1, seed=0):
        xy = observation.xy
        steps = np.arange(1, 13, dtype=np.float32)[:, None]
        return (xy[:, -1:] + 0.9 * (xy[:, -1] - xy[:, -2])[:, None] * steps)[:, None]


class Fitted(Steady):
    """Needs data."""

    fitted = False

    def fit(self, train, validation, seed):
        self.fitted = True
        return self


class Same:
    """Adapts nothing."""

    def __init__(self, of):
        self.of = copy.deepcopy(of)
        self.told = 0

    def predict(self, observation, samples=1, seed=0):
        return self.of.predict(observation, samples, seed)

    def observe(self, truth):
        self.told += 1

    def reset(self):
        self.told = 0
'''


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    (tmp_path / "own_rows_here.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "own_rows_here", raising=False)
    return tmp_path


def call(capsys, line):
    main(shlex.split(line))
    captured = capsys.readouterr()
    assert captured.err == ""
    return captured.out


def test_a_shipped_table_is_shown_without_data_and_without_torch(folder):
    code = """
        import sys

        class NotInstalled:
            def find_spec(self, name, path=None, target=None):
                if name.partition(".")[0] in ("torch", "safetensors", "numba"):
                    raise ModuleNotFoundError(f"No module named '{name}'", name=name)

        sys.meta_path.insert(0, NotInstalled())
        from motion_gym.cli.main import main
        for name in ("style", "spurious", "online", "pretraining"):
            main(["run", name, "--only", "constant_velocity"] if name != "pretraining" else ["run", name])
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        cwd=folder,
        env={**os.environ, "MOTION_GYM_DATA": str(folder / "nowhere"), "COLUMNS": "200"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert re.search(r"modular_invariant +\.063 ± \.000", done.stdout) and "invariant:penalty=3" in done.stdout
    assert "After a sudden shift" in done.stdout
    assert not (folder / "results").exists()  # nothing had to be computed


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_benchmark_of_a_user_is_run_with_rows_of_a_user(capsys, folder, jobs):
    line = f"run own_rows_here:SMALL --predictor own_rows_here:Steady --out out --jobs {jobs}"
    out = call(capsys, line)
    assert "Small crowds: beside the shipped rows" in out and "own_rows_here:Steady" in out
    assert "Written: out/small/tables.md" in out
    runs = [json.loads(path.read_text()) for path in (folder / "out" / "small").glob("*.json")]
    assert sorted(run["predictor"] for run in runs) == sorted(
        ["constant_velocity", "linear", "own_rows_here:Steady"] * 2
    )
    own = [run for run in runs if run["predictor"] == "own_rows_here:Steady"]
    for run in own:
        difference = run["versus"]["constant_velocity"]
        assert difference["mean"] == pytest.approx(run["versus_baseline"]["ADE"]["mean"], abs=1e-6)
        assert difference["low"] <= difference["mean"] <= difference["high"]
        assert run["versus"]["best"]["row"] in ("constant_velocity", "linear")


def test_shipped_rows_are_kept_and_own_rows_are_scored_anew(capsys, folder):
    line = "run own_rows_here:SMALL --predictor own_rows_here:Steady --jobs 1"
    call(capsys, line)
    paths = sorted((folder / "results" / "small").glob("*.json"))
    times = {path.name: path.stat().st_mtime_ns for path in paths}
    call(capsys, line)
    anew = {path.name.partition("--")[0] for path in paths if path.stat().st_mtime_ns != times[path.name]}
    assert anew == {"own_rows_here_Steady"}
    call(capsys, "run own_rows_here:SMALL --fresh --only linear --jobs 1")
    anew = {path.name.partition("--")[0] for path in paths if path.stat().st_mtime_ns != times[path.name]}
    assert anew == {"own_rows_here_Steady", "linear"}


def test_what_can_be_fitted_is_fitted_with_five_seeds(capsys, folder):
    call(capsys, "run own_rows_here:SMALL --predictor own_rows_here:Fitted --out out --jobs 1")
    own = [json.loads(path.read_text()) for path in (folder / "out" / "small").glob("own_rows_here_Fitted*")]
    assert sorted((run["seed"], run["spec"]) for run in own) == [
        (seed, f"orca:d={d},scenes=40") for seed in range(5) for d in (0.1, 0.6)
    ]


def test_an_adapter_of_a_user_stands_among_those_that_ship(capsys, folder):
    out = call(capsys, "run own_rows_here:STREAMS --adapter own_rows_here:Same --out out --jobs 1")
    assert "Small crowds: beside the shipped rows" in out
    own = [json.loads(path.read_text()) for path in (folder / "out" / "streams").glob("own_rows_here_Same*")]
    none = [json.loads(path.read_text()) for path in (folder / "out" / "streams").glob("none--*")]
    assert len(own) == len(none) == 5
    ades = {(run["stream"], run["of"]): run["ade"]["mean"] for run in none}
    assert all(ades[run["stream"], run["of"]] == pytest.approx(run["ade"]["mean"], abs=1e-4) for run in own)
    (compared,) = [run["versus"] for run in own if "versus" in run]
    assert compared["constant_velocity"]["mean"] < 0 and compared["best"]["row"] == "none"
    assert compared["none"]["mean"] == 0 and "vs none" in out


@pytest.mark.parametrize(
    ("definition", "message"),
    [
        ("Part('T', ['orca:d=0.1'], ())", "`domains` of the part `T` must map the name of each column to a spec"),
        ("Part('T', {}, ())", "`domains` of the part `T` must map"),
        ("Part('T', COLUMNS, 'linear')", "`plain` of the part `T` must be a sequence of rows, as ('linear',)"),
        ("Part('T', COLUMNS, ('linear',), protocol='honst')", "Did you mean `honest`?"),
        ("Part('T', COLUMNS, (), pooled={'all': ('0.1', '0.7')})", "There is no column `0.7` of the part `T`."),
        ("Part('T', COLUMNS, (), shots={'0.7': 3})", "There is no column `0.7` of the part `T`. Did you mean `0.6`?"),
        ("Benchmark('mine', 'T', PART)", "`parts` of the benchmark `mine` must be a sequence of Part objects"),
        ("Benchmark('mine', 'T', (COLUMNS,))", "`parts` of the benchmark `mine` has a dict: make it a Part."),
        ("Benchmark('mine', 'T')", "The benchmark `mine` is empty"),
        (
            "Part('T', COLUMNS, (row for row in ['linear']))",
            "`plain` of the part `T` must be a sequence of rows, as (...),",
        ),
        ("Part('T', COLUMNS, ('linear', 'linear'))", "`linear` is twice among the rows of the part `T`"),
        ("Part('T', {'a': 3}, ('linear',))", "The column 'a' of the part `T` is 3"),
        ("Part('T', COLUMNS, (), samples='1')", "`samples=1` must be a whole number"),
        ("Part('T', COLUMNS, (), pooled=['0.1'])", "`pooled` of the part `T` must map names to columns"),
        (
            "Part('T', COLUMNS, (), pooled={'all': '0.1'})",
            "The columns of `all` in `pooled` of the part `T` must be a seq",
        ),
        ("Part('T', COLUMNS, (), shots=('0.1',))", "`shots` of the part `T` must map names to columns"),
        ("Benchmark('mine', 'T', shifts=('x',))", "`shifts` of the benchmark `mine` must map names to Shifts objects"),
        ("Benchmark('mine', 'T', drives=(d for d in ()))", "`drives` of the benchmark `mine` must be a sequence"),
        ("Benchmark('mine', 'T', (PART, PART))", "`Small crowds` is twice among the titles of parts"),
        ("Benchmark('../mine', 'T', (PART,))", "The name `../mine` of a benchmark is also that of a folder"),
        ("Benchmark('style', 'T', (PART,))", "Your benchmark has the name `style` of a shipped one"),
    ],
)
def test_a_mistake_in_a_definition_is_told_where_it_is(folder, capsys, monkeypatch, definition, message):
    monkeypatch.delitem(sys.modules, "mistaken", raising=False)
    text = f"from own_rows_here import COLUMNS, PART, Benchmark, Part\n\nOWN = {definition}\n"
    (folder / "mistaken.py").write_text(text)
    err = fail(capsys, "run mistaken:OWN").err
    assert message in err and ("(mistaken.py, line 3)" in err or "of a shipped one" in err), err
    assert [path.name for path in folder.iterdir() if path.is_dir()] == []


def test_a_report_says_which_runs_it_does_not_show(capsys, folder):
    call(capsys, "run own_rows_here:SMALL --predictor own_rows_here:Steady --out results --jobs 1")
    for file in Path("results/small").glob("*--*.json"):
        shutil.copy(file, "results")
    out = call(capsys, "report results --out page.html")
    assert "the shipped benchmarks alone: `small`." in out
    assert (
        "The runs in results itself, as of `motion-gym score`, are of no shipped benchmark, and are not shown." in out
    )


def test_a_benchmark_of_ones_own_is_explained(capsys):
    assert "Did you mean `SMALL`?" in fail(capsys, "ls own_rows_here:SMAL").err
    assert "write `own_rows_here:SMALL` or" in fail(capsys, "ls own_rows_here").err
    out = call(capsys, "ls own_rows_here:SMALL")
    assert out.startswith("benchmark own_rows_here:SMALL\n\nA small benchmark of a user\n\n`motion-gym run own_rows")
    assert (
        "    columns: 0.1 (orca:d=0.1,scenes=40), 0.6 (orca:d=0.6,scenes=40)\n    rows: constant_velocity, linear\n"
        in out
    )


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("run spurios", "There is no benchmark `spurios`. Did you mean `spurious`?"),
        ("run own_rows_here:Steady", "make it a motion_gym.benchmarks.objects.Benchmark"),
        ("run own_rows_here:SMAL", "`own_rows_here` has no `SMAL`. Did you mean `SMALL`?"),
        ("run own_rows_here", "own_rows_here.py is here: write `own_rows_here:SMALL` or `own_rows_here:STREAMS`."),
        ("run own_rows_here.py:SMALL", "Write `own_rows_here:SMALL`, without .py."),
        ("run nowhere:SMALL", "There is no module `nowhere`"),
        ("run style --only modula", "style has no row `modula`. Did you mean `modular`?"),
        ("run style --shift alpha", "style has no shift `alpha`"),
        ("run style --adapter kalman", "style has no streams for an adapter"),
        ("run online --shift style --only none --predictor linear", "online has no columns for a predictor"),
        ("run style --address 127.0.0.1:6379", "options of the executor `ray`: add --executor ray"),
        ("run style --jobs 0", "`jobs=0` must be a whole number"),
        ("run style --into nowhere.md", "nowhere.md cannot be read"),
        ("run own_rows_here:SMALL --predictor own_rows_here:Stedy", "Did you mean `Steady`?"),
    ],
)
def test_mistakes_are_one_message(capsys, line, message):
    with pytest.raises(SystemExit) as stopped:
        main(shlex.split(line))
    assert stopped.value.code == 2 and message in capsys.readouterr().err


@pytest.mark.parametrize("line", ["SMALL --predictor constant_velocty", "STREAMS --adapter klaman"])
def test_a_misspelt_row_is_told_before_anything_is_computed(capsys, folder, line):
    assert "Did you mean" in fail(capsys, f"run own_rows_here:{line} --out results").err
    assert not list(folder.rglob("*.json"))


@pytest.mark.skipif(importlib.util.find_spec("ray") is not None, reason="Ray is installed")
@pytest.mark.parametrize("line", ["run style --executor ray", "train erm --benchmark style --executor ray"])
def test_without_ray_the_message_says_how_to_install_it(capsys, line):
    with pytest.raises(SystemExit) as stopped:
        main(shlex.split(line))
    assert stopped.value.code == 2 and 'pip install "motion-gym[ray]"' in capsys.readouterr().err


SLOW = """
import pathlib, time

class Slow:
    def predict(self, observation, samples=1, seed=0):
        pathlib.Path("begun").touch()
        time.sleep(100)
"""


@pytest.mark.parametrize("line", ["run baselines --jobs 2 --out out --predictor", "score --domain orca"])
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stopped_command_leaves_no_process_behind(folder, line, number, status):
    (folder / "slow.py").write_text(SLOW)
    command = [sys.executable, "-m", "motion_gym", *shlex.split(line), "slow:Slow"]
    output = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, cwd=folder, start_new_session=True, **output)
    try:
        deadline = time.monotonic() + 100
        while not (folder / "begun").exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        if number == signal.SIGINT:
            os.killpg(process.pid, number)  # as a terminal does
        else:
            process.terminate()
        err = process.communicate(timeout=50)[1]
        assert process.returncode == status and "Stopped." in err and "Slow" not in err
        deadline = time.monotonic() + 20
        while living(process.pid) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert not living(process.pid)
    finally:
        for number in living(process.pid):
            os.kill(number, signal.SIGKILL)


DEAF = """
import ctypes
import os
import time

class Deaf:
    # Python cannot raise an exception in this function: C has called it.
    def predict(self, observation, samples=1, seed=0):
        ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), NUMBER))()
        time.sleep(100)
        return observation.xy[:, -1:].repeat(12, 1)
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_that_a_library_swallows_stops_the_command_all_the_same(folder, number, status):
    (folder / "deaf.py").write_text(DEAF.replace("NUMBER", str(int(number))))
    command = [sys.executable, "-m", "motion_gym", "score", "deaf:Deaf", "--domain", "orca"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == status and done.stderr.startswith("Stopped."), done.stderr


def living(group):
    """Numbers of the processes of a group, without those that have ended and were not yet noticed."""
    numbers = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, _, its_group, *_ = path.read_text().rpartition(")")[2].split()
            if int(its_group) == group and state != "Z":
                numbers.append(int(path.parent.name))
    return numbers
