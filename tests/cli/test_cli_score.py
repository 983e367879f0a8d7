"""The command that scores predictors on domains."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from motion_gym.cli.main import main
from tests.cli.command_line import call, fail, rows, shell


def test_score_stands_between_constant_velocity_and_the_oracle(capsys):
    out = call(capsys, "score stand_still linear --domain orca:d=0.6,scenes=40")
    assert [name for name, _ in rows(out)] == ["constant_velocity", "stand_still", "linear", "orca_oracle"]
    assert "orca_oracle (oracle)" in out and "protocol honest, k = 1" in out
    assert float(rows(out)[3][1]) < 0.005 < float(rows(out)[0][1]) < float(rows(out)[1][1])


def test_score_several_domains(capsys):
    out = call(capsys, "score stand_still --domain orca:scenes=20,d=0.1 --domain orca:scenes=20,d=0.6")
    assert out.index("orca:d=0.1,scenes=20") < out.index("orca:d=0.6,scenes=20")
    assert len(rows(out)) == 6
    assert out.count("95 % \nintervals") + out.count("95 % intervals") == 1  # said once, for all tables


def test_score_with_samples_of_the_paper(capsys):
    out = call(capsys, "score stand_still --domain orca:scenes=20 --protocol paper")
    assert "protocol paper, k = 20" in out and "minADE/FDE_20" in out and "JADE/JFDE_20" in out
    assert "k = 3;" in call(capsys, "score stand_still --domain orca:scenes=20 --k 3")


def test_honest_score_counts_agents_who_are_alone_too(capsys, eth_ucy):
    out = call(capsys, "score stand_still --domain eth")
    assert "181 agent-windows of 36 agents in 70 scenes" in out
    assert "eth:min_agents=1" in out and "364 agent-windows of 44 agents in 253 scenes" in out
    assert ("constant_velocity", ".995") in rows(out)
    out = call(capsys, "score stand_still --domain eth --protocol paper")
    assert "min_agents=1" not in out


def test_side_channel_is_named_under_its_table(capsys, eth_ucy):
    out = call(capsys, "score stand_still --domain hotel:alpha=8 --domain hotel")
    first, second = out.split("\nhotel\n")
    assert first.count("oracle side channel: sigma reads the future") == 2 and "side channel" not in second


def test_out_keeps_runs_and_skips_those_that_are_there(capsys, folder):
    line = "score stand_still --domain orca:scenes=20 --out results/a"
    out = call(capsys, line)
    assert "Results are in results/a." in out
    files = sorted((folder / "results" / "a").glob("*.json"))
    assert [path.name.partition("--")[0] for path in files] == ["constant_velocity", "orca_oracle", "stand_still"]
    kept = json.loads(files[2].read_text())
    mean = f"{kept['metrics']['ADE']['mean']:.3f}"
    assert ("stand_still", mean.removeprefix("0")) in rows(out)
    times = [path.stat().st_mtime_ns for path in files]
    assert call(capsys, line) == out
    assert [path.stat().st_mtime_ns for path in files] == times


HELPED = """
import numpy as np
from helper import SCALE


class Steady:
    selection = "nothing was selected"

    def predict(self, observation, samples=1, seed=0):
        steps = SCALE * np.arange(1, 13, dtype=np.float32)[:, None]
        return observation.xy[:, None, None, -1] + steps * np.float32(0.1)


class FromFile:
    def __init__(self, path="w.npy"):
        self.path, self.scale = path, float(np.load(path))

    def predict(self, observation, samples=1, seed=0):
        return np.repeat(observation.xy[:, None, None, -1], 12, axis=2) + np.float32(self.scale)
"""


OWN_DOMAIN = """
import motion_gym


class Mine(motion_gym.RecordedDomain):
    name = "mine"
    splits = ("train", "val", "test")

    def recordings(self, split):
        return [motion_gym.read_recording(f"{'test' if split == 'test' else 'train'}.txt", dt=0.4)]

    def sources(self):
        return [self]
"""


def walkers(path, bend):
    """Ten people who walk side by side and turn a little more at each step."""
    lines = [
        f"{10 * t}\t{n + 1}\t{0.4 * t:.3f}\t{2 * n + bend * t * t * (1 + 0.1 * n):.3f}"
        for t in range(30)
        for n in range(10)
    ]
    Path(path).write_text("\n".join(lines) + "\n")


def test_an_own_predictor_is_scored_anew_when_a_module_that_it_imports_changed(folder):
    (folder / "steady.py").write_text(HELPED)

    def score(scale, out):
        (folder / "helper.py").write_text(f"SCALE = {scale}  {'#' * int(scale)}\n")
        line = f"score steady:Steady --domain orca:scenes=20 --out {out}"
        done = shell(line, folder, PYTHONDONTWRITEBYTECODE="1")
        assert done.returncode == 0, done.stderr
        return dict(rows(done.stdout))["steady:Steady"]

    assert score(1.0, "kept") != score(3.0, "kept") == score(3.0, "new")


@pytest.mark.parametrize("predictor", ["steady:FromFile", "steady:FromFile:path=v.npy"])
def test_an_own_predictor_is_scored_anew_when_a_file_that_it_loads_changed(capsys, folder, monkeypatch, predictor):
    (folder / "steady.py").write_text(HELPED)
    (folder / "helper.py").write_text("SCALE = 1.0\n")
    for module in ("steady", "helper"):
        monkeypatch.delitem(sys.modules, module, raising=False)

    def score(scale, out):
        for name in ("w.npy", "v.npy"):
            np.save(folder / name, scale)
        return dict(rows(call(capsys, f"score {predictor} --domain orca:scenes=20 --out {out}")))[predictor]

    assert score(1.0, "kept") != score(3.0, "kept") == score(3.0, "new")


def test_a_shipped_predictor_is_fitted_anew_when_the_training_file_of_an_own_domain_changed(capsys, folder):
    (folder / "own_places.py").write_text(OWN_DOMAIN)
    walkers("test.txt", 0.01)
    printed = []
    for bend in (0.01, 0.0):
        walkers("train.txt", bend)
        printed.append(dict(rows(call(capsys, "score linear --domain own_places:Mine --out o", "warning: ")))["linear"])
    fresh = dict(rows(call(capsys, "score linear --domain own_places:Mine --out fresh", "warning: ")))["linear"]
    assert printed[0] != printed[1] == fresh


def test_an_interrupted_command_is_resumed_with_its_own_runs(capsys, folder):
    line = "score own_things:Standing own_things:Flat --domain orca:scenes=20 --out o"
    fail(capsys, line)  # the second one stops the command
    path = next((folder / "o").glob("own_things_Standing*"))
    marked = {**json.loads(path.read_text()), "seconds": 12345.0}
    path.write_text(json.dumps(marked))
    resumed = fail(capsys, f"{line} --resume")
    assert "Going on with the same command, which was interrupted: its runs in o are reused." in resumed.err
    assert json.loads(path.read_text())["seconds"] == 12345.0
    fail(capsys, line)
    assert json.loads(path.read_text())["seconds"] != 12345.0
    anew = "There is no interrupted command with these arguments in o: it begins anew."
    call(capsys, "score own_things:Standing --domain orca:scenes=20 --out o --resume", anew)


def test_scores_are_printed_although_they_cannot_be_written(capsys, folder):
    (folder / "r").touch()
    failed = fail(capsys, "score stand_still --domain orca:scenes=20 --out r/a")
    assert "r/a" in failed.err and ("r" in failed.err)
    read_only = folder / "full"
    done = shell_with_full_disk("score stand_still --domain orca:scenes=20 --out full", folder)
    assert done.returncode == 2 and "could not be written: File too large" in done.stderr
    assert [name for name, _ in rows(done.stdout)] == ["constant_velocity", "stand_still", "orca_oracle"]
    assert not list(read_only.glob("*.json"))


def shell_with_full_disk(line, cwd):
    """Run a command line where no file can grow beyond 1,000 bytes, with what it reads cached before."""
    code = (
        "import resource, signal, sys, motion_gym; motion_gym.domain('orca:scenes=20').windows('test'); "
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)); "
        "from motion_gym.cli.main import main; main(sys.argv[1:])"
    )
    return subprocess.run(
        [sys.executable, "-c", code, *shlex.split(line)],
        cwd=cwd,
        env={**os.environ, "COLUMNS": "80"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_own_classes_are_found_in_the_working_folder(capsys):
    out = call(capsys, "score own_things:Standing --domain orca:scenes=20")
    values = dict(rows(out))
    assert float(values["own_things:Standing"]) > 2
    assert "own_things:Standing: nothing was selected" in out


def test_predictor_that_fails_does_not_take_the_others_along(capsys):
    failed = fail(
        capsys,
        "score own_things:Flat stand_still --domain orca:scenes=20,d=0.1 --domain orca:scenes=20,d=0.2",
    )
    assert [name for name, _ in rows(failed.out)] == ["constant_velocity", "stand_still", "orca_oracle"] * 2
    assert failed.err.count("Flat.predict returned shape (3, 3)") == 1
    assert "Not shown: own_things:Flat (orca:d=0.1,scenes=20; orca:d=0.2,scenes=20): " in failed.err


def test_a_damaged_run_is_named_and_scored_anew(capsys, folder):
    line = "score stand_still --domain orca:scenes=20 --out r"
    out = call(capsys, line)
    path = next((folder / "r").glob("stand_still*"))
    path.write_text(path.read_text()[:100])
    main(shlex.split(line))
    captured = capsys.readouterr()
    assert captured.out == out and path.name in captured.err and "warning" in captured.err
    assert call(capsys, line) == out


def test_a_predictor_that_changes_the_folder_does_not_move_the_results(folder):
    code = (
        "import os\nfrom motion_gym.predictors.stand_still import StandStill\n"
        "class Mover(StandStill):\n    def predict(self, *given, **more):\n        os.makedirs('deep', exist_ok=True)\n"
        "        os.chdir('deep')\n        return super().predict(*given, **more)\n"
    )
    (folder / "mover.py").write_text(code)
    arguments = ["score", "mover:Mover", "--domain", "orca:d=0.6,scenes=6", "--out", "results"]
    run = subprocess.run([sys.executable, "-m", "motion_gym", *arguments], capture_output=True, text=True, cwd=folder)
    assert run.returncode == 0, run.stderr
    assert list((folder / "results").glob("Mover*.json")) or list((folder / "results").glob("mover*.json"))


@pytest.mark.parametrize("columns", ["0", "5", "20"])
def test_tables_are_readable_where_the_width_is_not_known(columns, folder):
    run = subprocess.run(
        [sys.executable, "-m", "motion_gym", "score", "linear", "--domain", "orca:d=0.6,scenes=20"],
        capture_output=True, text=True, env={**os.environ, "COLUMNS": columns},
    )  # fmt: skip
    assert run.returncode == 0 and "constant_velocity" in run.stdout
