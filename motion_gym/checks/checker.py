"""Check a predictor, an adapter or a domain against every rule of its contract, and report all broken rules at once.

``check_predictor``, ``check_adapter`` and ``check_domain`` raise; ``run_checks`` returns a report.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Collection, Mapping
from typing import Any

from motion_gym import catalog
from motion_gym.checks.adapter_rules import ADAPTER_RULES
from motion_gym.checks.adapter_trials import AdapterTrial
from motion_gym.checks.domain_rules import DOMAIN_RULES, DomainTrial
from motion_gym.checks.predictor_method_rules import PREDICTOR_RULES
from motion_gym.checks.predictor_trials import PredictorTrial
from motion_gym.checks.report import CheckReport, NotChecked, Outcome, Rules, run_rules
from motion_gym.contract import Domain, MotionGymError, Predictor, PredictorError, SpecError
from motion_gym.stepping.harness import copied, name_of

KINDS: Mapping[str, Rules] = {
    "predictor": PREDICTOR_RULES,
    "adapter": {**PREDICTOR_RULES, **ADAPTER_RULES},
    "domain": DOMAIN_RULES,
}
PREDICTOR = "modular_invariant"
"""The predictor that is adapted if none is named."""


def rules(kind: str) -> dict[str, str]:
    """Description of every rule by its name, in the order in which they run.

    Args:
        kind: ``predictor``, ``adapter`` or ``domain``.

    Raises:
        SpecError: there is no such kind.
    """
    if kind not in KINDS:
        raise SpecError(f"There are no rules for a `{kind}`.{catalog.suggest(str(kind), KINDS)}")
    return {name: (rule.__doc__ or "").partition("\n")[0].rstrip(".") for name, rule in KINDS[kind].items()}


def check_predictor(
    predictor: str | type | Predictor,
    domain: str | Domain | None = None,
    *,
    skip: Mapping[str, str] | None = None,
    only: Collection[str] = (),
) -> None:
    """Check a predictor against every rule of the contract, on small synthetic scenes that need no data.

    The predictor is not changed: the rules work on copies. A predictor that has ``fit`` and whose ``fitted`` is not
    True is fitted to a small synthetic training set. A predictor that refuses histories of x and y alone by a
    PredictorError gets a third feature, and a predictor that refuses scenes of 1, 2 and 5 agents gets pairs.

    Args:
        predictor: A name, a spec, ``"module:Class"``, a class or an instance.
        domain: Domain that gives the scenes instead; needed for an oracle, and for a predictor made for particular
            scenes.
        skip: Rules to leave out, each with its reason; see ``motion_gym.checks.rules``.
        only: Rules to run; empty for all.

    Raises:
        PredictorError: The predictor breaks rules, all of which are listed, or cannot be copied.
        SpecError: There is no such predictor, domain or rule.
    """
    run_checks(predictor, "predictor", domain=domain, skip=skip, only=only).require_ok()


def check_adapter(
    adapter: str | type | Predictor,
    of: str | type | Predictor = PREDICTOR,
    domain: str | Domain | None = None,
    *,
    skip: Mapping[str, str] | None = None,
    only: Collection[str] = (),
) -> None:
    """Check an adapter against every rule of a predictor and of an adapter, on small synthetic scenes.

    Neither the adapter nor the predictor is changed: the rules work on copies.

    Args:
        adapter: A name, a spec, ``"module:Class"`` or a class of adapters, whose constructor takes ``of``; or an
            instance that has observed nothing yet, whose inner predictor is not checked.
        of: The predictor to adapt: a name, a spec, ``"module:Class"``, a class or an instance. It is fitted to a small
            training set if it must be fitted.
        domain: Domain that gives the scenes instead.
        skip: Rules to leave out, each with its reason.
        only: Rules to run; empty for all.

    Raises:
        PredictorError: The adapter breaks rules, all of which are listed; or it cannot adapt this predictor.
        SpecError: There is no such adapter, predictor, domain or rule.
    """
    run_checks(adapter, "adapter", of=of, domain=domain, skip=skip, only=only).require_ok()


def check_domain(
    domain: str | type | Domain, *, skip: Mapping[str, str] | None = None, only: Collection[str] = ()
) -> None:
    """Check a domain against every rule of the contract.

    Args:
        domain: A name, a spec, ``"module:Class"``, a class or an instance.
        skip: Rules to leave out, each with its reason.
        only: Rules to run; empty for all.

    Raises:
        SpecError: The domain breaks rules, all of which are listed; or there is no such domain or rule.
        DataError: Its data is missing or damaged.
    """
    run_checks(domain, "domain", skip=skip, only=only).require_ok()


def run_checks(
    thing: Any,
    kind: str,
    *,
    domain: str | Domain | None = None,
    of: Any = PREDICTOR,
    skip: Mapping[str, str] | None = None,
    only: Collection[str] = (),
) -> CheckReport:
    """Run the rules of a kind; arguments as for ``check_predictor``, ``check_adapter`` and ``check_domain``.

    Returns:
        The report; ``str`` of it names every broken, skipped and unchecked rule.

    Raises:
        SpecError: There is no such kind, predictor, adapter, domain or rule.
        PredictorError: A predictor cannot be copied, or the predictor to adapt cannot forecast the scenes.
        DataError: Data is missing or damaged.
    """
    rules(kind)
    place = None if domain is None else catalog.domain(domain)
    source = _source(of if isinstance(thing, (str, type)) else thing, place) if kind == "adapter" else None
    trial: Any
    try:
        if kind == "domain":
            trial = DomainTrial(catalog.domain(thing))
        elif kind == "predictor":
            trial = PredictorTrial(_maker(thing), place)
        else:
            trial = _adapter_trial(thing, source, place)
    except SpecError as error:
        if isinstance(thing, str):
            raise
        first = {"predictor": "predict", "adapter": "adapter", "domain": "members"}[kind]
        return CheckReport(_title(thing), kind, (Outcome(first, "broken", str(error)),))
    return CheckReport(_title(thing), kind, run_rules(KINDS[kind], trial, skip or {}, only))


def _maker(predictor: Any) -> Callable[[], Any]:
    """A function that makes a predictor from a name or a class, or copies an instance; SpecError if it is none."""
    make = catalog.predictor if isinstance(predictor, (str, type)) else copied
    catalog.predictor(make(predictor))
    return functools.partial(make, predictor)


def _source(predictor: Any, place: Domain | None) -> Any:
    """The predictor to adapt, fitted if it must be.

    Raises:
        PredictorError: It cannot forecast the scenes.
    """
    trial = PredictorTrial(_maker(predictor), place)
    try:
        ready = trial.ready()
        trial.ask(ready)
    except MotionGymError as refusal:
        error = refusal.__cause__ if isinstance(refusal, NotChecked) and refusal.__cause__ else refusal
        where = "the windows of the domain" if place is not None else "synthetic scenes of 1, 2 and 5 agents, or pairs"
        raise PredictorError(f"{_title(predictor)} could not be asked to forecast {where}: {error}") from error
    return ready


def _adapter_trial(adapter: Any, source: Any, place: Domain | None) -> AdapterTrial:
    if not isinstance(adapter, (str, type)):
        return AdapterTrial(functools.partial(copied, source), place)
    around = functools.partial(catalog.adapter, adapter)
    return AdapterTrial(functools.partial(copied, copied(around(source))), place, source, around)


def _title(thing: Any) -> str:
    """Name of a spec, a class or an instance."""
    if isinstance(thing, str):
        return thing
    return thing.__name__ if inspect.isclass(thing) else name_of(thing)
