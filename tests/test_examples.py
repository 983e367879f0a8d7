from __future__ import annotations

import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.added_weights import needs_weights
from tests.traffic import needs_highway_env

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


@pytest.fixture
def folder(tmp_path):
    """The examples, where they may leave files."""
    return shutil.copytree(EXAMPLES, tmp_path / "examples", ignore=shutil.ignore_patterns("__pycache__"))


def python(folder, *arguments):
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "COLUMNS": "80", "TMPDIR": str(folder), "PYTHONWARNINGS": "error::RuntimeWarning"},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    return done.stdout


def motion_gym(folder, line):
    command, *arguments = shlex.split(line)
    assert command == "motion-gym"
    return python(folder, "-m", "motion_gym.cli.main", *arguments)


def found(pattern, text):
    """What the groups of a pattern matched, which must be somewhere in a text."""
    match = re.search(pattern, text, re.MULTILINE)
    assert match, f"{pattern} is not in: {text}"
    return match.groups()


def written_command(name):
    """The command line in the docstring of an example."""
    (line,) = re.findall(r"(motion-gym score .*)", (EXAMPLES / name).read_text().split('"""')[1])
    return line


def test_every_example_is_tested():
    assert {path.name for path in EXAMPLES.glob("*.py")} == {
        "driving.py",
        "drone_video.py",
        "gymnasium_loop.py",
        "heat_map.py",
        "new_style.py",
        "own_adapter.py",
        "own_benchmark.py",  # tests/test_tutorials.py
        "own_checkpoint.py",  # tests/test_tutorials.py
        "own_domain.py",
        "own_predictor.py",
        "pettingzoo_loop.py",
        "robot_loop.py",
        "traffic.py",
        "train_ppo.py",  # tests/clients/rl
    }


def test_drone_video(folder, sdd):
    out = python(folder, "drone_video.py")
    errors = [float(error) for error in re.findall(r"ADE ([\d.]+)", out)]
    assert "fitted to: 0.25-0.75, 1.25-1.75, 2.25-2.75\n" in out
    assert errors == pytest.approx([70.6, 66.6, 2.51, 2.33], rel=0.01)
    assert (folder / "drone.png").stat().st_size > 20_000


def test_heat_map(folder, sdd):
    needs_weights("heatmap")
    assert python(folder, "heat_map.py") == "Written: heat_map.png\n"
    assert (folder / "heat_map.png").stat().st_size > 20_000


def test_gymnasium_loop(folder):
    out = python(folder, "gymnasium_loop.py")
    assert float(*found(r"^ADE +(\d\.\d+) \[", out)) == pytest.approx(0.43, abs=0.05)


def test_pettingzoo_loop(folder):
    out = python(folder, "pettingzoo_loop.py")
    forecasts, matured, censored = map(int, found(r"(\d+) forecasts: (\d+) matured, (\d+) censored", out))
    assert forecasts == matured + censored and matured > 0
    assert float(*found(r"^ADE +(\d\.\d+) \[", out)) == pytest.approx(0.43, abs=0.05)


def test_own_predictor(folder):
    assert re.search(r"^Turning on orca:d=0.6.*ADE \d\.\d+ \[", python(folder, "own_predictor.py"), re.MULTILINE)
    out = motion_gym(folder, written_command("own_predictor.py") + ",scenes=100")
    assert re.search(r"own_predictor:Turning +\.\d{3}", out)


def test_own_domain(folder):
    out = python(folder, "own_domain.py")
    assert "no leak found" in out and "constant_velocity on tracks:path=" in out
    (path,) = found(r"^Next: .*:path=(.*)$", out)
    assert out == python(folder, "own_domain.py", path)
    scores = motion_gym(folder, written_command("own_domain.py").replace("FILE", path))
    assert re.search(r"constant_velocity +\.645 ", scores) and "210 agent-windows of 10 agents" in scores


def test_new_style(folder):
    said = python(folder, "new_style.py")
    found = {line.split(": ADE")[0]: float(line.split()[-2]) for line in said.splitlines()}
    plain = found["modular_invariant, 128 scenes"]
    assert plain < found["modular_invariant, 0 scenes"]
    assert found["refine, 128 scenes"] < plain and found["transfer, 128 scenes"] < plain
    assert found["refine:of=transfer, 128 scenes"] < found["transfer, 128 scenes"]


def test_traffic(folder):
    needs_highway_env()
    out = python(folder, "traffic.py")
    calm, fast = (
        float(*found(rf"^straight, {style}: constant_velocity ADE (\d\.\d+) m", out))
        for style in ("calm", "aggressive")
    )
    assert calm < fast
    vehicles, crashed = map(int, found(r"^roundabout, normal: .*; (\d+) vehicles, (\d+) crashed", out))
    assert vehicles > 3 and crashed == 0
    assert (folder / "roundabout.png").read_bytes()[:4] == b"\x89PNG"


def test_driving(folder):
    needs_highway_env()
    out = python(folder, "driving.py")
    still, oracle = (float(*found(rf"^{name}: score (\d\.\d+),", out)) for name in ("stand_still", "oracle"))
    assert 0 < still <= oracle + 0.02
    steps, score = found(r"^Written: driving.gif, (\d+) steps, score (\d\.\d+)", out)
    assert 0 < int(steps) <= 14 and 0 <= float(score) <= 1
    assert (folder / "driving.gif").read_bytes()[:6] == b"GIF89a"


def test_each_scene_has_noise_of_its_own():
    torch = pytest.importorskip("torch")
    generator = runpy.run_path(str(EXAMPLES / "own_checkpoint.py"))["generator"]
    scenes = torch.zeros(2, 8, 2), torch.ones(2, 8, 2)
    drawn = [torch.randn(4, generator=generator(seed, scene)) for scene in scenes for seed in (0, 1, 0)]
    assert torch.equal(drawn[0], drawn[2]) and torch.equal(drawn[3], drawn[5])
    assert len({tuple(values.tolist()) for values in drawn}) == 4


def test_own_adapter(folder):
    plain, adapted = python(folder, "own_adapter.py").splitlines()
    errors = [float(*found(r": ADE (\d\.\d+) \[", line)) for line in (plain, adapted)]
    assert plain.startswith("ConstantVelocity on") and adapted.startswith("Stretch on") and errors[1] < errors[0]
    assert " 0 updates" in plain and " 0 updates" not in adapted


def test_robot_loop(folder):
    pytest.importorskip("torch")
    said = python(folder, "robot_loop.py").splitlines()
    error = {line.split(":")[0]: float(*found(r"ADE (\d\.\d+) m over 120 matured", line)) for line in said}
    assert error["style"] < error["none"] and error["kalman"] < error["none"]
