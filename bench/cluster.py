"""Ray executor on this machine: start, memory, cost of a task, and overhead on tasks of 10 s.

The jobs rest instead of computing, and return a stored run, so that all that is measured is the executor: sending the
job, bringing the result back and writing its file. Nodes and command share this machine; on a cluster they do not.
"""

import functools
import os
import sys
import tempfile
import time
from pathlib import Path

from machine import machine

from motion_gym.benchmarks import executors
from motion_gym.benchmarks.jobs import Job, Runner
from motion_gym.benchmarks.store import Store

CPUS = 2
ROUNDS = 3
"""Tasks of 10 s that each CPU computes."""
SHORT = 500
"""Tasks that do not rest."""


def rest(seconds: float, result: dict) -> list[dict]:
    time.sleep(seconds)
    return [result]


def sweep(name: str, executor: executors.Opener, number: int, seconds: float) -> tuple[float, int]:
    """Seconds that a number of jobs take, and the bytes of their files."""
    result = next(run for run in Store("style").runs.values() if run["identity"]["kind"] == "windows")
    content = {key: value for key, value in result.items() if key not in ("identity", "provenance", "schema")}
    identities = [{**result["identity"], "seed": seed} for seed in range(number)]
    jobs = [Job("", (), "", "", [each], functools.partial(rest, seconds, content)) for each in identities]
    folder = Path(name)
    runner = Runner(Store(None, folder), executor=executor)
    began = time.perf_counter()
    (runs,) = runner.rows(jobs).values()
    spent = time.perf_counter() - began
    files = [path.stat().st_size for path in folder.glob("*.json")]
    assert len(runs) == len(files) == number and not runner.unwritten
    return spent, sum(files)


def tree(pid: int) -> list[int]:
    """A process and the processes that it started."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [pid, *(each for child in children for each in tree(int(child)))]


def memory(pids: list[int]) -> float:
    """Memory of processes, MB; what several of them share counts once."""
    rollups = [Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines() for pid in pids]
    return sum(int(line.split()[1]) for rollup in rollups for line in rollup if line.startswith("Pss:")) / 1024


def cpu(pids: list[int]) -> float:
    """Seconds that processes have computed."""
    fields = [Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in pids]
    return sum(int(user) + int(system) for _, *_, user, system in (each[:13] for each in fields)) / os.sysconf(
        "SC_CLK_TCK"
    )


def main() -> None:
    import ray

    me = os.getpid()
    before = memory([me])
    began = time.perf_counter()
    ray.init(num_cpus=CPUS, logging_level="ERROR", runtime_env={"working_dir": os.getcwd()})
    started = time.perf_counter() - began
    cluster, pool = executors.ray(), executors.processes(CPUS)  # the first uses the connection
    first, _ = sweep("first", cluster, CPUS, 0.0)
    print(f"start: cluster {started:.1f} s, then its first task on each of {CPUS} CPUs {first:.1f} s")
    print(f"memory: {memory(tree(me)) - before:.0f} MB for the cluster with {CPUS} processes that compute")
    for name, executor in (("ray", cluster), ("processes", pool)):
        before = memory([me])
        spent, size = sweep(f"short {name}", executor, SHORT, 0.0)
        grown = 1024 * (memory([me]) - before) / SHORT
        print(f"{name}: {SHORT} tasks that do nothing {spent:.2f} s, {SHORT / spent:.0f} a second; ", end="")
        print(f"a stored run takes {size / SHORT / 1000:.1f} kB on disk, and the command grows by {grown:.0f} kB")
    for name, executor in (("ray", cluster), ("processes", pool)):
        before = cpu(tree(me))
        spent, _ = sweep(f"long {name}", executor, ROUNDS * CPUS, 10.0)
        used = f"; all processes computed {cpu(tree(me)) - before:.1f} s meanwhile" if executor is cluster else ""
        text = f"{name}: {ROUNDS * CPUS} tasks of 10 s {spent:.2f} s, {100 * (spent / ROUNDS / 10 - 1):.1f} % more than"
        print(f"{text} {ROUNDS * 10} s{used}")


if __name__ == "__main__":
    print(f"Executors, {CPUS} CPUs. {machine()}", end="; ")
    import ray as library

    print(f"Ray {library.__version__}")
    with tempfile.TemporaryDirectory() as folder:
        sys.path.append(os.getcwd())
        os.chdir(folder)
        main()
