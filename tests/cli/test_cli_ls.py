"""The command that explains whatever has a name."""

import re

import pytest

from motion_gym import catalog
from motion_gym.benchmarks.running import BENCHMARKS
from motion_gym.cli.explain import explanations, signature
from motion_gym.cli.main import main
from motion_gym.data.datasets import DATASETS
from motion_gym.metrics.errors import METRICS
from motion_gym.scoring.evaluation import PROTOCOLS
from tests.cli.command_line import fail

NAMES = [*catalog.DOMAINS, *catalog.PREDICTORS, *catalog.ADAPTERS, *BENCHMARKS, *PROTOCOLS, *DATASETS]


def said(capsys, name):
    main(["ls", name])
    return capsys.readouterr().out


@pytest.mark.parametrize("name", dict.fromkeys([*NAMES, *(metric.name for metric in METRICS)]))
def test_every_name_is_explained_without_pointers_elsewhere(name):
    for entry in explanations(name):
        assert entry["description"] and not re.search(r"[Ss]ee ``\w+``", entry["description"])
        assert not re.search(r"InitVar|->|'\w+( \| \w+)*'(?! *[,)])", entry["signature"])


def test_a_name_of_two_kinds_is_explained_twice(capsys):
    out = said(capsys, "style")
    adapter, _, benchmark = out.partition("\n\nbenchmark style\n\n")
    assert adapter.startswith("adapter style(of='modular_invariant', weights: str | Path | None = None, ")
    assert benchmark.startswith(
        "Style shift: crowds that keep another distance than those of training\n\n`motion-gym run"
    )
    assert (
        "    columns: 0.1 (orca:d=0.1), 0.2 (orca:d=0.2)," in benchmark and "    rows: constant_velocity, " in benchmark
    )
    assert said(capsys, "refine").startswith("predictor and adapter refine(")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("spurious", ["benchmark spurious", "`motion-gym run spurious`", "linear:sigma=relative", "Crossed: trained"]),
        ("planning", ["benchmark planning", "A roundabout, the others react", "kalman:of=linear"]),
        ("online", ["benchmark online", "columns: sudden, gradual, recurring", "ema_anchor:parts=all"]),
        ("ADE", ["metric ADE", "Mean displacement error", "Unit: m, or the unit of the domain; lower is better."]),
        ("minADE_20", ["metric minADE_20", "ADE of the best of 20 samples"]),
        ("MR_2m_{k}", ["metric MR_2m_{k}", "by all of {k} samples", "Unit: none, a share from 0 to 1"]),
        ("honest", ["protocol honest", "--protocol honest"]),
        ("eth_ucy", ["data set eth_ucy", "motion-gym data verify eth_ucy"]),
        ("ema_anchor", ["anchor: float = 0.01"]),
    ],
)
def test_other_kinds_are_explained(capsys, name, words):
    out = said(capsys, name)
    assert [word for word in words if word not in out] == []


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("hedge", ["of: Name of a predictor, or a predictor object, which is copied. Any predictor."]),
        ("hedge", ["memory: Number of recent, fully known scenes to read the style from; 0 disables the style."]),
        ("hedge", ["ridge: Precision of the prior in units of the noise precision; above 0."]),
        ("kalman_residual", ["weights: Name of shipped weights", "seed: Seed of the trained model to use"]),
        ("modular_invariant", ["penalty: Factor lambda"]),
    ],
)
def test_an_argument_of_a_parent_is_explained(capsys, name, lines):
    out = said(capsys, name)
    assert [line for line in lines if f"\n    {line}" not in out] == []


def test_a_signature_has_names_defaults_and_plain_types():
    class Own:
        def __init__(self, a, b: int = 3, *more: str, c: "float | None" = None, **others):
            pass

    assert signature(Own) == "(a, b: int = 3, *more: str, c: float | None = None, **others)"


def test_an_unknown_name_is_corrected(capsys):
    assert "nothing of the name `spurius`. Did you mean `spurious`?" in fail(capsys, "ls spurius").err
    assert "own_things.py is here: write `own_things:Standing` or " in fail(capsys, "ls own_things").err
