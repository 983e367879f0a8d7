from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from motion_gym import catalog
from motion_gym.benchmarks.running import BENCHMARKS
from motion_gym.checks import rules
from motion_gym.cli.main import main
from motion_gym.data import datasets
from motion_gym.data.storage import data_folder
from motion_gym.metrics.errors import METRICS
from motion_gym.training import plans as training_plans

OWN = '''
import numpy as np
from motion_gym.envs.orca import Orca


class Standing:
    """Nobody moves."""

    selection = "nothing was selected"

    def predict(self, observation, samples=1, seed=0):
        return np.repeat(observation.xy[:, None, -1:], 12, axis=2)


class Flat:
    def predict(self, observation, samples=1, seed=0):
        return np.zeros((3, 3))


class Misspelt:
    def predicts(self, observation):
        return None


class Leaky(Orca):
    """Its feature is looked up in all of the recordings, the future included."""

    feature_names = ("later",)

    def features(self, history):
        track = np.concatenate([r.xy for r in Orca.recordings(self, "test")])
        rows = np.abs(track[None] - history[:, -1:]).sum(axis=2).argmin(axis=1)
        return np.repeat(track[(rows + 2) % len(track), :1][:, None], 8, axis=1)


class Broken:
    def windows(self, split):
        return None
'''


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A working folder with somebody's own classes; ``main`` puts it on the path."""
    work = tmp_path / "work"
    work.mkdir()
    (work / "own_things.py").write_text(OWN)
    monkeypatch.chdir(work)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "own_things", raising=False)
    return work


@pytest.fixture
def no_data(tmp_path, monkeypatch):
    monkeypatch.setenv("MOTION_GYM_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def call(capsys, line):
    """Run a command line in this process: what it printed, on 80 columns."""
    main(shlex.split(line))
    captured = capsys.readouterr()
    assert captured.err == ""
    assert max(map(len, captured.out.splitlines()), default=0) <= 80 or "data" in line or line.startswith("run")
    return captured.out


def fail(capsys, line):
    """Run a command line that must end with status 2 and one message."""
    with pytest.raises(SystemExit) as stopped:
        main(shlex.split(line))
    captured = capsys.readouterr()
    assert stopped.value.code == 2
    assert captured.err.startswith("error: ") and "Traceback" not in captured.err
    return captured


def shell(line, cwd, **environment):
    """Run a command line as a user does."""
    return subprocess.run(
        [sys.executable, "-m", "motion_gym", *shlex.split(line)],
        cwd=cwd,
        env={**os.environ, "COLUMNS": "80", **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def rows(out):
    """Predictor and mean ADE of each line of the printed tables."""
    return [(m[1], m[2]) for m in re.finditer(r"^  ([a-z_:]\S*)(?: \(oracle\))? +(\d*\.\d{3}) ", out, re.MULTILINE)]


def test_ls_lists_everything(capsys):
    out = call(capsys, "ls")
    for name, entry in {**catalog.DOMAINS, **catalog.PREDICTORS}.items():
        assert re.search(rf"^ *{re.escape(name)} ", out, re.MULTILINE), name
        assert entry.env_id is None or entry.env_id in out
    for name in (*BENCHMARKS, *(metric.name for metric in METRICS), "honest", "paper", *datasets.DATASETS):
        assert re.search(rf"^ *{re.escape(name)} ", out, re.MULTILINE), name


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


@pytest.mark.parametrize("changed", ["a module that is imported", "a file that is loaded", "a file that is named"])
def test_an_own_predictor_is_scored_anew_when_what_it_needs_changed(folder, changed):
    (folder / "steady.py").write_text(HELPED)
    predictor = {"a module that is imported": "steady:Steady", "a file that is loaded": "steady:FromFile"}.get(
        changed, "steady:FromFile:path=v.npy"
    )
    printed = {}
    for scale in (1.0, 3.0):
        (folder / "helper.py").write_text(f"SCALE = {scale}  {'#' * int(scale)}\n")
        for name in ("w.npy", "v.npy"):
            np.save(folder / name, scale)
        for out in ("o", f"fresh{scale}"):
            done = shell(f"score {predictor} --domain orca:scenes=20 --out {out}", folder, PYTHONDONTWRITEBYTECODE="1")
            assert done.returncode == 0, done.stderr
            printed[scale, out.rstrip("0123.")] = dict(rows(done.stdout))[predictor]
    assert printed[1.0, "o"] == printed[1.0, "fresh"] != printed[3.0, "fresh"] == printed[3.0, "o"]


def test_a_shipped_predictor_is_fitted_anew_when_the_training_file_of_an_own_domain_changed(capsys, folder):
    (folder / "own_places.py").write_text(OWN_DOMAIN)
    walkers("test.txt", 0.01)
    printed = []
    for bend in (0.01, 0.0):
        walkers("train.txt", bend)
        printed.append(dict(rows(call(capsys, "score linear --domain own_places:Mine --out o")))["linear"])
    fresh = dict(rows(call(capsys, "score linear --domain own_places:Mine --out fresh")))["linear"]
    assert printed[0] != printed[1] == fresh


def test_an_interrupted_command_is_resumed_with_its_own_runs(capsys, folder):
    line = "score own_things:Standing own_things:Flat --domain orca:scenes=20 --out o"
    fail(capsys, line)  # the second one stops the command
    path = next((folder / "o").glob("own_things_Standing*"))
    marked = {**json.loads(path.read_text()), "seconds": 12345.0}
    path.write_text(json.dumps(marked))
    resumed = fail(capsys, f"{line} --resume")
    assert "Going on with the same command, which was interrupted: its runs in o are reused." in resumed.out
    assert json.loads(path.read_text())["seconds"] == 12345.0
    fail(capsys, line)
    assert json.loads(path.read_text())["seconds"] != 12345.0
    out = call(capsys, "score own_things:Standing --domain orca:scenes=20 --out o --resume")
    assert "There is no interrupted command with these arguments in o: it begins anew." in out


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


def test_the_version_is_printed(capsys):
    assert re.fullmatch(r"motion-gym \d+\.\d+\.\d+\n", call(capsys, "--version"))


def test_an_interrupted_command_says_how_to_go_on(folder):
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "motion_gym",
            "score",
            "linear",
            "--domain",
            "orca",
            "--domain",
            "orca:d=0.6",
            "--out",
            "r",
        ],
        cwd=folder,
        env={**os.environ, "MOTION_GYM_CACHE": str(folder / "cache")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not (folder / "r" / ".command").exists():
        time.sleep(0.05)
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130 and "Traceback" not in err
    assert "Stopped." in err and "the same command with --resume goes on" in err


def test_own_classes_are_found_in_the_working_folder(capsys):
    out = call(capsys, "score own_things:Standing --domain orca:scenes=20")
    values = dict(rows(out))
    assert float(values["own_things:Standing"]) > 2
    assert "own_things:Standing: nothing was selected" in out


def test_module_and_script_start_in_a_shell(folder):
    done = shell("score own_things:Standing --domain orca:scenes=20", folder)
    assert done.returncode == 0 and done.stderr == ""
    assert dict(rows(done.stdout))["own_things:Standing"] > "2"
    failed = shell("score own_things:Standign --domain orca:scenes=20", folder)
    assert (failed.returncode, failed.stdout) == (2, "")
    assert failed.stderr.startswith("error: Module `own_things` has no `Standign`. Did you mean `Standing`?")
    assert len(failed.stderr.splitlines()) == 1


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo terminals here")
@pytest.mark.parametrize("shared", [True, False], ids=["one terminal", "table into a file"])
def test_progress_bar_and_tables_do_not_mix(folder, shared):
    ours, theirs = os.openpty()
    with (folder / "out.txt").open("w") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "motion_gym.cli.main", "score", "linear", "--domain", "orca:scenes=800"],
            cwd=folder,
            env={**os.environ, "COLUMNS": "80", "TERM": "xterm"},
            stdout=theirs if shared else out,
            stderr=theirs,
        )
        os.close(theirs)
        seen = b""
        with contextlib.suppress(OSError):  # how the end of a pseudo terminal shows
            while part := os.read(ours, 4096):
                seen += part
        os.close(ours)
        assert process.wait(60) == 0
    text = seen.decode() if shared else (folder / "out.txt").read_text()
    assert "linear on orca:d=0.3,scenes=800" in seen.decode()
    before, title, after = text.partition("\x1b[1morca:d=0.3,scenes=800" if shared else "orca:d=0.3,scenes=800\n")
    assert title and before.rpartition("\x1b[2K")[2] == ""  # the bar was erased
    assert " on orca:" not in after and len(rows(after)) == 3
    assert shared or ("\x1b" not in text and "ADE" not in seen.decode())


def test_predictor_that_fails_does_not_take_the_others_along(capsys):
    failed = fail(
        capsys,
        "score own_things:Flat stand_still --domain orca:scenes=20,d=0.1 --domain orca:scenes=20,d=0.2",
    )
    assert [name for name, _ in rows(failed.out)] == ["constant_velocity", "stand_still", "orca_oracle"] * 2
    assert failed.err.count("Flat.predict returned shape (3, 3)") == 1
    assert "(on orca:d=0.1,scenes=20, orca:d=0.2,scenes=20)" in failed.err


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("score", "No predictor was named: motion-gym score linear --domain eth"),
        ("score linear", "No domain was named: add --domain"),
        ("score linaer --domain orca", "no predictor `linaer`. Did you mean `linear`?"),
        ("score linear --domain ocra", "no domain `ocra`. Did you mean `orca`?"),
        ("score linear --domain orca:dd=3", "Domain `orca` has no parameter `dd`. Did you mean `d`?"),
        ("score linear:rigde=3 --domain orca", "Predictor `linear` has no parameter `rigde`. Did you mean `ridge`?"),
        ("score linear --domain orca:d=wide", "`d=wide` of domain `orca` must be a number"),
        ("score linear --domain orca:d", "Write `orca:key=value`"),
        ("score linear --domain orca:d=0.1,x", "`x` in `orca:d=0.1,x` is not a parameter"),
        (
            "score linear --domain orca:scenes=9 --protocol papre",
            "`protocol=papre` is not known. Did you mean `paper`",
        ),
        ("score linear --domain orca:scenes=9 --split tets", "no split `tets`. Did you mean `test`?"),
        ("score linear --domain orca:scenes=9 --k 0", "`k=0` must be a whole number, 1 or more"),
        ("score linear --domain orca:scenes=9 --seed -1", "`seed=-1` must be a whole number, 0 or more"),
        ("score nowhere:Class --domain orca", "no module `nowhere`"),
        ("score own_things:Misspelt --domain orca", "Misspelt cannot be used as predictor: it has no method `predict`"),
        ("score :X --domain orca", "`:X` is no predictor: write `module:Class`"),
        ("score orca_oracle --domain own_things:Nothing", "Module `own_things` has no `Nothing`"),
        ("check ocra", "no predictor or domain `ocra`. Did you mean `orca`?"),
        ("check own_things:Misspelt", "neither a predictor (method `predict`) nor a domain (`recordings`)"),
        ("check own_things:Flat", "Flat.predict returned shape (3, 3)"),
        ("check own_things:Broken", "Broken is neither a predictor (method `predict`) nor a domain (`recordings`)"),
        ("check linear:ridge=-1", "`ridge=-1` of linear must be a number, 0 or more"),
        ("check linear:ridge", "Write `linear:key=value`"),
        ("data add", "Which data set? motion-gym data add NAME; known: eth_ucy"),
        ("data add eth_ucy", "Where are the files? motion-gym data add eth_ucy --from DIR"),
        ("data add eth_ucy --from nowhere", "nowhere is not a folder"),
        ("data verify eth_uyc", "no data set `eth_uyc`. Did you mean `eth_ucy`?"),
        ("data fetch eth-ucy", "no data set `eth-ucy`. Did you mean `eth_ucy`?"),
    ],
)
def test_mistakes_are_one_message_and_status_2(capsys, line, message):
    assert message in fail(capsys, line).err


@pytest.mark.parametrize(
    "line", ["scroe linear", "", "data lss", "score linear --domian orca", "score linear --domain orca --k many"]
)
def test_mistakes_in_the_command_itself(capsys, line):
    with pytest.raises(SystemExit) as stopped:
        main(shlex.split(line))
    captured = capsys.readouterr()
    assert stopped.value.code == 2 and "Traceback" not in captured.err and "motion-gym" in captured.err


def test_missing_data_says_what_to_do(capsys, no_data):
    error = fail(capsys, "score linear --domain eth").err
    assert "biwi_eth.txt is missing" in error
    assert "motion-gym data fetch eth_ucy" in error and "motion-gym data add eth_ucy --from DIR" in error


def test_bug_in_a_predictor_file_is_shown(folder):
    (folder / "buggy.py").write_text("import numpy as np\nclass P:\n    x = undefined_name\n")
    done = shell("score buggy:P --domain orca:scenes=9", folder)
    assert done.returncode != 0 and "undefined_name" in done.stderr and "buggy.py" in done.stderr


def test_a_damaged_run_is_named_and_scored_anew(capsys, folder):
    line = "score stand_still --domain orca:scenes=20 --out r"
    out = call(capsys, line)
    path = next((folder / "r").glob("stand_still*"))
    path.write_text(path.read_text()[:100])
    main(shlex.split(line))
    captured = capsys.readouterr()
    assert captured.out == out and path.name in captured.err and "warning" in captured.err
    assert call(capsys, line) == out


@pytest.mark.parametrize("thing", ["linear", "constant_velocity:velocity=mean", "own_things:Standing"])
def test_check_of_a_good_predictor(capsys, thing):
    out = call(capsys, f"check {thing}")
    words = " ".join(out.split())
    assert words.startswith(f"{thing} keeps the contract of a predictor: {len(rules('predictor'))} rules checked")
    assert words.count("no leak found") == 2 and "windows clock" in words and "stream clock" in words


def test_check_of_a_good_domain(capsys):
    main(["check", "orca:scenes=6"])
    out = capsys.readouterr().out
    words = " ".join(out.split())
    assert words.startswith(f"orca:scenes=6 keeps the contract of a domain: {len(rules('domain'))} rules checked")
    assert words.count("no leak found") == 2 and "windows clock" in words and "stream clock" in words


def test_check_finds_a_feature_from_the_future(capsys):
    failed = fail(capsys, "check own_things:Leaky:scenes=6")
    assert "features: feature later" in failed.err and "which may hold the future" in " ".join(failed.err.split())


def test_data_ls(capsys, no_data):
    out = call(capsys, "data ls")
    assert out.startswith("eth_ucy  0 of 9 files here\n")
    for part in (f"folder: {no_data}/eth_ucy", "terms:  UCY: free for use", "cite:   Pellegrini", "source: "):
        assert part in out


def test_data_is_added_and_verified(capsys, eth_ucy, no_data, monkeypatch):
    source = data_folder()
    assert str(source) == str(no_data)
    monkeypatch.undo()
    source = data_folder()
    monkeypatch.setenv("MOTION_GYM_DATA", str(no_data))
    assert "9 of 9 files of eth_ucy are missing or damaged" in fail(capsys, "data verify eth_ucy").err
    out = call(capsys, f"data add eth_ucy --from {source}")
    assert out.count("  ok  ") == 9 and out.endswith("eth_ucy: all 9 files are here and whole.\n")
    assert call(capsys, "data ls").startswith("eth_ucy  9 of 9 files here\n")
    path = no_data / "eth_ucy" / "biwi_hotel.txt"
    path.write_bytes(path.read_bytes()[:-9])
    failed = fail(capsys, "data verify eth_ucy")
    assert re.search(r"damaged +\S+biwi_hotel.txt", failed.out) and failed.out.count("  ok  ") == 8
    assert "1 of 9 files" in failed.err and "motion-gym data fetch eth_ucy" in failed.err


def test_fetch_has_nothing_to_do_where_all_is_here(capsys, eth_ucy, monkeypatch):
    monkeypatch.setenv("HTTPS_PROXY", "http://127.0.0.1:9")
    assert "all 9 files are here and whole" in call(capsys, "data fetch eth_ucy")


def test_fetch_without_a_network_says_what_else_to_do(capsys, no_data, monkeypatch):
    monkeypatch.setenv("HTTPS_PROXY", "http://127.0.0.1:9")
    monkeypatch.setenv("https_proxy", "http://127.0.0.1:9")
    monkeypatch.delenv("NO_PROXY", raising=False)
    monkeypatch.delenv("no_proxy", raising=False)
    error = fail(capsys, "data fetch eth_ucy").err
    assert "biwi_eth.txt could not be downloaded" in error and "motion-gym data add eth_ucy --from DIR" in error
    assert not list(no_data.rglob("*.txt"))


def test_help_names_every_command_and_option(capsys):
    for line, words in {
        "--help": ["score", "run", "adapt", "train", "ls", "check", "draw", "data"],
        "score --help": ["PREDICTOR", "--domain", "--k", "--protocol", "--split", "--seed", "--out"],
        "data --help": ["ls,add,fetch,verify", "--from"],
    }.items():
        with pytest.raises(SystemExit) as stopped:
            main(shlex.split(line))
        assert stopped.value.code == 0
        out = capsys.readouterr().out
        assert [word for word in words if word not in out] == []


@pytest.mark.parametrize("file", ["scene.svg", "folder/scene.png", "scene.pdf"])
def test_a_scene_is_drawn_with_forecasts(capsys, file):
    many = [f"constant_velocity:velocity={n}" for n in range(1, 8)] if file == "scene.svg" else []
    predictors = [*many, "linear", "stand_still", "kalman_velocity", "constant_velocity"]
    rows = " ".join(f"--predictor {predictor}" for predictor in predictors)
    line = f"draw orca:scenes=40 {rows} --scene 3 --out {file}"
    assert f"Written: {file}" in call(capsys, line)
    content = Path(file).read_bytes()
    assert content.startswith({".svg": b"<?xml", ".png": b"\x89PNG", ".pdf": b"%PDF"}[Path(file).suffix])
    if file == "scene.svg":  # the same command gives the same file
        call(capsys, line)
        assert Path(file).read_bytes() == content


@pytest.fixture
def small_training(monkeypatch):
    """A benchmark that is trained for in seconds, on simulated crowds."""
    small = training_plans.Training("orca:scenes=70", options={"epochs": (1, 1, 2)})
    monkeypatch.setattr(training_plans, "trainings", lambda: {"small": small})


def test_train_then_score(small_training, capsys):
    again = "train erm_no_sigma --benchmark small --seeds 0,2 --every 1 --out own"
    said = call(capsys, again)
    path = Path("own/small/erm_no_sigma.safetensors")
    assert f"Written: {path}\n2 seeds in" in said and "validation ADE" in said
    card = json.loads(path.with_suffix(".json").read_text())
    assert card["seeds"] == [0, 2] and len(card["validation_ade"]) == 2 and card["training"]["epochs"] == [1, 1, 2]
    assert all(len(part["sha256"]) == 64 for part in card["training"]["train"])
    assert "erm_no_sigma" in call(capsys, f"score erm_no_sigma --weights {path} --domain orca:scenes=40")
    # Weights are not replaced, even where their checkpoint is gone.
    path.with_suffix(".checkpoint").rename("kept")
    assert f"{path} is there already" in fail(capsys, again).err
    Path("kept").rename(path.with_suffix(".checkpoint"))
    # A finished training goes on where it ended.
    assert "is there already: add --resume to go on" in fail(capsys, again).err
    call(capsys, f"{again} --resume --epochs 1 1 3")
    assert json.loads(path.with_suffix(".json").read_text())["curve"][-1]["epoch"] == 5
    other = fail(capsys, f"{again} --resume --epochs 2 1 3").err
    assert "another configuration (epochs_before: [1, 1], now [2, 1])" in other


def test_a_second_training_of_the_same_weights_is_refused_until_the_first_ends(small_training, capsys):
    code = """
import sys
from motion_gym.training import plans
plans.trainings = lambda: {"small": plans.Training("orca:scenes=70")}
from motion_gym.cli.main import main
main(sys.argv[1:])
"""
    line = "train erm_no_sigma --benchmark small --out own"
    lock = Path("own/small/erm_no_sigma.lock")
    long = f"{line} --seeds 0 --epochs 9999 1 1 --every 99999"
    with subprocess.Popen([sys.executable, "-c", code, *shlex.split(long)], stderr=subprocess.PIPE) as first:
        try:
            while not (lock.exists() and lock.read_text()):
                assert first.poll() is None, first.stderr.read()
                time.sleep(0.05)
            message = fail(capsys, f"{line} --seeds 1").err
            assert f"own/small/erm_no_sigma is being trained by process {first.pid} on" in message
        finally:
            first.kill()
    assert lock.exists()  # a killed process leaves the file, and locks nothing
    call(capsys, f"{line} --seeds 1")
    assert json.loads(lock.with_suffix(".json").read_text())["seeds"] == [1]
    assert not lock.exists()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("train linear --benchmark small", "is not trained in epochs"),
        ("train constant_velocity --benchmark small", "is not trained in epochs"),
        ("score vrexx --weights spurious --domain eth", "There is no predictor `vrexx`"),
        ("train erm --benchmark small", "erm is given sigma, and this domain has x and y alone"),
        ("train erms --benchmark small", "Did you mean `erm`"),
        ("train erm --benchmark smal", "Did you mean `small`"),
        ("train erm_no_sigma --benchmark small --seeds 0-x", "cannot be read: write 0-4"),
        ("train erm_no_sigma --benchmark small --seeds 1,1", "each once"),
        ("train erm_no_sigma --benchmark small --seeds 4-1", "at least one seed"),
        (
            "train motion_gym.predictors.stgat:Invariant:penalty=-1 --benchmark small",
            "`penalty=-1` must be a number, 0 or more",
        ),
        ("train erm:sigma=maybe --benchmark small", "must be true, false or relative"),
        ("train erm_no_sigma --benchmark small --epochs 1 1 0", "at least one epoch"),
        ("train erm_no_sigma --benchmark small --seeds 0-99999999999", "names more than 1000 seeds"),
        ("train erm_no_sigma --benchmark small --epochs 3", "must be a list of 3 for erm_no_sigma"),
        ("train ego_erm --benchmark small --epochs 1 1", "must be a list of 1 for ego_erm"),
        ("train style_erm --benchmark small", "must be a list of 1 for style_erm"),
        ("import-weights none.pth.tar --predictor vrex", "has no weights of the released program"),
        ("train erm_no_sigma --benchmark small --every 0", "`every=0` must be a whole number"),
        ("run spurios", "Did you mean `spurious`"),
        ("score linear --weights spurious --domain eth", "none of linear has weights"),
        ("score erm --weights spurios --domain eth:alpha=8", "Did you mean `spurious`"),
        ("score erm --weights a.safetensors --domain eth:alpha=8", "There is no file a.safetensors"),
        ("import-weights none.pth.tar --predictor linear", "has no weights of the released program"),
        ("import-weights none.pth.tar --predictor erm", "There is no file none.pth.tar"),
        ("import-weights a.pth.tar --predictor erm --out a.pt", "must end in .safetensors"),
    ],
)
def test_what_cannot_be_trained_scored_or_imported_is_said(small_training, line, message, capsys, tmp_path):
    folder = tmp_path / "out"
    out = f" --out {folder}" if line.startswith(("train", "run")) else ""
    assert message in fail(capsys, line + out).err
    assert not folder.exists()
