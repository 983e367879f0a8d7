"""Compiled loops where their machine code cannot be kept, or was damaged."""

import os
import subprocess
import sys
import textwrap

from motion_gym.compiled import compiled
from tests.tutorials import ROOT

SIMULATE = """
    import resource, signal, sys
    from motion_gym.envs.orca_engine.vectors import dot
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
    print(dot(1.0, 2.0, 3.0, 4.0), dot.stats.cache_hits and "loaded")
"""


def compute(folder, most_bytes=10**9):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(SIMULATE), str(most_bytes)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_a_full_disk_stops_no_loop(tmp_path):
    assert compute(tmp_path, most_bytes=100)[0] == "11.0"
    assert not list(tmp_path.rglob("*.nbc"))


def test_kept_machine_code_is_loaded_and_damaged_code_compiled_again(tmp_path):
    assert "loaded" not in compute(tmp_path)
    assert compute(tmp_path) == ["11.0", "loaded"]
    for damage in (b"", b"\0" * 500):
        (file,) = tmp_path.rglob("*.nbc")
        file.write_bytes(damage)
        assert compute(tmp_path)[0] == "11.0"
    (index,) = tmp_path.rglob("*.nbi")
    index.write_bytes(b"\x80\x05")
    assert compute(tmp_path)[0] == "11.0"


def test_a_function_without_a_folder_for_its_code_is_compiled():
    scope = {}
    exec("def twice(x):\n    return 2 * x", scope)  # from no file
    assert compiled()(scope["twice"])(3) == 6
