"""The command line as a whole: help, errors, interruptions and terminals."""

import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
import time

import pytest

from motion_gym import catalog
from motion_gym.benchmarks.running import BENCHMARKS
from motion_gym.cli.main import OWN_CODE, main
from motion_gym.data import datasets
from motion_gym.metrics.errors import METRICS
from tests.cli.command_line import call, fail, rows, shell


def test_ls_lists_everything(capsys):
    out = call(capsys, "ls")
    for name, entry in {**catalog.DOMAINS, **catalog.PREDICTORS}.items():
        assert re.search(rf"^ *{re.escape(name)} ", out, re.MULTILINE), name
        assert entry.env_id is None or entry.env_id in out
    for name in (*BENCHMARKS, *(metric.name for metric in METRICS), "honest", "paper", *datasets.DATASETS):
        assert re.search(rf"^ *{re.escape(name)} ", out, re.MULTILINE), name


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


def test_no_module_of_the_working_folder_is_imported_unless_an_argument_names_one(folder, tmp_path):
    """As the installed script starts, in a folder with a file that has the name of a library."""
    (folder / "jsonschema.py").write_text("raise SystemExit('harm')")
    (tmp_path / "start.py").write_text("from motion_gym.cli.main import main\nmain()")
    (folder / "a.json").write_text("{}")
    for line, status in (("validate a.json", 1), ("score own_things:Standing --domain orca:scenes=20", 0)):
        command = [sys.executable, tmp_path / "start.py", *shlex.split(line)]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == status and "harm" not in done.stderr, done.stderr


@pytest.mark.parametrize("text", ["own:Class", "finetune:of=own:Class", "--predictor=own:Class", "a.b:C:x=1"])
def test_arguments_that_name_code_are_known(text):
    assert OWN_CODE.search(text)
    assert not any(map(OWN_CODE.search, ("orca:d=0.6", "linear:sigma=true", "kalman:of=modular:seed=1", "out/x.json")))


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


@pytest.mark.parametrize("line", ["", "data lss", "score linear --domian orca", "score linear --domain orca --k many"])
def test_mistakes_in_the_command_itself(capsys, line):
    with pytest.raises(SystemExit) as stopped:
        main(shlex.split(line))
    captured = capsys.readouterr()
    assert stopped.value.code == 2 and "Traceback" not in captured.err and "motion-gym" in captured.err


def test_bug_in_a_predictor_file_is_shown(folder):
    (folder / "buggy.py").write_text("import numpy as np\nclass P:\n    x = undefined_name\n")
    done = shell("score buggy:P --domain orca:scenes=9", folder)
    assert done.returncode != 0 and "undefined_name" in done.stderr and "buggy.py" in done.stderr


def test_help_names_every_command_and_option(capsys):
    for line, words in {
        "--help": ["score", "run", "adapt", "train", "ls", "check", "show", "data"],
        "score --help": ["PREDICTOR", "--domain", "--k", "--protocol", "--split", "--seed", "--out"],
        "data --help": ["ls,add,fetch,verify", "--from"],
    }.items():
        with pytest.raises(SystemExit) as stopped:
            main(shlex.split(line))
        assert stopped.value.code == 0
        out = capsys.readouterr().out
        assert [word for word in words if word not in out] == []
