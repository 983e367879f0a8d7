"""Weights that do not come with the package: listed, added with checksums, found, and named where they are missing."""

import functools
import http.server
import json
import threading

import pytest
import torch

from motion_gym import catalog
from motion_gym.contract import PredictorError
from motion_gym.predictors.networks import unet
from motion_gym.training import added_weights, weight_files
from tests.cli.command_line import call, fail

NAME = "sdd/heatmap.safetensors"
DOMAIN = "sdd:speed=3.25-3.75"


@pytest.fixture
def package(tmp_path, monkeypatch, no_data):
    """A package with the card of weights that are in a folder ``elsewhere``."""
    shipped, elsewhere = tmp_path / "package", tmp_path / "elsewhere" / NAME
    card = {"predictor": "heatmap", "seeds": [0], "trained_on": [DOMAIN], "dt": 0.4}
    weight_files.write(elsewhere, unet.initial(0), card)
    path = (shipped / NAME).with_suffix(".json")
    path.parent.mkdir(parents=True)
    path.write_bytes(elsewhere.with_suffix(".json").read_bytes())
    for module, name in ((added_weights, "WEIGHTS"), (weight_files, "SHIPPED")):
        monkeypatch.setattr(module, name, shipped)
    return shipped


def test_weights_are_added_and_found(capsys, package, no_data, tmp_path):
    assert call(capsys, "weights ls").startswith("missing ")
    out = call(capsys, f"weights add --from {tmp_path / 'elsewhere'}")
    assert f"Written: {no_data / 'weights' / NAME}" in out and "no commercial use" in out
    assert call(capsys, "weights ls").startswith("here ")
    predictor = catalog.predictor("heatmap")
    assert predictor.fitted and predictor.trained_on == (DOMAIN,)
    assert torch.equal(predictor.tensors["encoder.weight1"], unet.initial(0)["encoder.weight1"])


def test_missing_weights_are_named_with_the_command(capsys, package):
    assert not catalog.predictor("heatmap").fitted
    for spec in ("heatmap", "heatmap:weights=sdd"):
        error = fail(capsys, f"score {spec} --domain orca:scenes=20").err
        assert "do not come with the package" in error and "motion-gym weights add --from DIR" in error


def test_damaged_other_and_absent_files_are_refused(capsys, package, no_data, tmp_path):
    path = tmp_path / "elsewhere" / NAME
    path.write_bytes(path.read_bytes()[:-1])
    error = fail(capsys, f"weights add --from {tmp_path / 'elsewhere'}").err
    assert "Nothing was copied" in error and str(path) in error and not no_data.exists()
    assert "is not a folder" in fail(capsys, f"weights add --from {path}").err
    (tmp_path / "empty").mkdir()
    assert f"Looked for: {NAME}" in fail(capsys, f"weights add --from {tmp_path / 'empty'}").err
    assert "motion-gym weights add --from DIR" in fail(capsys, "weights add").err


def test_weights_of_another_version_are_refused(capsys, package, no_data, tmp_path):
    call(capsys, f"weights add --from {tmp_path / 'elsewhere'}")
    card = (package / NAME).with_suffix(".json")
    card.write_text(json.dumps({**json.loads(card.read_bytes()), "sha256": "0" * 64}))
    with pytest.raises(PredictorError, match="another version of motion-gym: get those of this version"):
        catalog.predictor("heatmap:weights=sdd")


def test_weights_are_fetched_where_an_address_is_configured(capsys, package, no_data, tmp_path, monkeypatch):
    assert "set MOTION_GYM_WEIGHTS_URL" in fail(capsys, "weights fetch").err
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=tmp_path / "elsewhere")
    monkeypatch.setattr(http.server.SimpleHTTPRequestHandler, "log_message", lambda *_: None)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        monkeypatch.setenv("MOTION_GYM_WEIGHTS_URL", f"http://127.0.0.1:{server.server_address[1]}/")
        assert f"Written: {no_data / 'weights' / NAME}" in call(capsys, "weights fetch")
        assert call(capsys, "weights fetch") == "All weights are here.\n"
        (no_data / "weights" / NAME).write_bytes(b"damaged")
        assert f"Written: {no_data / 'weights' / NAME}" in call(capsys, "weights fetch")
        path = tmp_path / "elsewhere" / NAME
        path.write_bytes(path.read_bytes()[:-1])
        (no_data / "weights" / NAME).unlink()
        assert "is not the expected sdd/heatmap.safetensors" in fail(capsys, "weights fetch").err
        server.shutdown()
    assert "motion-gym weights add --from DIR" in fail(capsys, "weights fetch").err
    assert not (no_data / "weights" / NAME).exists()


def test_auto_does_not_take_other_weights_in_place_of_missing_ones(package, monkeypatch):
    """Which weights are chosen depends on the shipped cards, not on what is installed."""
    for folder, place in (("spurious", "eth"), ("spurious/hotel", "hotel")):
        card = package / folder / "erm.json"
        card.parent.mkdir(parents=True, exist_ok=True)
        others = [f"{other}:alpha=1" for other in ("eth", "hotel", "zara1") if other != place]
        card.write_text(json.dumps({"predictor": "erm", "seeds": [0], "trained_on": others, "dt": 0.4}))
    predictor = catalog.predictor("erm")
    predictor.choose_weights([catalog.domain("hotel:alpha=8")])
    assert predictor.chosen == "spurious/hotel" and not predictor.fitted
    with pytest.raises(PredictorError, match="`spurious/hotel` of erm do not come with the package"):
        predictor.trained_on  # noqa: B018
