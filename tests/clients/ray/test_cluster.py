"""Benchmarks on a real Ray cluster of this machine: a head without CPUs, and two nodes of one CPU each."""

import collections
import json
import os
import subprocess
import sys
import time

import pytest
import torch
from ray.cluster_utils import Cluster

OWN = '''
import os
import time
from pathlib import Path

import numpy as np

from motion_gym.benchmarks.objects import Benchmark, Part

CALLS = Path({calls!r})
SMALL = Benchmark(
    "small",
    "Small crowds of different sizes",
    [Part("Small crowds", {{str(n): f"orca:d=0.3,scenes={{n}}" for n in range(20, 32, 2)}}, ("linear",))],
)
ONE = Benchmark("one", "One crowd", [Part("One crowd", {{"20": "orca:d=0.3,scenes=20"}}, ("constant_velocity",))])


class Paced:
    """Walks on at a pace that a file of the working folder holds; takes its time, and writes each call down."""

    def predict(self, observation, samples=1, seed=0):
        if observation.scenes > 1:
            with open(CALLS, "a") as file:
                print(observation.scenes, __file__, os.environ.get("CUDA_VISIBLE_DEVICES", ""), sep=",", file=file)
            time.sleep(0.5)
        xy = observation.xy
        pace = float(Path("pace.txt").read_text()) * np.arange(1, 13, dtype=np.float32)[:, None]
        return (xy[:, -1:] + pace * (xy[:, -1] - xy[:, -2])[:, None])[:, None]


class Broken(Paced):
    def predict(self, observation, samples=1, seed=0):
        raise ValueError("a wall is in the way")


class Crash(Paced):
    def predict(self, observation, samples=1, seed=0):
        os._exit(1)
'''
NODE = {"object_store_memory": 100 * 2**20}
COLUMNS = 6
SWEEP = "my:SMALL --predictor my:Paced --out out --executor ray --address "


@pytest.fixture(scope="module")
def cluster():
    started = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, **NODE})
    yield started
    started.shutdown()


@pytest.fixture
def nodes(cluster):
    """Two nodes of one CPU, whatever the test before left."""
    while len(cluster.worker_nodes) < 2:
        cluster.add_node(num_cpus=1, **NODE)
    cluster.wait_for_nodes()
    return list(cluster.worker_nodes)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "work").mkdir()
    (tmp_path / "work/my.py").write_text(OWN.format(calls=str(tmp_path / "calls")))
    (tmp_path / "work/pace.txt").write_text("0.9")
    return tmp_path


def start(folder, line, command="run"):
    return subprocess.Popen(
        [sys.executable, "-m", "motion_gym.cli.main", command, *line.split()],
        cwd=folder / "work",
        env={**os.environ, "COLUMNS": "200"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def finish(process, status=0):
    printed, _ = process.communicate(timeout=240)
    assert process.returncode == status, printed
    return printed


def scores(folder, out):
    """Metrics of every stored run, by predictor and domain."""
    runs = [json.loads(path.read_bytes()) for path in (folder / "work" / out / "small").glob("*.json")]
    return {(run["identity"]["predictor"], run["identity"]["domain"]): run["metrics"] for run in runs}


def calls(folder):
    """Calls by number of scenes, which tells the column, and the files of the module; the calls are forgotten."""
    lines = (folder / "calls").read_text().splitlines()
    (folder / "calls").unlink()
    return collections.Counter(int(line.split(",")[0]) for line in lines), {line.split(",")[1] for line in lines}


def files(folder):
    """Time of each run of the predictor."""
    return {path.name: path.stat().st_mtime_ns for path in (folder / "work/out/small").glob("my_Paced--*.json")}


def wait_for_runs(folder, process, number):
    end = time.monotonic() + 120
    while len(files(folder)) < number:
        assert process.poll() is None and time.monotonic() < end
        time.sleep(0.05)


def test_a_cluster_gives_the_numbers_of_one_process_and_finds_the_files_of_the_working_folder(cluster, nodes, folder):
    printed = finish(start(folder, SWEEP + cluster.address))
    assert "my:Paced" in printed and "Traceback" not in printed
    on_nodes, modules = calls(folder)
    assert not any(module.startswith(str(folder)) for module in modules)
    finish(start(folder, "my:SMALL --predictor my:Paced --out alone --jobs 1"))
    assert calls(folder) == (on_nodes, {str(folder / "work/my.py")})
    alone, together = scores(folder, "alone"), scores(folder, "out")
    assert alone == together and len(alone) == 2 * COLUMNS
    run = json.loads(next((folder / "work/out/small").glob("my_Paced--*.json")).read_bytes())
    assert run["provenance"]["command"] == ["run", *SWEEP.split(), cluster.address]


def test_all_runs_arrive_when_a_node_is_killed_half_way(cluster, nodes, folder):
    process = start(folder, SWEEP + cluster.address)
    wait_for_runs(folder, process, 2)
    cluster.remove_node(nodes[0], allow_graceful=False)
    assert len(files(folder)) < COLUMNS
    finish(process)
    assert len(scores(folder, "out")) == 2 * COLUMNS


def test_a_killed_command_loses_nothing_and_computes_nothing_twice(cluster, nodes, folder):
    process = start(folder, SWEEP + cluster.address)
    wait_for_runs(folder, process, 2)
    process.kill()
    process.communicate()
    done = files(folder)
    assert 2 <= len(done) < COLUMNS
    printed = finish(start(folder, SWEEP + cluster.address + " --resume"))
    assert "Going on with the same command" in printed
    assert len(scores(folder, "out")) == 2 * COLUMNS and done.items() <= files(folder).items()
    made, _ = calls(folder)
    each = min(made.values())
    # Only the two runs that were under way when the command was killed begin again.
    assert len(made) == COLUMNS and sum(count > each for count in made.values()) <= len(nodes)


def test_a_row_that_fails_on_a_node_is_named_with_its_reason(cluster, nodes, folder):
    line = f"my:ONE --predictor my:Broken --predictor my:Crash --executor ray --address {cluster.address}"
    printed = finish(start(folder, line), 2)
    assert "Not shown: my:Broken" in printed and "ValueError: a wall is in the way" in printed
    assert "Not shown: my:Crash" in printed and "Ray could not finish it, after 3 retries" in printed
    assert "Traceback" not in printed and "constant_velocity" in printed


def test_tasks_that_reserve_a_part_of_a_gpu_run_where_there_is_one(cluster, nodes, folder):
    process = start(folder, f"my:ONE --predictor my:Paced --gpus 0.5 --executor ray --address {cluster.address}")
    assert "No node has 1 CPU and 0.5 GPUs" in process.stdout.readline()
    node = cluster.add_node(num_cpus=1, num_gpus=1, **NODE)  # Ray does not look for the device
    finish(process)
    assert {line.split(",")[2] for line in (folder / "calls").read_text().splitlines()} == {"0"}
    cluster.remove_node(node)


def test_a_training_whose_node_is_killed_goes_on_from_its_last_checkpoint(cluster, nodes, folder):
    line = "erm_no_sigma --domain orca:d=0.4,scenes=70 --seeds 0,1 --epochs 2 2 60 --every 1"
    process = start(folder, f"{line} --executor ray --address {cluster.address}", "train")
    saved = folder / "work/weights/orca_d=0.4_scenes=70/erm_no_sigma"
    epochs = []  # of each checkpoint that is seen
    while process.poll() is None:
        if saved.with_suffix(".checkpoint").exists():
            epochs.append(torch.load(saved.with_suffix(".checkpoint"), weights_only=True)["epoch"])
        if epochs and epochs[-1] >= 20 and nodes:
            for node in nodes:
                cluster.remove_node(node, allow_graceful=False)
            nodes = []
            cluster.add_node(num_cpus=1, **NODE)
        time.sleep(0.02)
    finish(process)
    assert not nodes and epochs == sorted(epochs) and epochs[-1] == 64  # no epoch was trained again from the start
    finish(start(folder, f"{line} --out alone", "train"))
    alone = folder / "work/alone" / saved.relative_to(folder / "work/weights")
    on_cluster, here = (json.loads(path.with_suffix(".json").read_bytes()) for path in (saved, alone))
    assert on_cluster["sha256"] == here["sha256"]
    assert on_cluster["curve"] == here["curve"]


def test_a_wrong_address_is_named_at_once(folder):
    printed = finish(start(folder, "my:ONE --fresh --executor ray --address 127.0.0.1:1"), 2)
    assert "The Ray cluster `127.0.0.1:1` does not answer" in printed and "Traceback" not in printed
