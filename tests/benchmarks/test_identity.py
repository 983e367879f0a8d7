"""The identity of a run changes when the settings of a shipped predictor change."""

import inspect

import pytest

from motion_gym import catalog
from motion_gym.benchmarks.identity import AROUND, VERSIONS, facts_of
from motion_gym.envs.orca import Orca

pytest.importorskip("torch")
LEARNED = (
    "of='modular_invariant', weights=None, seed=None, memory=16, parts='all', rate=0.0001, optimiser='adam', every=1, "
    "steps=1, batch=16, buffer=128, least=12"
)
SETTINGS = {
    "constant_velocity": (1, "velocity='last'"),
    "kalman_velocity": (2, "q=None, r=None, select='mixture'"),
    "kalman_residual": (1, "weights=None, seed=None, bank=True, neighbours=True, heading=True"),
    "stand_still": (1, ""),
    "linear": (1, "sigma=False, ridge=1.0"),
    "erm": (1, "weights=None, seed=None, sigma=True, counterfactual=False"),
    "counterfactual": (1, "weights=None, seed=None, sigma=True, counterfactual=True"),
    "erm_no_sigma": (1, "weights=None, seed=None, sigma=False, counterfactual=False"),
    "invariant": (1, "weights=None, seed=None, sigma=True, penalty=5.0, unbiased=True"),
    "vrex": (1, "weights=None, seed=None, sigma=True, penalty=10.0"),
    "group_dro": (1, "weights=None, seed=None, sigma=True, rate=0.01"),
    "style_erm": (1, "weights=None, seed=None, penalty=0.0"),
    "style_invariant": (1, "weights=None, seed=None, penalty=1.0"),
    "modular": (1, "weights=None, seed=None, penalty=0.0"),
    "modular_invariant": (1, "weights=None, seed=None, penalty=1.0"),
    "modular_factors": (1, "weights=None, seed=None, penalty=0.0"),
    "modular_stgat": (1, "weights=None, seed=None, sigma=False"),
    "transfer": (
        1,
        "of='modular_invariant', weights=None, seed=None, parts='modulator', epochs=None, rate=None, style_weight=0.05",
    ),
    "refine": (1, "of='modular_invariant', weights=None, seed=None, steps=3, rate=0.001, memory=0"),
    "ego_erm": (1, "weights=None, seed=None"),
    "ego_modular": (1, "weights=None, seed=None"),
    "heatmap": (1, "weights=None, seed=None"),
    "orca_oracle": (2, ""),
    "constant_acceleration": (1, "steps=4"),
    "constant_turn": (1, "steps=4, slowest=0.3"),
    "idm_oracle": (1, ""),
    "none": (1, "of='constant_velocity', weights=None, seed=None"),
    "style": (1, "of='modular_invariant', weights=None, seed=None, memory=16"),
    "finetune": (1, f"{LEARNED}, anchor=0.0"),
    "ema_anchor": (1, f"{LEARNED}, anchor=0.01"),
    "kalman": (1, "of='modular_invariant', weights=None, seed=None, memory=16, ridge=10.0, forgetting=0.99"),
    "hedge": (
        3,
        "of='modular_invariant', weights=None, seed=None, memory=64, recent=16, experts='constant_velocity "
        "constant_velocity:velocity=4 kalman_velocity', ridge=10.0, forgetting=0.99, prior=0.8, recall=0.9, share=0.02",
    ),
    "ekf": (
        1,
        "of='modular_invariant', weights=None, seed=None, memory=16, parts='last_layer', spread=0.03, drift=0.0001, "
        "noise=0.1, average=0.5, gate=5.0, agents=4, every=1, least=12",
    ),
}
"""Version of each shipped predictor and adapter, and its settings at that version."""


def settings(name):
    """Defaults of the parameters of a predictor, with the parameters that the name implies."""
    entry = {**catalog.PREDICTORS, **catalog.ADAPTERS}[name]
    parameters = inspect.signature(catalog.load_class(entry.target)).parameters.values()
    defaults = {p.name: p.default for p in parameters if p.default is not p.empty} | dict(entry.parameters)
    return ", ".join(f"{key}={value!r}" for key, value in defaults.items())


@pytest.mark.parametrize("name", {**catalog.PREDICTORS, **catalog.ADAPTERS})
def test_settings_of_a_shipped_predictor_do_not_change_without_its_version(name):
    """Stored runs name a predictor without its defaults, so that only a version tells other settings apart."""
    assert (VERSIONS.get(name, 1), settings(name)) == SETTINGS[name], (
        f"A default of {name} has changed: raise identity.VERSIONS[{name!r}], and update SETTINGS"
    )


def test_identities_name_the_default_inner_predictor():
    of = {}
    for name, entry in catalog.PREDICTORS.items():
        parameters = inspect.signature(catalog.load_class(entry.target)).parameters
        of |= {name: parameters["of"].default} if "of" in parameters else {}
    assert of == AROUND


class OrcaWithWind(Orca):
    """As a later version might be."""

    def __init__(self, d=0.3, agents=2, radius=5.0, horizon=2.0, speed=1.0, seed=0, scenes=None, wind=None):
        super().__init__(d, agents, radius, horizon, speed, seed, scenes)
        self.wind = wind


def test_a_parameter_that_is_none_by_default_can_be_added_without_a_new_identity():
    now = facts_of(Orca(d=0.4)).spec
    assert now == facts_of(OrcaWithWind(d=0.4)).spec == "orca:d=0.4,agents=2,radius=5.0,horizon=2.0,speed=1.0,seed=0"
    assert facts_of(OrcaWithWind(d=0.4, wind=1.5)).spec == f"{now},wind=1.5"
