"""How rules run: each rule is a function that takes a trial and raises, and a report holds every outcome."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from motion_gym.catalog import suggest
from motion_gym.contract import DataError, MotionGymError, PredictorError, SpecError

Rules = Mapping[str, Callable[[Any], None]]
"""Rules by name, in the order in which they run. A rule takes a trial and raises CheckError if the rule is broken, or
NotChecked if it cannot be checked. The first line of its docstring is its description."""


class CheckError(MotionGymError, ValueError):
    """A rule of the contract is broken; the message says what was observed and what to do."""


class NotChecked(MotionGymError):
    """A rule cannot be checked; the message says why, and ``__cause__`` is the error that another rule reports."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of one rule.

    Attributes:
        rule: Name of the rule.
        status: ``kept``, ``broken``, ``skipped`` or ``not checked``.
        message: What was observed and what to do, or why the rule was not checked; empty if the rule is kept.
        cause: The error because of which the rule was not checked; empty if there is none.
    """

    rule: str
    status: str
    message: str = ""
    cause: str = ""

    def __str__(self) -> str:
        return f"{self.rule}: {self.message}"


@dataclass(frozen=True)
class CheckReport:
    """Every rule of a contract with its outcome.

    Attributes:
        title: Name of the predictor, adapter or domain.
        kind: ``predictor``, ``adapter`` or ``domain``.
        outcomes: One per rule, in the order in which the rules ran.
    """

    title: str
    kind: str
    outcomes: tuple[Outcome, ...]

    @property
    def problems(self) -> list[Outcome]:
        """The broken rules."""
        return [outcome for outcome in self.outcomes if outcome.status == "broken"]

    @property
    def ok(self) -> bool:
        """Whether no rule is broken."""
        return not self.problems

    def require_ok(self) -> None:
        """Raise an error that lists every broken rule, if there is one.

        Raises:
            SpecError: A domain breaks a rule.
            PredictorError: A predictor or an adapter breaks a rule.
        """
        if not self.ok:
            raise (SpecError if self.kind == "domain" else PredictorError)(str(self))

    def __str__(self) -> str:
        number = len(self.problems) or sum(outcome.status == "kept" for outcome in self.outcomes)
        rules = f"{number} {'rule' if number == 1 else 'rules'}"
        article = "an" if self.kind == "adapter" else "a"
        title = f"{self.title} breaks {rules} of the {self.kind} contract:"
        if self.ok:
            title = f"{self.title} keeps the contract of {article} {self.kind}: {rules} checked"
        lines = [title, *(f"- {problem}" for problem in self.problems)]
        lines += [f"- skipped: {outcome}" for outcome in self.outcomes if outcome.status == "skipped"]
        return "\n".join([*lines, *self._not_checked()])

    def _not_checked(self) -> list[str]:
        """One line for each reason why rules were not checked; a broken rule already reports the cause."""
        further = "" if self.ok else "further "
        rules: dict[str, list[str]] = {}
        for outcome in self.outcomes:
            if outcome.status == "not checked":
                cause = f" ({outcome.cause.rstrip('.')})" if outcome.cause and self.ok else ""
                rules.setdefault(f"{outcome.message}{cause}", []).append(outcome.rule)
        return [
            f"- {len(names)} {further}{'rule' if len(names) == 1 else 'rules'} not checked, because {reason}: "
            f"{', '.join(names)}"
            for reason, names in rules.items()
        ]


def broken_if(fault: Any, message: str) -> None:
    """Raise CheckError with the message if there is a fault."""
    if fault:
        raise CheckError(message)


def run_rules(rules: Rules, trial: Any, skip: Mapping[str, str], only: Collection[str]) -> tuple[Outcome, ...]:
    """Run each rule on a trial.

    Args:
        rules: Rules by name.
        trial: The argument of each rule.
        skip: Rules to leave out, each with the reason that the report prints.
        only: Rules to run; empty for all.

    Raises:
        SpecError: ``skip`` or ``only`` names an unknown rule, or a rule is skipped without a reason.
        DataError: Data is missing or damaged; no rule is at fault.
    """
    for name in (*skip, *only):
        if name not in rules:
            raise SpecError(f"There is no rule `{name}`.{suggest(name, rules)}")
    for name, reason in skip.items():
        if not isinstance(reason, str) or not reason.strip():
            raise SpecError(f"Rule `{name}` is skipped without a reason: write skip={{'{name}': 'reason'}}.")
    chosen = {name: rule for name, rule in rules.items() if not only or name in only or name in skip}
    return tuple(
        Outcome(name, "skipped", skip[name]) if name in skip else _outcome(name, rule, trial)
        for name, rule in chosen.items()
    )


def _outcome(name: str, rule: Callable[[Any], None], trial: Any) -> Outcome:
    try:
        rule(trial)
    except NotChecked as reason:
        return Outcome(name, "not checked", str(reason), str(reason.__cause__ or ""))
    except DataError:
        raise
    except MotionGymError as error:
        return Outcome(name, "broken", str(error))
    return Outcome(name, "kept")
