from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motion_gym.contract import SpecError
from motion_gym.data.storage import (
    StorageError,
    atomic_file,
    cache_folder,
    cached_arrays,
    data_folder,
    write_atomic,
)

KEY = {"name": "eth windows", "alpha": 64.0, "files": ["a", "b"]}


def make() -> dict[str, np.ndarray]:
    return {
        "history": np.arange(24, dtype=np.float32).reshape(3, 8),
        "scene": np.array([0, 1, 3]),
        "names": np.array(["eth"]),
    }


def refuse() -> dict[str, np.ndarray]:
    raise RuntimeError("made again, although it is in the cache")


def same(left: dict[str, np.ndarray], right: dict[str, np.ndarray]) -> bool:
    return list(left) == list(right) and all(
        np.array_equal(left[name], right[name]) and left[name].dtype == right[name].dtype for name in left
    )


def python(code: str, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> str:
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    return out


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MOTION_GYM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_folders_follow_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MOTION_GYM_DATA", str(tmp_path / "d"))
    monkeypatch.setenv("MOTION_GYM_CACHE", "~/c")
    assert data_folder() == tmp_path / "d"
    assert cache_folder() == Path.home() / "c"
    monkeypatch.setenv("MOTION_GYM_DATA", "")
    assert data_folder().name == "motion-gym"


def test_write_makes_folders_and_replaces(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b.txt"
    write_atomic(path, b"one")
    write_atomic(path, b"two")
    assert path.read_bytes() == b"two"
    assert os.listdir(path.parent) == ["b.txt"]


def test_written_files_have_ordinary_permissions(tmp_path: Path) -> None:
    (tmp_path / "plain").write_bytes(b"")
    write_atomic(tmp_path / "atomic", b"")
    assert (tmp_path / "atomic").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_interrupted_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_atomic(path, b"old")
    with pytest.raises(KeyboardInterrupt), atomic_file(path) as file:
        file.write(b"half of the n")
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_folder_that_is_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "f").write_bytes(b"")
    with pytest.raises(StorageError, match=r"f/a\.txt could not be written: .*MOTION_GYM_DATA"):
        write_atomic(tmp_path / "f" / "a.txt", b"")


FULL_DISK = """
    import resource, signal, sys, warnings
    import numpy as np
    from motion_gym.data.storage import StorageError, cached_arrays, write_atomic
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
"""


def test_full_disk_leaves_nothing_half_written(tmp_path: Path) -> None:
    path = tmp_path / "result.bin"
    write_atomic(path, b"old")
    code = (
        FULL_DISK
        + """
    try:
        write_atomic(sys.argv[1], bytes(300_000))
    except StorageError as error:
        print(error.errno, error)
    """
    )
    message = finish(python(code, path))
    assert message.startswith("27 ")  # EFBIG: the write itself failed
    assert str(path) in message and "Free space" in message
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["result.bin"]


def test_full_disk_while_caching_warns_and_returns_the_arrays(cache: Path) -> None:
    code = (
        FULL_DISK
        + """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        arrays = cached_arrays({"name": "big"}, lambda: {"a": np.arange(100_000)})
    assert (arrays["a"] == np.arange(100_000)).all()
    (warning,) = caught
    assert warning.category is RuntimeWarning and warning.filename == "<string>"
    print(warning.message)
    """
    )
    message = finish(python(code))
    for part in (str(cache), "File too large", "Free space", "MOTION_GYM_CACHE"):
        assert part in message
    assert os.listdir(cache) == []


def test_unusable_cache_folder_warns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("MOTION_GYM_CACHE", str(tmp_path / "file"))
    with pytest.warns(RuntimeWarning, match="MOTION_GYM_CACHE"):
        assert same(cached_arrays(KEY, make), make())


def test_second_call_reads_the_cache(cache: Path) -> None:
    arrays = cached_arrays(KEY, make)
    assert same(arrays, make())
    assert same(cached_arrays(dict(reversed(KEY.items())), refuse), arrays)
    (entry,) = os.listdir(cache)
    assert entry.startswith("eth-windows-") and entry.endswith(".npz")


@given(st.dictionaries(st.text(max_size=3), st.integers() | st.booleans() | st.text(max_size=3), max_size=3))
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_different_keys_have_different_entries(cache: Path, key: dict[str, object]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        got = cached_arrays(key, lambda: {"key": np.array(json.dumps(key, sort_keys=True))})
    assert str(got["key"]) == json.dumps(key, sort_keys=True)


@given(st.data())
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_damaged_entry_is_made_again(cache: Path, data: st.DataObject) -> None:
    cached_arrays(KEY, make)
    (entry,) = cache.iterdir()
    whole = entry.read_bytes()
    position = data.draw(st.integers(0, len(whole) - 1))
    if data.draw(st.booleans()):
        entry.write_bytes(whole[:position])
        remade = True
    else:
        flipped = bytes([whole[position] ^ data.draw(st.integers(1, 255))])
        entry.write_bytes(whole[:position] + flipped + whole[position + 1 :])
        remade = False  # some bytes of a zip archive, such as its dates, mean nothing
    assert same(cached_arrays(KEY, make), make())
    if remade:
        assert same(cached_arrays(KEY, refuse), make())


def test_an_entry_with_other_content_is_made_again(cache: Path) -> None:
    cached_arrays(KEY, make)
    (entry,) = cache.iterdir()
    changed = dict(np.load(entry))
    changed["scene"] = changed["scene"] + 1
    np.savez(entry, **changed)  # a valid file
    assert same(cached_arrays(KEY, make), make())
    other = {**KEY, "alpha": 4.0}
    cached_arrays(other, lambda: {"a": np.zeros(3)})
    (another,) = set(cache.iterdir()) - {entry}
    another.replace(entry)  # the valid entry of another key
    assert same(cached_arrays(KEY, make), make())
    assert same(cached_arrays(KEY, refuse), make())


def test_what_a_killed_process_left_is_removed_by_the_next_write(tmp_path: Path) -> None:
    code = """
    import os, signal, sys
    from motion_gym.data.storage import atomic_file
    with atomic_file(sys.argv[1]) as file:
        file.write(b"half")
        file.flush()
        os.kill(os.getpid(), signal.SIGKILL)
    """
    process = python(code, tmp_path / "a.json")
    process.communicate(timeout=60)
    assert process.returncode == -9
    (leftover,) = tmp_path.iterdir()
    foreign = tmp_path / ".a.json.tmp"
    foreign.write_bytes(b"somebody else's")
    write_atomic(tmp_path / "b.json", b"")
    assert leftover.exists(), "it may still be being written"
    for path in (leftover, foreign):
        os.utime(path, (0, 0))
    later = "import sys; from motion_gym.data.storage import write_atomic; write_atomic(sys.argv[1], b'')"
    assert python(later, tmp_path / "b.json").wait(timeout=60) == 0
    assert sorted(os.listdir(tmp_path)) == [".a.json.tmp", "b.json"]


def test_a_user_without_a_home_folder_is_told_which_variable_to_set(tmp_path: Path) -> None:
    code = """
    import os, pwd, warnings
    import numpy as np
    def no_entry(user):
        raise KeyError(user)
    os.environ.pop("HOME", None)
    pwd.getpwuid = no_entry
    from motion_gym.data.storage import StorageError, cached_arrays, data_folder
    try:
        data_folder()
    except StorageError as error:
        print(error)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert cached_arrays({"name": "small"}, lambda: {"a": np.zeros(2)})["a"].tolist() == [0, 0]
    print(caught[0].message)
    """
    variables = {k: v for k, v in os.environ.items() if not k.startswith(("MOTION_GYM", "XDG"))}
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], env=variables, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    data, cache = done.stdout.splitlines()
    assert "no home folder" in data and "set MOTION_GYM_DATA" in data
    assert cache.startswith("Not cached: ") and "set MOTION_GYM_CACHE" in cache


def test_two_processes_build_one_entry(cache: Path) -> None:
    code = """
    import sys, time, warnings
    import numpy as np
    from motion_gym.data.storage import cached_arrays
    warnings.simplefilter("error")
    def make():
        print("made", flush=True)
        sys.stdin.readline()  # both have found no entry before either writes one
        return {"a": np.arange(500_000)}
    for _ in range(20):
        assert (cached_arrays({"name": "shared"}, make)["a"] == np.arange(500_000)).all()
    """
    command = [sys.executable, "-c", textwrap.dedent(code)]
    both = [
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    for process in both:
        assert process.stdout is not None and process.stdout.readline() == "made\n"
    for process in both:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    for process in both:
        _, err = process.communicate(timeout=60)
        assert process.returncode == 0, err
    assert len(os.listdir(cache)) == 1


def test_keys_and_arrays_that_cannot_be_kept_are_refused(cache: Path) -> None:
    for value in (np.float32(1), float("nan"), {1, 2}):
        with pytest.raises(SpecError, match="JSON"):
            cached_arrays({"alpha": value}, make)
    with pytest.raises(SpecError, match="odd"):
        cached_arrays(KEY, lambda: {"odd": np.array([None])})
