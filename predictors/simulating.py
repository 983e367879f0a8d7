"""Base class of oracles that simulate the domain they are scored on."""

from __future__ import annotations

from typing import Any, ClassVar

from motion_gym.contract import Domain, PredictorError


class Simulating:
    """An oracle that is told the domain, and asks it to simulate on; subclasses have ``predict``."""

    kind: ClassVar[str]
    """Name of the oracle."""
    knows: ClassVar[tuple[str, str, str]]
    """Name of its domain, what that is, and where to score, for messages."""

    def __init__(self) -> None:
        self._domain: Any = None

    def know(self, domain: Domain) -> None:
        """Receive the domain.

        Raises:
            PredictorError: the oracle cannot simulate this domain.
        """
        name, described, where = self.knows
        if domain.card.name != name:
            raise PredictorError(f"{self.kind} knows {described} only, not `{domain.card.name}`: score it on {where}.")
        self._domain = domain

    def known(self) -> Any:
        """The domain; PredictorError if ``know`` was not called."""
        if self._domain is None:
            raise PredictorError(f"{self.kind} does not know the domain: call know(domain), or evaluate it by name.")
        return self._domain
