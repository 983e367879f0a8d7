"""How rules are run: each rule is a function that takes a trial and raises, and a report holds every outcome."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from motion_gym.catalog import suggest
from motion_gym.contract import DataError, MotionGymError, SpecError

Rule = Callable[[Any], None]
"""Takes a trial; raises CheckError if the rule is broken, NotChecked if it cannot be checked."""
Rules = Mapping[str, Rule]
"""Rules by name, in the order in which they run. The first line of a rule's docstring is its description."""


class CheckError(MotionGymError, ValueError):
    """A rule of the contract is broken; the message says what was seen and what to do."""


class NotChecked(MotionGymError):
    """A rule cannot be checked; the message says why."""


@dataclass(frozen=True)
class Outcome:
    """What became of one rule.

    Attributes:
        rule: Name of the rule.
        status: ``kept``, ``broken``, ``skipped`` or ``not checked``.
        message: What was seen and what to do, or why the rule was left out; empty if it is kept.
    """

    rule: str
    status: str
    message: str = ""

    def __str__(self) -> str:
        return f"{self.rule}: {self.message}"


@dataclass(frozen=True)
class CheckReport:
    """Every rule of a contract with its outcome.

    Attributes:
        title: What was checked.
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

    def __str__(self) -> str:
        kept = sum(outcome.status == "kept" for outcome in self.outcomes)
        if self.ok:
            lines = [f"{self.title} keeps the contract of {_article(self.kind)}: {kept} {_rules(kept)} checked"]
        else:
            broken = len(self.problems)
            lines = [f"{self.title} breaks {broken} {_rules(broken)} of the {self.kind} contract:"]
        lines += [f"- {problem}" for problem in self.problems]
        for status in ("skipped", "not checked"):
            lines += [f"- {status}: {outcome}" for outcome in self.outcomes if outcome.status == status]
        return "\n".join(lines)


def broken_if(fault: Any, message: str) -> None:
    """Raise CheckError with the message if there is a fault."""
    if fault:
        raise CheckError(message)


def describe(rules: Rules) -> dict[str, str]:
    """Description of each rule by its name."""
    return {name: (rule.__doc__ or "").strip().splitlines()[0].rstrip(".") for name, rule in rules.items()}


def run_rules(
    rules: Rules, trial: Any, skip: Mapping[str, str] | None = None, only: Collection[str] = ()
) -> list[Outcome]:
    """Run rules on a trial, each by itself.

    Args:
        rules: Rules by name.
        trial: What the rules take.
        skip: Rules to leave out, each with the reason that the report prints.
        only: Rules to run; empty for all.

    Raises:
        DataError: data is missing or damaged, which is no fault of what is checked.
    """
    outcomes = []
    for name, rule in rules.items():
        if skip and name in skip:
            outcomes.append(Outcome(name, "skipped", skip[name]))
        elif not only or name in only:
            outcomes.append(_outcome(name, rule, trial))
    return outcomes


def _outcome(name: str, rule: Rule, trial: Any) -> Outcome:
    try:
        rule(trial)
    except NotChecked as reason:
        return Outcome(name, "not checked", str(reason))
    except DataError:
        raise
    except MotionGymError as error:
        return Outcome(name, "broken", str(error))
    return Outcome(name, "kept")


def check_selection(rules: Rules, skip: Mapping[str, str], only: Collection[str]) -> None:
    """Raise SpecError for a rule that is not known, or is skipped without a reason."""
    for name in (*skip, *only):
        if name not in rules:
            raise SpecError(f"There is no rule `{name}`.{suggest(name, rules)}")
    for name, reason in skip.items():
        if not isinstance(reason, str) or not reason.strip():
            raise SpecError(f"Rule `{name}` is skipped without a reason: write skip={{'{name}': 'reason'}}.")


def _article(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"


def _rules(number: int) -> str:
    return "rule" if number == 1 else "rules"
