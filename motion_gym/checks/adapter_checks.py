"""What is wrong with an adapter, a predictor around another one that learns while it runs: all findings at once.

``check_adapter`` raises, ``adapter_problems`` returns the findings. The rules are those of a predictor
(``motion_gym.checks.checker.PREDICTOR_RULES``) and those of ``ADAPTER_RULES``.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.checks.adapter_rules import (
    ADAPTER_RULES,
    apply_adapter_rules,
    apply_given_rule,
    domain_lessons,
    synthetic_lessons,
)
from motion_gym.checks.checker import Problem, listing, predictor_problems, reporter, title_of
from motion_gym.checks.predictor_rules import PREDICTOR_RULES
from motion_gym.checks.predictor_trials import Trial, domain_trial, synthetic_trial
from motion_gym.contract import Domain, MotionGymError, Predictor, PredictorError
from motion_gym.stepping.harness import ask, guarded

__all__ = ["ADAPTER_RULES", "adapter_problems", "check_adapter"]


def check_adapter(
    adapter: str | type | Predictor,
    of: str | type | Predictor = "modular_invariant",
    domain: str | Domain | None = None,
) -> None:
    """Hold an adapter to every rule of the contract, on small synthetic scenes that need no data.

    What it is given is not changed: it works on copies.

    Args:
        adapter: A name, a spec, ``"module:Class"`` or a class of adapters, whose constructor takes ``of``; or an
            instance that has observed nothing yet, and then what it was put around is not looked at.
        of: The predictor to put it around: a name, a spec, ``"module:Class"``, a class or an instance. One that must
            be fitted is fitted to a small training set.
        domain: Where the scenes come from instead; of those that an instance or ``of`` takes.

    Raises:
        PredictorError: it breaks rules, all of which are listed; or it cannot be put around this predictor.
        SpecError: there is no such adapter, predictor or domain.
    """
    problems = adapter_problems(adapter, of, domain)
    if problems:
        raise PredictorError(listing(title_of(adapter), "adapter", problems))


def adapter_problems(
    adapter: str | type | Predictor,
    of: str | type | Predictor = "modular_invariant",
    domain: str | Domain | None = None,
) -> list[Problem]:
    """Every rule that an adapter breaks; see ``check_adapter``."""
    problems: dict[str, Problem] = {}
    report = reporter(problems, {**PREDICTOR_RULES, **ADAPTER_RULES})
    place = None if domain is None else catalog.domain(domain)
    missing = [
        method
        for method in ("predict", "observe", "reset")
        if not isinstance(adapter, str) and not callable(getattr(adapter, method, None))
    ]
    if missing:
        report("adapter", f"{title_of(adapter)} has no method {', '.join(missing)}: define it.")
        return list(problems.values())
    by_name = isinstance(adapter, (str, type))
    source, trial = _ready(of if by_name else adapter, place)

    def make() -> Any:
        return catalog.adapter(adapter, source) if by_name else copy.deepcopy(source)  # type: ignore[arg-type]

    made = make()
    found = predictor_problems(made, place)
    for problem in found:
        report(problem.rule, problem.message)
    if {"predict", "forecast", "pure", "buffer", "copy"} & set(problems):
        return list(problems.values())  # nothing can be compared
    if place is None:
        seen = trial.truth.observation
        lessons = synthetic_lessons(seen.history.shape[2], np.diff(seen.scene).tolist())
    else:
        lessons = domain_lessons(place)
    apply_adapter_rules(made, lessons, report)
    if by_name:
        apply_given_rule(make, source, lessons, report)
    return list(problems.values())


def _ready(of: Any, domain: Domain | None) -> tuple[Any, Trial]:
    """A predictor that can be asked, and scenes that it does not refuse.

    Raises:
        PredictorError: it refuses all of them, or cannot be fitted.
    """
    if domain is not None:
        trials = [domain_trial(domain)]
    else:
        trials = [synthetic_trial(features, pairs) for pairs in (False, True) for features in (2, 3)]
    refused: MotionGymError | None = None
    for trial in trials:
        made = catalog.predictor(of) if isinstance(of, (str, type)) else copy.deepcopy(of)  # type: ignore[arg-type]
        try:
            if hasattr(made, "fit") and getattr(made, "fitted", False) is not True:
                guarded(made, "fit", *trial.training(), 0)
            ask(made, trial.truth.observation)
        except MotionGymError as error:
            refused = refused or error
        else:
            return made, trial
    where = "the windows of the domain" if domain is not None else "synthetic scenes of 1, 2 and 5 agents, or 2 alone"
    raise PredictorError(f"{title_of(of)} could not be asked to forecast {where}: {refused}") from refused
