"""What is wrong with a predictor or a domain: every rule of the contract, all findings at once.

``check_predictor`` and ``check_domain`` raise; ``predictor_problems`` and ``domain_problems`` return the findings. The
rules are listed in ``PREDICTOR_RULES`` and ``DOMAIN_RULES``. ``adapter_checks`` is the same for adapters.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from motion_gym import catalog
from motion_gym.checks.domain_rules import DOMAIN_RULES, apply_domain_rules
from motion_gym.checks.predictor_rules import PREDICTOR_RULES, apply_predictor_rules
from motion_gym.contract import Domain, Predictor, PredictorError, SpecError
from motion_gym.stepping.harness import name_of

__all__ = [
    "DOMAIN_RULES",
    "PREDICTOR_RULES",
    "Problem",
    "check_domain",
    "check_predictor",
    "domain_problems",
    "predictor_problems",
]


@dataclass(frozen=True)
class Problem:
    """One broken rule.

    Attributes:
        rule: Short name, a key of ``PREDICTOR_RULES``, ``DOMAIN_RULES`` or ``ADAPTER_RULES``.
        message: What was seen, and what to do.
    """

    rule: str
    message: str

    def __str__(self) -> str:
        return f"{self.rule}: {self.message}"


def check_predictor(predictor: str | type | Predictor, domain: str | Domain | None = None) -> None:
    """Hold a predictor to every rule of the contract, on small synthetic scenes that need no data.

    What it is given is not changed: it works on copies. A predictor that can be fitted, and says not that it is
    (``fitted``), is fitted to a small synthetic training set. One that refuses histories of x and y alone by a
    PredictorError is given a third feature, and one that refuses scenes of 1, 2 and 5 agents is given pairs.

    Args:
        predictor: A name, a spec, ``"module:Class"``, a class or an instance.
        domain: Where the scenes come from instead: for an oracle, of which little can be checked without, and for a
            predictor that is made for particular scenes.

    Raises:
        PredictorError: it breaks rules; all of them are listed.
        SpecError: there is no such predictor or domain.
    """
    problems = predictor_problems(predictor, domain)
    if problems:
        raise PredictorError(listing(title_of(predictor), "predictor", problems))


def predictor_problems(predictor: str | type | Predictor, domain: str | Domain | None = None) -> list[Problem]:
    """Every rule that a predictor breaks; see ``check_predictor``."""
    problems: dict[str, Problem] = {}
    place = None if domain is None else catalog.domain(domain)
    report = reporter(problems, PREDICTOR_RULES)
    if not isinstance(predictor, str) and not callable(getattr(predictor, "predict", None)):
        report("predict", f"{title_of(predictor)} has no method predict(observation, samples=1, seed=0): define it.")
    else:
        apply_predictor_rules(predictor, place, report, problems)
    return list(problems.values())


def check_domain(domain: str | type | Domain) -> None:
    """Hold a domain to every rule of the contract.

    Args:
        domain: A name, a spec, ``"module:Class"``, a class or an instance.

    Raises:
        SpecError: it breaks rules, all of which are listed; or there is no such domain.
        DataError: its data is missing or damaged.
    """
    problems = domain_problems(domain)
    if problems:
        raise SpecError(listing(title_of(domain), "domain", problems))


def domain_problems(domain: str | type | Domain) -> list[Problem]:
    """Every rule that a domain breaks; see ``check_domain``."""
    problems: dict[str, Problem] = {}
    report = reporter(problems, DOMAIN_RULES)
    missing = [
        member
        for member in ("card", "recordings", "windows", "reference")
        if not isinstance(domain, str) and not hasattr(domain, member)
    ]
    if missing:
        report("members", f"{title_of(domain)} has no {', '.join(missing)}: see motion_gym.contract.Domain.")
    else:
        apply_domain_rules(catalog.domain(domain), report)  # type: ignore[arg-type]  # a class is welcome too
    return list(problems.values())


def reporter(problems: dict[str, Problem], rules: Mapping[str, str]) -> Callable[[str, str], None]:
    """Keeps the first finding of each rule: the others most often have the same cause."""

    def report(rule: str, message: str) -> None:
        if rule not in rules:
            raise KeyError(f"There is no rule `{rule}`.{catalog.suggest(rule, rules)}")
        problems.setdefault(rule, Problem(rule, message))

    return report


def title_of(thing: Any) -> str:
    """Name of what is checked: a spec, a class or an instance."""
    if isinstance(thing, str):
        return thing
    return thing.__name__ if inspect.isclass(thing) else name_of(thing)


def listing(title: str, kind: str, problems: list[Problem]) -> str:
    """All findings as one message."""
    rules = "1 rule" if len(problems) == 1 else f"{len(problems)} rules"
    return f"{title} breaks {rules} of the {kind} contract:\n" + "\n".join(f"- {p}" for p in problems)
