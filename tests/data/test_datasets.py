from __future__ import annotations

import functools
import hashlib
import http.server
import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from motion_gym.contract import DataError, SpecError
from motion_gym.data import datasets
from motion_gym.data.datasets import DATASETS, DataFile, DataSet, add, fetch, listing, locate, verify
from motion_gym.data.storage import StorageError

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("MOTION_GYM_SHARED", ROOT.parent / "shared"))
REAL = SHARED / "data" / "eth_ucy"

CONTENTS = {"one.txt": b"0\t1\t2.5\t3.5\n" * 40, "two.txt": b"10\t1\t2.5\t3.5\n" * 40}
real = pytest.mark.skipif(not REAL.is_dir(), reason=f"no real data in {REAL}; set MOTION_GYM_SHARED")


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MOTION_GYM_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> DataSet:
    """A small data set in the table, so that tests need no real data."""
    files = tuple(
        DataFile(
            name,
            hashlib.sha256(content).hexdigest(),
            len(content),
            f"http://127.0.0.1:9/{name}",
            ("alias.txt",),
        )
        if name == "two.txt"
        else DataFile(name, hashlib.sha256(content).hexdigest(), len(content), f"http://127.0.0.1:9/{name}")
        for name, content in CONTENTS.items()
    )
    entry = DataSet("toy", "Toy", "toys.example", "free", "nobody 2020", files)
    monkeypatch.setattr(datasets, "DATASETS", {**DATASETS, "toy": entry})
    return entry


@pytest.fixture
def source(tmp_path: Path) -> Path:
    for name, content in CONTENTS.items():
        path = tmp_path / "source" / name.removesuffix(".txt") / name
        path.parent.mkdir(parents=True)
        path.write_bytes(content)
    return tmp_path / "source"


@pytest.fixture
def server(source: Path) -> Iterator[str]:
    for path in list(source.rglob("*.txt")):
        shutil.copy(path, source)

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: object) -> None:
            pass

    handler = functools.partial(Quiet, directory=str(source))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{running.server_address[1]}"
        running.shutdown()
        thread.join()


def states(name: str = "toy") -> list[str]:
    return [row.state for row in verify(name)]


def test_add_finds_files_anywhere_below_the_folder(toy: DataSet, source: Path, data: Path) -> None:
    assert states() == ["missing", "missing"]
    assert [row.state for row in add("toy", source)] == ["ok", "ok"]
    assert {path.name: path.read_bytes() for path in (data / "toy").iterdir()} == CONTENTS


def test_add_takes_the_right_one_of_files_with_one_name(toy: DataSet, source: Path) -> None:
    (source / "a" / "val").mkdir(parents=True)
    (source / "a" / "val" / "one.txt").write_bytes(b"another split")
    (source / "a" / "alias.txt").write_bytes(b"another recording")
    (source / "two" / "two.txt").rename(source / "two" / "alias.txt")
    add("toy", source)
    assert states() == ["ok", "ok"]


def test_add_of_some_files_says_which_are_missing(toy: DataSet, source: Path) -> None:
    assert [row.state for row in add("toy", source / "two")] == ["missing", "ok"]


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        (CONTENTS["two.txt"][:100], "truncated"),
        (CONTENTS["two.txt"].replace(b"\n", b"\r\n"), "line endings"),
        (CONTENTS["two.txt"].replace(b"3.5", b"3.6", 1), "edited"),
        (b"<!DOCTYPE html><html></html>", "web page"),
        (b"version https://git-lfs.github.com/spec/v1\n", "Git LFS"),
    ],
)
def test_add_of_a_different_file_copies_nothing(
    toy: DataSet, source: Path, data: Path, content: bytes, cause: str
) -> None:
    (source / "two" / "two.txt").write_bytes(content)
    with pytest.raises(DataError, match=cause) as caught:
        add("toy", source)
    message = str(caught.value)
    for part in (
        "two/two.txt",
        toy.files[1].sha256,
        hashlib.sha256(content).hexdigest(),
        f"{len(content)} bytes",
    ):
        assert part in message
    assert "one.txt" not in message
    assert not data.exists()


def test_add_from_a_wrong_folder_says_so(toy: DataSet, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is not a folder"):
        add("toy", tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match=r"none of its files .* Looked for: one\.txt, two\.txt"):
        add("toy", tmp_path / "empty")


def test_fetch_downloads_what_is_missing_or_damaged(toy: DataSet, server: str, data: Path) -> None:
    (data / "toy").mkdir(parents=True)
    (data / "toy" / "one.txt").write_bytes(b"damaged")
    assert [row.state for row in fetch("toy", base=server)] == ["ok", "ok"]
    assert sorted(os.listdir(data / "toy")) == ["one.txt", "two.txt"]


def test_fetch_leaves_whole_files_alone(toy: DataSet, source: Path) -> None:
    add("toy", source)
    assert [row.state for row in fetch("toy")] == ["ok", "ok"]  # nothing listens at its addresses


def test_fetch_without_network_says_what_to_do(toy: DataSet, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DataError) as caught:
        fetch("toy")
    message = str(caught.value)
    for part in (
        "http://127.0.0.1:9/one.txt",
        "not reachable",
        "refused",
        "motion-gym data add toy --from DIR",
    ):
        assert part in message
    assert "toys.example" in message and "\n" not in message
    assert caught.value.__suppress_context__
    assert capfd.readouterr() == ("", "")


def test_fetch_of_an_address_that_is_gone_gives_the_status(toy: DataSet, server: str, source: Path, data: Path) -> None:
    (source / "two.txt").unlink()
    with pytest.raises(DataError, match=rf"{server}/two\.txt answered 404 .*data add toy"):
        fetch("toy", base=server + "/")
    assert states() == ["ok", "missing"]


def test_fetch_of_other_bytes_is_refused(toy: DataSet, server: str, source: Path) -> None:
    (source / "one.txt").write_bytes(CONTENTS["one.txt"][:-5])
    with pytest.raises(DataError, match=r"one\.txt is not the expected one\.txt: .*truncated"):
        fetch("toy", base=server)
    assert states() == ["missing", "missing"]


def test_fetch_tries_again_when_a_connection_breaks(toy: DataSet, source: Path, data: Path) -> None:
    asked: list[str] = []

    class Breaks(http.server.SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: object) -> None:
            pass

        def do_GET(self) -> None:
            asked.append(self.path)
            if asked.count(self.path) == 1:
                self.connection.close()
            else:
                super().do_GET()

    for path in list(source.rglob("*.txt")):
        shutil.copy(path, source)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Breaks, directory=str(source))) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        try:
            assert [row.state for row in fetch("toy", base=f"http://127.0.0.1:{running.server_address[1]}")] == [
                "ok",
                "ok",
            ]
        finally:
            running.shutdown()
            thread.join()
    assert sorted(asked) == ["/one.txt"] * 2 + ["/two.txt"] * 2


@pytest.mark.parametrize("command", ["add", "fetch"])
def test_a_full_disk_says_which_files_were_written(
    toy: DataSet, source: Path, server: str, data: Path, command: str
) -> None:
    (data / "toy" / "two.txt").mkdir(parents=True)  # in the way of the second file
    with pytest.raises(StorageError, match=r"two\.txt .* Of toy, one\.txt were written and are whole; then run"):
        add("toy", source) if command == "add" else fetch("toy", base=server)
    assert (data / "toy" / "one.txt").read_bytes() == CONTENTS["one.txt"]


def test_downloaded_files_have_ordinary_permissions(toy: DataSet, server: str, data: Path) -> None:
    fetch("toy", base=server)
    (data / "plain").write_bytes(b"")
    assert (data / "toy" / "one.txt").stat().st_mode == (data / "plain").stat().st_mode


def test_locate_missing_says_what_to_do(toy: DataSet, data: Path) -> None:
    with pytest.raises(DataError) as caught:
        locate("toy", "one.txt")
    for part in (
        str(data / "toy" / "one.txt"),
        "data fetch toy",
        "data add toy --from DIR",
        "MOTION_GYM_DATA",
    ):
        assert part in str(caught.value)


def test_a_file_that_cannot_be_read_is_not_called_missing_or_damaged(toy: DataSet, data: Path) -> None:
    (data / "toy").mkdir(parents=True)
    (data / "toy" / "one.txt").symlink_to("one.txt")  # a link to itself: neither there nor missing
    for use in (lambda: locate("toy", "one.txt"), lambda: verify("toy")):
        with pytest.raises(DataError, match=r"one\.txt cannot be read: .*Make it readable, or set MOTION_GYM_DATA"):
            use()


def test_locate_sees_a_folder_set_one_level_too_deep(
    toy: DataSet, source: Path, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add("toy", source)
    monkeypatch.setenv("MOTION_GYM_DATA", str(data / "toy"))
    with pytest.raises(DataError, match="must name the folder above"):
        locate("toy", "one.txt")


def test_locate_notices_damage_after_the_first_use(toy: DataSet, source: Path, data: Path) -> None:
    add("toy", source)
    path = locate("toy", "one.txt")
    assert path == data / "toy" / "one.txt"
    content = bytearray(path.read_bytes())
    content[5] ^= 1
    path.write_bytes(content)
    os.utime(path, ns=(1, 1))
    with pytest.raises(DataError, match=r"one\.txt is damaged: expected .* found .*data fetch toy"):
        locate("toy", "one.txt")


def test_locate_hashes_a_file_once(toy: DataSet, source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    add("toy", source)
    locate("toy", "one.txt")
    monkeypatch.setattr(datasets, "_bytes", lambda path: pytest.fail("read again"))
    locate("toy", "one.txt")


def test_verify_reads_the_bytes_each_time(toy: DataSet, source: Path, data: Path) -> None:
    add("toy", source)
    path = data / "toy" / "one.txt"
    status = path.stat()
    path.write_bytes(CONTENTS["one.txt"].replace(b"2.5", b"2.6"))
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert states() == ["damaged", "ok"]


def test_listing_has_every_data_set(toy: DataSet, source: Path) -> None:
    add("toy", source)
    rows = {entry.name: [row.state for row in rows] for entry, rows in listing()}
    assert {*rows} == {*DATASETS, "toy"} and rows["eth_ucy"] == ["missing"] * 9 and rows["toy"] == ["ok", "ok"]


def test_unknown_names_suggest_what_was_meant() -> None:
    with pytest.raises(SpecError, match=r"There is no data set `eth-ucy`\. Did you mean `eth_ucy`"):
        verify("eth-ucy")
    with pytest.raises(SpecError, match=r"Did you mean `biwi_hotel\.txt`"):
        locate("eth_ucy", "biwi_hotl.txt")


def test_addresses_are_pinned() -> None:
    for entry in DATASETS.values():
        for file in (file for file in entry.files if file.address):
            parts = file.address.split("/")
            assert parts[:3] == ["https:", "", "raw.githubusercontent.com"]
            assert len(parts[5]) == 40 and parts[-1] in (file.name, *file.aliases)


@real
def test_the_real_files_are_the_expected_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MOTION_GYM_DATA", str(REAL.parent))
    assert states("eth_ucy") == ["ok"] * 9
    assert locate("eth_ucy", "students003.txt") == REAL / "students003.txt"


@real
def test_the_real_files_can_be_added(data: Path) -> None:
    add("eth_ucy", REAL)
    assert states("eth_ucy") == ["ok"] * 9
