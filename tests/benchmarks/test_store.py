"""The store of runs: identity, files, packing, and what becomes of files that are not runs."""

import json
import os
import subprocess
import sys
import textwrap
import time
import warnings

import numpy as np
import pytest

import motion_gym
from motion_gym.benchmarks import store as stores
from motion_gym.benchmarks.identity import QUESTION, windows_identity
from motion_gym.benchmarks.jobs import Job, Runner
from motion_gym.benchmarks.run_schema import problem_of
from motion_gym.benchmarks.store import Store, read_folder
from motion_gym.contract import DataError
from motion_gym.scoring.evaluation import evaluate
from tests.hostile import TEXTS

CROWD = motion_gym.domain("orca", d=0.6, scenes=30)


class Standing:
    """A predictor of a user."""

    def predict(self, observation, samples=1, seed=0):
        return np.repeat(observation.xy[:, None, None, -1], 12, axis=2)


def scored(store, predictor="stand_still", domain=CROWD, **options):
    """The run of a score; computed and written if the store has none."""
    identity = windows_identity(predictor, domain, **options)
    options.pop("session", None)
    job = Job("", (), "row", "", [identity], lambda: [evaluate(predictor, domain, **options).as_dict()])
    (runs,) = Runner(store).rows([job]).values()
    return runs[0]


def only(folder):
    (path,) = folder.glob("*.json")
    return path


def test_a_run_holds_its_result_its_identity_and_its_provenance(tmp_path):
    run = scored(Store(None, tmp_path), "linear", k=2, seed=3)
    kept = json.loads(only(tmp_path).read_bytes(), parse_constant=pytest.fail)
    assert kept == json.loads(json.dumps(run)) == read_folder(tmp_path)[0]
    assert kept["schema"] == stores.SCHEMA and problem_of(kept) == ""
    identity = kept["identity"]
    assert (identity["predictor"], identity["k"], identity["seed"], identity["session"]) == ("linear", 2, 3, None)
    assert identity["domain"] == "orca:d=0.6,agents=2,radius=5.0,horizon=2.0,speed=1.0,seed=0,scenes=30"
    assert identity["data"] == {"engine of orca": "1"} and identity["versions"] == {"linear": 1, "orca": 1}
    assert kept["provenance"]["command"] == sys.argv[1:] and kept["provenance"]["commit"]
    assert set(kept["provenance"]["versions"]) >= {"python", "numpy", "torch", "motion-gym"}
    assert kept["metrics"]["ADE"]["low"] <= kept["metrics"]["ADE"]["mean"] <= kept["metrics"]["ADE"]["high"]


def test_data_files_and_shipped_weights_are_a_part_of_the_identity():
    identity = windows_identity("erm:weights=spurious,seed=1", motion_gym.domain("eth:alpha=64"))
    assert identity["data"]["biwi_eth.txt"] == "cf8d3fd342a15f409ebc2a1fc76b91a0f06390bd21f1e11410f3859331ab082b"
    assert "biwi_hotel.txt" in identity["data"]  # a source
    card = json.loads((stores.SHIPPED.parent / "weights" / "spurious" / "erm.json").read_text())
    assert identity["weights"] == {"erm:weights=spurious,seed=1": card["sha256"]}
    around = windows_identity("refine:of=modular,weights=style,seed=0", CROWD)
    assert around["versions"] == {"refine": 1, "modular": 1, "orca": 1} and len(around["weights"]) == 1


def test_a_run_that_is_there_is_not_computed_again(tmp_path):
    first = scored(Store(None, tmp_path))
    path = only(tmp_path)
    path.write_text(json.dumps({**first, "seconds": 12345.0}))  # what is in the file is what counts
    assert scored(Store(None, tmp_path))["seconds"] == 12345.0


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
def test_another_question_is_another_run(tmp_path, predictor, domain, options):
    kept = Store(None, tmp_path)
    scored(kept, "constant_velocity")
    scored(kept, predictor, domain, **options)
    assert len(list(tmp_path.glob("*.json"))) == len(kept.runs) == 2


@pytest.mark.parametrize("changed", ["version of the predictor", "version of the domain", "weights", "data", "scoring"])
def test_a_run_is_computed_again_when_what_determines_it_changed(tmp_path, monkeypatch, changed):
    predictor, domain = "style_erm:weights=style,seed=0", CROWD.replace()
    before = windows_identity(predictor, domain)
    kept = Store(None, tmp_path)
    kept.take([stores.run_of(before, {})])
    assert kept.find(windows_identity(predictor, CROWD.replace())) is not None
    identity = "motion_gym.benchmarks.identity"
    if changed == "version of the predictor":
        monkeypatch.setattr(f"{identity}.VERSIONS", {"style_erm": 2})
    elif changed == "version of the domain":
        monkeypatch.setattr(type(domain), "version", 2, raising=False)
    elif changed == "weights":
        monkeypatch.setattr(f"{identity}.shipped_card", lambda weights, row: {"sha256": "other"})
    elif changed == "data":
        monkeypatch.setattr(type(domain), "engine", 2)
    else:
        monkeypatch.setattr(f"{identity}.SCORING_VERSION", before["scoring_version"] + 1)
    assert kept.find(windows_identity(predictor, CROWD.replace())) is None


def test_own_predictors_and_domains_are_reused_by_their_session_alone():
    class Mine:
        def predict(self, observation, samples=1, seed=0):
            raise AssertionError

    class Own(type(CROWD)):
        name = "own"

    for predictor, domain in (
        ("somewhere:Mine", CROWD),
        (Mine(), CROWD),
        ("erm:weights=mine.safetensors", CROWD),
        ("refine:of=somewhere:Mine", CROWD),
        ("linear", Own()),
    ):
        one, other = (windows_identity(predictor, domain, session=session) for session in ("a", "b"))
        assert one["session"] == "a" != other["session"]
    assert windows_identity("linear", CROWD, session="a") == windows_identity("linear", CROWD, session="b")


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


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("", "Expecting value"),
        ('{"schema": 3', "Expecting"),
        ("[]", "not a result of motion-gym"),
        ('{"schema": 3, "identity": {"kind": "windows"}}', "it has no `identity.scoring_version`"),
        ('{"schema": 9, "identity": {"kind": "windows"}}', "its schema is 9"),
        ('{"schema": 2, "predictor": "linear"}', "of another version of motion-gym: its schema is 2"),
        ("NaN", "NaN is not JSON"),
    ],
)
def test_a_file_that_is_no_run_is_named_skipped_and_left(tmp_path, content, problem):
    scored(Store(None, tmp_path))
    foreign = tmp_path / "foreign.json"
    foreign.write_text(content)
    with pytest.warns(RuntimeWarning, match="left as they are") as warned:
        runs = read_folder(tmp_path)
    message = str(warned[0].message)
    assert len(runs) == 1 and "foreign.json" in message and problem in message and "elete" not in message
    assert foreign.read_text() == content


@pytest.mark.parametrize("key", ["selection", "metrics", "leaks", "identity"])
def test_a_run_that_lacks_a_key_is_named_and_the_others_are_read(tmp_path, key):
    kept = Store(None, tmp_path)
    scored(kept)
    run = scored(kept, "constant_velocity")
    path = next(tmp_path.glob("constant_velocity*"))
    path.write_text(json.dumps({name: value for name, value in run.items() if name != key}))
    with pytest.warns(RuntimeWarning, match=key if key != "identity" else "not a result"):
        (left,) = read_folder(tmp_path)
    assert left["predictor"] == "stand_still"


def test_hidden_files_of_other_systems_are_no_runs(tmp_path):
    scored(Store(None, tmp_path))
    (tmp_path / "._x.json").write_bytes(b"\x00\x05\x16\x07")
    with pytest.warns(RuntimeWarning, match=r"\._x\.json"):
        assert len(read_folder(tmp_path)) == 1


def test_packed_runs_are_the_same_and_their_small_files_go(tmp_path):
    folder = tmp_path / "small"
    kept = Store("small", folder, shipped=tmp_path / "nowhere")
    scored(kept, k=20)
    scored(kept, "linear")
    own = scored(kept, Standing(), session="a")
    runs = dict(kept.runs)
    path = kept.pack(tmp_path)
    first = path.read_bytes()
    assert [json.loads(p.read_text()) for p in folder.glob("*.json")] == [own]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = Store("small", folder, shipped=tmp_path / "nowhere")
    assert again.runs == runs
    os.utime(path)
    again.pack(tmp_path)
    assert path.read_bytes() == first  # no time in it


def test_packing_keeps_the_runs_that_another_process_has_packed_since(tmp_path):
    first, second = (Store("small", tmp_path / "small", shipped=tmp_path / "nowhere") for _ in range(2))
    scored(first)
    scored(second, "constant_velocity")
    first.pack(tmp_path)
    second.pack(tmp_path)
    names = {run["predictor"] for run in Store("small", tmp_path / "small", shipped=tmp_path / "nowhere").runs.values()}
    assert names == {"stand_still", "constant_velocity"} and not list((tmp_path / "small").glob("*.json"))


@pytest.mark.parametrize("text", TEXTS)
def test_a_run_lies_in_its_folder_whatever_its_name(tmp_path, text):
    identity = {"kind": "windows", "predictor": text, "domain": text}
    path = stores.path_of(tmp_path, {**dict.fromkeys(QUESTION["windows"]), **identity})
    assert path.parent == tmp_path and len(path.name) < 200 and path.suffix == ".json"


def test_a_value_of_another_type_is_named(tmp_path):
    run = scored(Store(None, tmp_path))
    for key, value, problem in (
        ("finished", True, "no text"),
        ("command", {}, "no list"),
        ("versions", 3, "no object"),
    ):
        changed = {**run, "provenance": {**run["provenance"], key: value}}
        assert problem_of(changed) == f"its `provenance.{key}` is {problem}"
    assert problem_of({**run, "seconds": "1"}) == "its `seconds` is no number"
    assert (
        problem_of({**run, "k": -1}) == problem_of({**run, "k": 10**400}) == "its `k` is no whole number of 0 or more"
    )
    assert problem_of({**run, "leaks": [1]}) == "an item of its `leaks` is not of type str"
    assert problem_of({**run, "versus": {"ade": 1}}) == "an item of its `versus` is not of type dict"
    for name, summary in (("ADE", {**run["metrics"]["ADE"], "mean": None}), ("KDE_NLL_20", [[1]])):
        assert f"`metrics.{name}.mean`" in problem_of({**run, "metrics": {**run["metrics"], name: summary}})


def test_a_damaged_packed_file_is_an_error_that_names_it(tmp_path):
    (tmp_path / "small.jsonl.xz").write_bytes(b"nonsense")
    with pytest.raises(DataError, match=r"small\.jsonl\.xz cannot be read"):
        Store("small", None, shipped=tmp_path)


def test_only_the_same_interrupted_command_is_resumed(tmp_path):
    arguments = ["score", "mine:Mine"]
    session, resumed = stores.begin(tmp_path, arguments, resume=False)
    assert not resumed and stores.begin(tmp_path, arguments, resume=True) == (session, True)
    assert not stores.begin(tmp_path, [*arguments, "other"], resume=True)[1]
    stores.end(tmp_path)
    again, resumed = stores.begin(tmp_path, arguments, resume=True)
    assert not resumed and again != session  # it had ended


def test_a_full_disk_leaves_nothing_half_written(tmp_path):
    code = """
        import resource, signal, sys
        from pathlib import Path
        import motion_gym
        from motion_gym.benchmarks.identity import windows_identity
        from motion_gym.benchmarks.jobs import Job, Runner
        from motion_gym.benchmarks.store import Store
        domain = motion_gym.domain("orca", d=0.6, scenes=30)
        domain.windows("test")  # cached while there was room
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
        store, identity = Store(None, Path(sys.argv[1])), windows_identity("stand_still", domain)
        runner = Runner(store)
        compute = lambda: [motion_gym.evaluate("stand_still", domain).as_dict()]
        runner.rows([Job("", (), "", "", [identity], compute)])
        print(*runner.unwritten, store.find(identity)["metrics"]["ADE"]["mean"] > 0)
    """
    message = python(code, tmp_path / "out", cwd=tmp_path)
    assert "could not be written: File too large" in message and "stand_still--orca" in message
    assert message.endswith("True\n")
    assert list((tmp_path / "out").iterdir()) == []


def test_a_killed_sweep_leaves_whole_files_and_goes_on(tmp_path):
    sweep = """
        import sys
        from pathlib import Path
        import motion_gym
        from motion_gym.benchmarks.identity import windows_identity
        from motion_gym.benchmarks.jobs import Job, Runner
        from motion_gym.benchmarks.store import Store
        runner = Runner(Store(None, Path(sys.argv[1])))
        for d in (0.1, 0.2, 0.3, 0.4, 0.5):
            place = motion_gym.domain("orca", d=d, scenes=10)
            compute = lambda: [motion_gym.evaluate("linear", place).as_dict()]
            runner.rows([Job("", (), "", "", [windows_identity("linear", place)], compute)])
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
    assert 2 <= len(done) <= 5 and len(read_folder(tmp_path)) == len(done)
    python(sweep, tmp_path, cwd=tmp_path)
    after = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.json")}
    assert len(after) == 5 and done.items() <= after.items()


def test_a_file_left_by_a_killed_write_is_removed_when_it_is_old(tmp_path):
    old, young, foreign = (tmp_path / f".a.json.{'0' * 15}{n}.tmp" for n in "123")
    foreign = tmp_path / ".mine.tmp"
    for path in (old, young, foreign):
        path.touch()
    for path in (old, foreign):
        os.utime(path, (time.time() - 7200,) * 2)
    scored(Store(None, tmp_path))
    assert not old.exists() and young.exists() and foreign.exists()
