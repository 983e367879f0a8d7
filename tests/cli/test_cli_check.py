"""The commands that check a predictor or a domain, and that show a scene."""

from pathlib import Path

import pytest

from motion_gym.checks import rules
from motion_gym.cli.main import main
from tests.cli.command_line import call, fail


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


@pytest.mark.parametrize("file", ["scene.svg", "folder/scene.png", "scene.pdf"])
def test_a_scene_is_drawn_with_forecasts(capsys, file):
    many = [f"constant_velocity:velocity={n}" for n in range(1, 8)] if file == "scene.svg" else []
    predictors = [*many, "linear", "stand_still", "kalman_velocity", "constant_velocity"]
    options = " ".join(f"--predictor {predictor}" for predictor in predictors)
    line = f"show orca:scenes=40 {options} --scene 3 --out {file}"
    assert f"Written: {file}" in call(capsys, line)
    content = Path(file).read_bytes()
    assert content.startswith({".svg": b"<?xml", ".png": b"\x89PNG", ".pdf": b"%PDF"}[Path(file).suffix])
    if file == "scene.svg":  # the same command gives the same file
        call(capsys, line)
        assert Path(file).read_bytes() == content
