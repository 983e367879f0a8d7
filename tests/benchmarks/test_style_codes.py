"""The study of style codes."""

import numpy as np
import pytest

from motion_gym.benchmarks.reports import figures
from motion_gym.benchmarks.studies.style_codes import recognised, style_codes


def test_styles_are_recognised_where_their_codes_separate():
    rng = np.random.default_rng(0)
    codes = {name: rng.normal(center, 0.1, (30, 4)) for name, center in (("calm", 0), ("fast", 2))}
    codes["same"] = codes["fast"] + rng.normal(0, 0.1, (30, 4))
    assert recognised(codes, "calm") == 1.0
    assert recognised(codes, "fast") < 1.0


def test_codes_of_a_predictor_with_a_style_are_drawn(tmp_path):
    pytest.importorskip("torch")
    domains = {str(d): f"orca:d={d},scenes=40" for d in (0.1, 0.8)}
    study = style_codes("modular_invariant:weights=style", domains, ["0.1"])
    assert min(map(len, study["codes"].values())) > 30 and 0.5 < study["share"] <= 1
    assert min(study["recognised"].values()) > 0.8
    figures.style_codes(study, tmp_path / "codes.svg")
    assert "held out" in (tmp_path / "codes.svg").read_text()
