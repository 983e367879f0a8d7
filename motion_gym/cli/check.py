"""The verb that holds something to the contract, and looks for leaks."""

from __future__ import annotations

from typing import Annotated, Any

import tyro

from motion_gym import catalog
from motion_gym.cli.output import console, say
from motion_gym.contract import DataError, SpecError
from motion_gym.scoring.evaluation import BASELINE
from motion_gym.stepping.harness import ready

Thing = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="THING")]


def check(
    thing: Thing,
    domain: str = "orca:scenes=40",
    of: Annotated[str | None, tyro.conf.arg(metavar="PREDICTOR")] = None,
) -> None:
    """Hold a predictor, an adapter or a domain to the contract, and look for leaks of the future on both clocks.

    Args:
        thing: Predictor, adapter or domain: your own (module:Class), a name or a spec.
        domain: For a predictor or an adapter: the domain on which leaks are looked for.
        of: For an adapter: the predictor to put it around, by default modular_invariant. Your own class is checked as
            an adapter if this is given.
    """
    from motion_gym.checks.adapter_checks import check_adapter
    from motion_gym.checks.checker import check_domain, check_predictor
    from motion_gym.checks.leaks import leak_probe

    predictor: Any
    if of is not None or catalog.parse_spec(thing)[0] in catalog.ADAPTERS:
        place, of = catalog.domain(domain), of or "modular_invariant"
        check_adapter(thing, of, place)
        say(f"{thing} around {of} keeps the contract of an adapter.")
        predictor = catalog.adapter(thing, ready(of, place))
    elif _is_predictor(thing):
        place, predictor = catalog.domain(domain), thing
        check_predictor(thing, domain=place)
        say(f"{thing} keeps the contract of a predictor.")
    else:
        place, predictor = catalog.domain(thing), BASELINE
        check_domain(place)
        say(f"{thing} keeps the contract of a domain.")
    # An oracle reads the world by permission, and simulates whole windows.
    oracle = hasattr(catalog.predictor(predictor), "know")
    for clock in ("windows",) if oracle else ("windows", "stream"):
        found = leak_probe(place, predictor, clock=clock)
        console.print(str(found), highlight=False, markup=False)
        if not found.ok:
            raise DataError(f"{thing} leaks the future; see above.")


def _is_predictor(thing: str) -> bool:
    target, _ = catalog.parse_spec(thing)
    name, _, own = target.partition(":")
    known = {**catalog.PREDICTORS, **catalog.DOMAINS}
    if name in known:
        return name in catalog.PREDICTORS
    if not own:
        raise SpecError(
            f"There is no predictor or domain `{name}`.{catalog.suggest(name, known)} Your own: `module:Class`."
        )
    kind = catalog.load_class(target)
    if not any(hasattr(kind, method) for method in ("predict", "windows", "recordings")):
        raise SpecError(f"{target} is neither a predictor (method `predict`) nor a domain (`windows`, `recordings`).")
    return hasattr(kind, "predict")
