from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import textwrap
from typing import Any

import pytest

import motion_gym
from motion_gym.benchmarks import results
from motion_gym.benchmarks.results import read, read_folder, run, spec_of
from motion_gym.contract import DataError
from motion_gym.training.provenance import commit

make: Any = motion_gym.domain
CROWD = make("orca", d=0.6, scenes=30)


def strict(path):
    """JSON as the standard has it: no NaN, no Infinity."""

    def refuse(constant):
        raise ValueError(f"{constant} is not JSON")

    return json.loads(path.read_text(), parse_constant=refuse)


def only(folder):
    (path,) = folder.iterdir()
    return path


def test_file_has_everything_that_lasts(tmp_path):
    result = run("linear", CROWD, tmp_path, k=2, seed=3)
    kept = strict(only(tmp_path))
    assert kept == json.loads(json.dumps(result)) == read(only(tmp_path))
    assert kept["schema"] == results.SCHEMA
    assert (kept["predictor"], kept["split"], kept["k"], kept["seed"]) == ("linear", "test", 2, 3)
    assert kept["protocol"] == "honest"
    assert kept["selection"].startswith("fitted in closed form")
    assert "bootstrap of whole agents" in kept["aggregation"]
    domain = kept["domain"]
    assert domain["parameters"] == {**CROWD.parameters}
    assert domain["counts"]["test"]["scenes"] == CROWD.windows("test").observation.scenes
    assert set(kept["versions"]) == {"python", "motion-gym", "numpy", "gymnasium", "pettingzoo", "torch", "numba"}
    assert kept["commit"] == commit()
    assert kept["seconds"] > 0 and kept["peak_memory"] > 10e6
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+00:00", kept["finished"])
    assert "Python 3" in kept["machine"] and kept["command"] == sys.argv[1:]
    assert len(kept["horizon"]) == 12
    for name in ("ADE", "FDE", "MR_2m", "minADE_2", "minFDE_2", "JADE_2", "JFDE_2"):
        metric = kept["metrics"][name]
        assert metric["low"] <= metric["mean"] <= metric["high"]
        assert metric["agent_windows"] == metric["agents"] == 2 * metric["scenes"]
        assert metric["unit"] in ("m", "1") and metric["lower_is_better"] is True
    assert kept["metrics"]["KDE_NLL_2"]["mean"] is None  # one forecast is no density
    assert kept["versus_baseline"]["baseline"] == "constant_velocity"
    assert set(kept["versus_baseline"]["ADE"]) == {"mean", "low", "high", "p_value", "n"}


def test_commit_is_that_of_the_checkout():
    head = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=os.path.dirname(__file__), capture_output=True, text=True, check=False
    )
    if head.returncode:
        pytest.skip("not a git checkout")
    assert commit() in (head.stdout.strip(), head.stdout.strip() + "+")


def test_data_hashes_are_kept(tmp_path, eth_ucy):
    run("stand_still", make("eth:alpha=64"), tmp_path)
    kept = strict(only(tmp_path))
    assert kept["domain"]["files"] == {
        "biwi_eth.txt": "cf8d3fd342a15f409ebc2a1fc76b91a0f06390bd21f1e11410f3859331ab082b"
    }
    assert kept["domain"]["side_channels"] == ["sigma"]
    assert kept["leaks"] == ["oracle side channel: sigma reads the future"] and kept["oracle"] is False
    assert kept["scored"] == "agents complete over all 20 steps, at least 2 in every window"
    assert kept["metrics"]["ADE"]["agents"] == 36


def test_run_that_exists_is_skipped(tmp_path):
    first = run("constant_velocity", CROWD, tmp_path)
    path = only(tmp_path)
    before = path.stat()
    again = run("constant_velocity", CROWD, tmp_path)
    assert again == read(path) and again["finished"] == first["finished"]
    assert (path.stat().st_mtime_ns, path.stat().st_ino) == (before.st_mtime_ns, before.st_ino)
    marked = {**first, "seconds": 12345.0}  # what is in the file is what counts
    path.write_text(json.dumps(marked))
    assert run("constant_velocity", CROWD, tmp_path)["seconds"] == 12345.0


@pytest.mark.parametrize(
    ("predictor", "domain", "options"),
    [
        ("constant_velocity:velocity=mean", CROWD, {}),
        ("constant_velocity", CROWD.replace(d=0.5), {}),
        ("constant_velocity", CROWD.replace(seed=1), {}),
        ("constant_velocity", CROWD, {"seed": 1}),
        ("constant_velocity", CROWD, {"k": 2}),
        ("constant_velocity", CROWD, {"split": "val"}),
        ("constant_velocity", CROWD, {"protocol": "paper", "k": 1}),
    ],
)
def test_what_makes_another_run(tmp_path, predictor, domain, options):
    run("constant_velocity", CROWD, tmp_path)
    run(predictor, domain, tmp_path, **options)
    assert len(list(tmp_path.iterdir())) == 2
    assert len(read_folder(tmp_path)) == 2


def test_default_and_named_k_are_the_same_run(tmp_path):
    run("stand_still", CROWD, tmp_path)
    run("stand_still", CROWD, tmp_path, k=1)
    assert len(list(tmp_path.iterdir())) == 1


OWN = """
import numpy as np
class Mine:
    def predict(self, observation, samples=1, seed=0):
        return np.repeat(observation.xy[:, None, -1:], 12, axis=2) + np.float32({})
"""


def python(code, *arguments, cwd):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_changed_source_is_another_run_and_replaces_the_old_one_in_tables(tmp_path):
    code = """
        import sys
        from pathlib import Path
        import motion_gym
        from motion_gym.benchmarks.results import run
        sys.path.insert(0, "")
        result = run("mine:Mine", motion_gym.domain("orca", scenes=10), Path("out"))
        print(result["metrics"]["ADE"]["mean"])
    """
    means = []
    for shift in (0.0, 0.0, 5.0):
        (tmp_path / "mine.py").write_text(OWN.format(shift))
        means.append(float(python(code, cwd=tmp_path)))
    assert means[0] == means[1] != means[2]
    assert len(list((tmp_path / "out").iterdir())) == 2
    (kept,) = read_folder(tmp_path / "out")
    assert kept["metrics"]["ADE"]["mean"] == means[2]


@pytest.mark.parametrize(
    "content", ["", '{"schema": 2', "[]", "not json", '{"schema": 1}', '{"schema": 2}'], ids=range(6)
)
def test_damaged_file_is_named_with_a_remedy(tmp_path, content):
    run("stand_still", CROWD, tmp_path)
    path = only(tmp_path)
    path.write_text(content)
    for use in (lambda: read(path), lambda: read_folder(tmp_path), lambda: run("stand_still", CROWD, tmp_path)):
        with pytest.raises(DataError, match=r"is not a result.*Delete it, and run the command again") as caught:
            use()
        assert str(path) in str(caught.value)


def test_binary_file_is_no_result(tmp_path):
    (tmp_path / "a.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match="is not a result"):
        read_folder(tmp_path)


def test_folder_without_results(tmp_path):
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(DataError, match=r"There is no result in .*motion-gym score"):
            read_folder(folder)


def test_full_disk_leaves_nothing_half_written(tmp_path):
    code = """
        import resource, signal, sys
        from pathlib import Path
        import motion_gym
        from motion_gym.benchmarks.results import run
        from motion_gym.data.storage import StorageError
        domain = motion_gym.domain("orca", d=0.6, scenes=30)
        domain.windows("test")  # cached while there was room
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
        try:
            run("stand_still", domain, Path(sys.argv[1]))
        except StorageError as error:
            print(error)
    """
    message = python(code, tmp_path / "out", cwd=tmp_path)
    assert "could not be written: File too large" in message and "stand_still--orca" in message
    assert list((tmp_path / "out").iterdir()) == []


def test_killed_sweep_leaves_whole_files_and_goes_on(tmp_path):
    sweep = """
        import sys
        from pathlib import Path
        import motion_gym
        from motion_gym.benchmarks.results import run
        for d in (0.1, 0.2, 0.3, 0.4, 0.5):
            run("constant_velocity", motion_gym.domain("orca", d=d, scenes=10), Path(sys.argv[1]))
            print(d, flush=True)
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(sweep), str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "0.1\n" and process.stdout.readline() == "0.2\n"
    process.kill()
    process.wait()
    process.stdout.close()
    done = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.json")}
    assert 2 <= len(done) <= 5
    assert len(read_folder(tmp_path)) == len(done)
    python(sweep, tmp_path, cwd=tmp_path)
    after = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.json")}
    assert len(after) == 5 and done.items() <= after.items()


@pytest.mark.parametrize(
    ("spec", "short"),
    [
        ("eth", "eth"),
        ("eth:alpha=64", "eth:alpha=64.0"),
        ("eth:alpha=64,sigma=paper", "eth:alpha=64.0"),
        ("eth:sigma=past", "eth:alpha=1.0,sigma=past"),
        ("eth:alpha=8,sigma=past", "eth:alpha=8.0,sigma=past"),
        ("zara1:min_agents=1", "zara1:min_agents=1"),
        ("orca", "orca:d=0.3"),
        ("orca:scenes=5,d=0.6", "orca:d=0.6,scenes=5"),
    ],
)
def test_short_spec_makes_the_same_domain(spec, short):
    domain = make(spec)
    assert spec_of(domain) == short
    assert make(short).parameters == domain.parameters


def test_short_spec_of_a_domain_with_required_parameters():
    class Own(motion_gym.data.domains.RecordedDomain):
        name = "own"

        def __init__(self, path, dt=0.4):
            self.path, self.dt = path, dt

    assert spec_of(Own("a.txt")) == "own:path=a.txt"
    assert spec_of(Own("a.txt", 0.5)) == "own:path=a.txt,dt=0.5"


def test_versions_of_what_is_installed():
    import numpy

    assert results.versions()["numpy"] == numpy.__version__
    assert results.versions()["python"] == ".".join(map(str, sys.version_info[:3]))
