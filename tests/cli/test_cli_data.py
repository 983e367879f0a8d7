"""The command for data sets, and missing data."""

import re

from motion_gym.data.storage import data_folder
from tests.cli.command_line import call, fail


def test_missing_data_says_what_to_do(capsys, no_data):
    error = fail(capsys, "score linear --domain eth").err
    assert "biwi_eth.txt is missing" in error
    assert "motion-gym data fetch eth_ucy" in error and "motion-gym data add eth_ucy --from DIR" in error


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
