"""The modular network whose style has factors."""

import numpy as np
import pytest
import torch

import motion_gym as mg
from motion_gym.checks.checker import check_predictor
from motion_gym.contract import PredictorError, SpecError
from motion_gym.data.domains import spec_of, training_set
from motion_gym.predictors.modular_factors import ModularFactors
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.pair_network import FACTORS, SHARE
from motion_gym.predictors.training.factor_training import FactorProgram

STYLES = [{"side": side, "d": d} for side, d in (("left", 0.1), ("left", 0.5), ("right", 0.1), ("right", 0.5))]
DOMAIN = mg.domain("orca:scenes=70")
NAMES = [spec_of(source) for source in DOMAIN.sources(styles=STYLES)]


@pytest.fixture(scope="module")
def data():
    return training_set(DOMAIN, styles=STYLES)


@pytest.fixture(scope="module")
def trained(data):
    return ModularFactors().fit(*data, [0, 1], names=NAMES, epochs=(2, 2, 2, 3), scenes=16)


@pytest.fixture
def network(trained):
    network = ModularFactors()
    network.use(trained.stacked, trained.card)
    return network


@pytest.fixture(scope="module")
def reference():
    return mg.domain("orca:d=0.5,side=right,scenes=70").reference()


def test_labels_are_the_parameters_of_the_training_domains(trained):
    labels = trained.card["training"]["labels"]
    assert labels == {"side": ["left", "left", "right", "right"], "d": [0.1, 0.5, 0.1, 0.5]}


@pytest.fixture(scope="module")
def program(data):
    labels = {"side": ["left", "left", "right", "right"], "d": [0.1, 0.5, 0.1, 0.5]}
    return FactorProgram(ModularFactors(), *data, labels=labels, device=torch.device("cpu"), scenes=16)


def test_the_style_loss_compares_each_factor_by_its_own_labels(program):
    environment = torch.arange(4).repeat_interleave(5)
    rows = torch.eye(SHARE)[:2]
    side, d = rows[[0, 0, 1, 1]][environment], rows[[0, 1, 0, 1]][environment]
    right, wrong = (torch.cat(parts, dim=-1)[None] for parts in ((side, d), (d, side)))
    assert program._contrast(right, environment) < program._contrast(wrong, environment) - 1


def test_codes_come_from_environments_that_share_the_value(program):
    rng, means = np.random.default_rng(0), torch.arange(4.0).view(1, 4, 1, 1).expand(-1, -1, -1, 2 * SHARE)
    drawn = torch.stack([program._styles(means, rng)[0, :, 0] for _ in range(40)])
    sources = {factor: part[..., 0].T for factor, part in zip(FACTORS, drawn.chunk(2, dim=-1), strict=True)}
    assert [set(row.tolist()) for row in sources["side"]] == [{0, 1}, {0, 1}, {2, 3}, {2, 3}]
    assert [set(row.tolist()) for row in sources["d"]] == [{0, 2}, {1, 3}, {0, 2}, {1, 3}]


def test_each_factor_is_read_from_its_own_scenes(network, reference):
    seen = mg.domain("orca:scenes=20").windows("test").observation
    fresh = network.predict(seen).positions
    network.observe(reference, factors=["side"])
    assert not network.observed[SHARE:].any() and network.observed[:SHARE].all()
    assert np.abs(network.predict(seen).positions - fresh).max() > 1e-4
    network.observe(reference, factors=["d"])
    apart = network.predict(seen).positions
    network.reset()
    np.testing.assert_array_equal(network.predict(seen).positions, fresh)
    network.observe(reference)
    np.testing.assert_allclose(network.predict(seen).positions, apart, atol=1e-6)
    with pytest.raises(SpecError, match=r"`factors=speed` of modular_factors is not known.*d, side"):
        network.observe(reference, factors=["speed"])


def test_a_unit_belongs_to_one_factor_with_a_large_penalty(data):
    network = ModularFactors().fit(*data, 0, names=NAMES, epochs=(0, 0, 40, 1), scenes=16, overlap=1000.0)
    for block in (1, 2):
        shares = pair_network.gates(network.stacked, block)[0]
        np.testing.assert_allclose(shares.sum(dim=0), 1, atol=1e-5)
        assert shares.max(dim=0).values.min() > 0.9


def test_a_gate_keeps_the_code_of_a_factor_away_from_the_units_of_the_other(network):
    weights = {name: value.clone() for name, value in network.stacked.items()}
    weights["modulator_gate.weight1"] = torch.full((2, 2, 16), -30.0)
    weights["modulator_gate.weight1"][:, 0, :8] = 30.0
    weights["modulator_gate.weight1"][:, 1, 8:] = 30.0
    x, codes = torch.randn(2, 5, 16), torch.randn(2, 1, 2 * SHARE)
    other = codes.clone()
    other[..., :SHARE] += 1
    moved = pair_network.modulate(x, codes, weights, 1) - pair_network.modulate(x, other, weights, 1)
    assert moved[..., :8].abs().min() > 0 and moved[..., 8:].abs().max() == 0


@pytest.mark.parametrize(
    ("names", "options", "reason"),
    [
        ((), {}, "none are named"),
        (["zara1"] * 4, {}, "zara1 does not have them"),
        (NAMES, {"labels": {"side": ["left"] * 4}}, r"factor `side` .* at least two must differ"),
        (NAMES, {"labels": {"d": [0.1, 0.5, 0.1, 0.5]}}, r"factor `side` .* each domain needs a label"),
    ],
)
def test_trainings_without_labels_are_refused(data, names, options, reason):
    with pytest.raises(PredictorError, match=reason):
        ModularFactors().fit(*data, 0, names=names, **options, epochs=(1, 1, 1, 1), scenes=16)


def test_it_satisfies_the_contract_of_a_predictor(network):
    check_predictor(network, mg.domain("orca:scenes=40"))
