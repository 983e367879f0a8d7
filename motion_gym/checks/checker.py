"""Check a predictor, an adapter or a domain against every rule of its contract, and report all findings at once.

``check_predictor``, ``check_adapter`` and ``check_domain`` raise; ``run_checks`` returns a report.
"""

from __future__ import annotations

import copy
import inspect
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.checks.adapter_rules import ADAPTER_METHODS, ADAPTER_RULES
from motion_gym.checks.adapter_trials import AdapterTrial, domain_lessons, synthetic_lessons
from motion_gym.checks.domain_rules import DOMAIN_RULES, DomainTrial
from motion_gym.checks.predictor_method_rules import PREDICTOR_RULES
from motion_gym.checks.predictor_trials import PredictorTrial
from motion_gym.checks.report import CheckReport, Outcome, Rules, check_selection, describe, run_rules
from motion_gym.contract import Domain, MotionGymError, Predictor, PredictorError, SpecError
from motion_gym.stepping.harness import name_of

KINDS: Mapping[str, Rules] = MappingProxyType(
    {
        "predictor": PREDICTOR_RULES,
        "adapter": MappingProxyType({**PREDICTOR_RULES, **ADAPTER_RULES}),
        "domain": DOMAIN_RULES,
    }
)
NO_SKIPS: Mapping[str, str] = MappingProxyType({})
PREDICTOR = "modular_invariant"
"""The predictor that an adapter is put around if none is named."""


def rules(kind: str) -> dict[str, str]:
    """Description of every rule by its name, in the order in which they run.

    Args:
        kind: ``predictor``, ``adapter`` or ``domain``.

    Raises:
        SpecError: there is no such kind.
    """
    if kind not in KINDS:
        raise SpecError(f"There are no rules for a `{kind}`.{catalog.suggest(str(kind), KINDS)}")
    return describe(KINDS[kind])


def check_predictor(
    predictor: str | type | Predictor,
    domain: str | Domain | None = None,
    *,
    skip: Mapping[str, str] = NO_SKIPS,
    only: Collection[str] = (),
) -> None:
    """Hold a predictor to every rule of the contract, on small synthetic scenes that need no data.

    The predictor is not changed: the rules work on copies. A predictor that has ``fit`` and whose ``fitted`` is not
    True is fitted to a small synthetic training set. One that refuses histories of x and y alone by a PredictorError
    is given a third feature, and one that refuses scenes of 1, 2 and 5 agents is given pairs.

    Args:
        predictor: A name, a spec, ``"module:Class"``, a class or an instance.
        domain: Domain to take the scenes from instead; needed for an oracle, and for a predictor that is made for
            particular scenes.
        skip: Rules to leave out, each with its reason; see ``motion_gym.checks.rules``.
        only: Rules to run; empty for all.

    Raises:
        PredictorError: it breaks rules; all of them are listed.
        SpecError: there is no such predictor, domain or rule.
    """
    report = run_checks(predictor, "predictor", domain=domain, skip=skip, only=only)
    if not report.ok:
        raise PredictorError(str(report))


def check_adapter(
    adapter: str | type | Predictor,
    of: str | type | Predictor = PREDICTOR,
    domain: str | Domain | None = None,
    *,
    skip: Mapping[str, str] = NO_SKIPS,
    only: Collection[str] = (),
) -> None:
    """Hold an adapter to every rule of a predictor and of an adapter, on small synthetic scenes that need no data.

    Neither the adapter nor the predictor is changed: the rules work on copies.

    Args:
        adapter: A name, a spec, ``"module:Class"`` or a class of adapters, whose constructor takes ``of``; or an
            instance that has observed nothing yet, whose inner predictor is then not looked at.
        of: The predictor to put it around: a name, a spec, ``"module:Class"``, a class or an instance. One that must
            be fitted is fitted to a small training set.
        domain: Domain to take the scenes from instead.
        skip: Rules to leave out, each with its reason.
        only: Rules to run; empty for all.

    Raises:
        PredictorError: it breaks rules, all of which are listed; or it cannot be put around this predictor.
        SpecError: there is no such adapter, predictor, domain or rule.
    """
    report = run_checks(adapter, "adapter", of=of, domain=domain, skip=skip, only=only)
    if not report.ok:
        raise PredictorError(str(report))


def check_domain(
    domain: str | type | Domain, *, skip: Mapping[str, str] = NO_SKIPS, only: Collection[str] = ()
) -> None:
    """Hold a domain to every rule of the contract.

    Args:
        domain: A name, a spec, ``"module:Class"``, a class or an instance.
        skip: Rules to leave out, each with its reason.
        only: Rules to run; empty for all.

    Raises:
        SpecError: it breaks rules, all of which are listed; or there is no such domain or rule.
        DataError: its data is missing or damaged.
    """
    report = run_checks(domain, "domain", skip=skip, only=only)
    if not report.ok:
        raise SpecError(str(report))


def run_checks(
    thing: Any,
    kind: str,
    *,
    domain: str | Domain | None = None,
    of: Any = PREDICTOR,
    skip: Mapping[str, str] = NO_SKIPS,
    only: Collection[str] = (),
) -> CheckReport:
    """Run the rules of a kind on a thing; arguments as for ``check_predictor``, ``check_adapter``, ``check_domain``.

    Returns:
        The report; ``str`` of it names every broken, skipped and unchecked rule.
    """
    rules(kind)
    check_selection(KINDS[kind], skip, only)
    first, needed = {
        "predictor": ("predict", ("predict",)),
        "adapter": ("adapter", ADAPTER_METHODS),
        "domain": ("members", ()),
    }[kind]
    missing = [name for name in needed if not isinstance(thing, str) and not hasattr(thing, name)]
    if missing:
        problem = Outcome(first, "broken", f"it has no {', '.join(missing)}: define what motion_gym.contract asks for.")
        return CheckReport(_title(thing), kind, (problem,))
    place = None if domain is None else catalog.domain(domain)
    if kind == "predictor":
        outcomes = _predictor_outcomes(thing, place, skip, only)
    elif kind == "adapter":
        outcomes = _adapter_outcomes(thing, of, place, skip, only)
    else:
        try:
            trial = DomainTrial(catalog.domain(thing))
        except SpecError as error:
            if isinstance(thing, str):
                raise
            return CheckReport(_title(thing), kind, (Outcome(first, "broken", str(error)),))
        outcomes = run_rules({"members": DOMAIN_RULES["members"]}, trial, skip, only)
        if not any(outcome.status == "broken" for outcome in outcomes):
            others = {name: rule for name, rule in DOMAIN_RULES.items() if name != "members"}
            outcomes += run_rules(others, trial, skip, only)
    return CheckReport(_title(thing), kind, tuple(outcomes))


def _predictor_outcomes(
    predictor: Any, place: Domain | None, skip: Mapping[str, str], only: Collection[str]
) -> list[Outcome]:
    if isinstance(predictor, (str, type)):
        catalog.predictor(predictor)  # type: ignore[arg-type]  # says what is wrong with a name
        return run_rules(PREDICTOR_RULES, PredictorTrial(lambda: catalog.predictor(predictor), place), skip, only)  # type: ignore[arg-type]
    try:
        copy.deepcopy(predictor)
    except Exception as error:
        text = f"copy.deepcopy raised {type(error).__name__}: {error}; give its class to have the other rules checked."
        return [Outcome("copy", "broken", text)]
    return run_rules(PREDICTOR_RULES, PredictorTrial(lambda: copy.deepcopy(predictor), place), skip, only)


def _adapter_outcomes(
    adapter: Any, of: Any, place: Domain | None, skip: Mapping[str, str], only: Collection[str]
) -> list[Outcome]:
    by_name = isinstance(adapter, (str, type))
    source = of if by_name else adapter
    inner = PredictorTrial(
        lambda: catalog.predictor(source) if isinstance(source, (str, type)) else copy.deepcopy(source),  # type: ignore[arg-type]
        place,
    )
    try:
        ready = inner.ready()
        inner.ask(ready)
    except SpecError:
        raise  # a misspelt name
    except MotionGymError as error:
        where = "the windows of the domain" if place is not None else "synthetic scenes of 1, 2 and 5 agents, or pairs"
        raise PredictorError(f"{_title(source)} could not be asked to forecast {where}: {error}") from error

    def around(predictor: Any) -> Any:
        return catalog.adapter(adapter, predictor) if by_name else predictor

    instance = copy.deepcopy(around(ready))
    outcomes = _predictor_outcomes(instance, place, skip, only)
    seen = inner.scenes.truth.observation
    sizes = np.diff(seen.scene).tolist()
    lessons = domain_lessons(place) if place is not None else synthetic_lessons(seen.history.shape[2], sizes)
    own = PredictorTrial(lambda: copy.deepcopy(instance), place)
    trial = AdapterTrial(own, lessons, ready if by_name else None, around)
    return outcomes + run_rules(ADAPTER_RULES, trial, skip, only)


def _title(thing: Any) -> str:
    """Name of what is checked: a spec, a class or an instance."""
    if isinstance(thing, str):
        return thing
    return thing.__name__ if inspect.isclass(thing) else name_of(thing)
