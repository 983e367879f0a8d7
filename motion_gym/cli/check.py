"""The command that tests a predictor, an adapter or a domain against the contract, and looks for leaks."""

from __future__ import annotations

from typing import Annotated, Any

import tyro

from motion_gym import catalog
from motion_gym.benchmarks.reports.table import Table
from motion_gym.cli.output import console
from motion_gym.contract import DataError, SpecError
from motion_gym.own_classes import class_hint
from motion_gym.scoring.evaluation import BASELINE
from motion_gym.specs import file_hint
from motion_gym.stepping.harness import ready

Thing = Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="THING")]


def check(
    thing: Thing = None,
    domain: str = "orca:scenes=40",
    of: Annotated[str | None, tyro.conf.arg(metavar="PREDICTOR")] = None,
    list: bool = False,
    only: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="RULE")] = [],  # noqa: B006
    skip: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="RULE=REASON")] = [],  # noqa: B006
) -> None:
    """Test a predictor, an adapter or a domain against the contract, and look for leaks of the future on both clocks.

    Args:
        thing: Predictor, adapter or domain: your own (module:Class), a name or a spec.
        domain: For a predictor or an adapter: the domain on which the leak probe runs.
        of: For an adapter: the predictor to put it around, by default modular_invariant. Your own class is checked as
            an adapter if this is given.
        list: List the rules of each kind and check nothing.
        only: Run only this rule, and no leak probe; give it once for each rule.
        skip: Leave out a rule, with the reason that the report prints; give it once for each rule.
    """
    from motion_gym.checks.checker import KINDS, PREDICTOR, rules, run_checks
    from motion_gym.checks.inspection import warn_about
    from motion_gym.checks.leaks import leak_probe

    if list:
        for kind in KINDS:
            console.print(Table(f"Rules of {kind}s", ("rule", "description"), [*rules(kind).items()]))
        return
    if thing is None:
        raise SpecError("Nothing was named to check: motion-gym check THING, or motion-gym check --list.")
    reasons = dict(part.partition("=")[::2] for part in skip)
    place = catalog.domain(domain)
    predictor: Any = thing
    kind = "adapter" if of is not None or catalog.parse_spec(thing)[0] in catalog.ADAPTERS else "predictor"
    if kind == "predictor" and not _is_predictor(thing):
        kind, place, predictor = "domain", catalog.domain(thing), BASELINE
    of = of or PREDICTOR
    report = run_checks(thing, kind, of=of, domain=None if kind == "domain" else place, only=only, skip=reasons)
    report.require_ok()
    text = str(report).replace(thing, f"{thing} around {of}", 1) if kind == "adapter" else str(report)
    console.print(text, highlight=False, markup=False)
    if kind == "domain":
        warn_about([place])
    if only:
        return
    if kind == "adapter":
        predictor = catalog.adapter(thing, ready(of, place))
    # An oracle may read the domain, and simulates whole windows.
    oracle = hasattr(catalog.predictor(predictor), "know")
    for clock in ("windows",) if oracle else ("windows", "stream"):
        probe = leak_probe(predictor, place, clock=clock)
        console.print(str(probe), highlight=False, markup=False)
        if not probe.ok:
            raise DataError(f"{thing} leaks the future; see above.")


def _is_predictor(thing: str) -> bool:
    target, _ = catalog.parse_spec(thing)
    name, _, own = target.partition(":")
    known = {**catalog.PREDICTORS, **catalog.DOMAINS}
    if name in known:
        return name in catalog.PREDICTORS
    if not own:
        hint = class_hint(name) or file_hint(thing) or f"{catalog.suggest(name, known)} Your own: `module:Class`."
        raise SpecError(f"There is no predictor or domain `{name}`.{hint}")
    kind = catalog.load_class(target)
    if not any(hasattr(kind, method) for method in ("predict", "recordings")):
        raise SpecError(f"{target} is neither a predictor (method `predict`) nor a domain (`recordings`).")
    return hasattr(kind, "predict")
