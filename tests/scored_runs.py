"""Runs as the store keeps them, made for tests."""

from __future__ import annotations

import motion_gym
from motion_gym import catalog
from motion_gym.benchmarks.identity import facts_of


def scored(predictor, domain, **options):
    """The card of a score in JSON types, with the identity that tables read."""
    card = motion_gym.evaluate(predictor, domain, **options)
    identity = {
        "domain": facts_of(catalog.domain(domain)).spec,
        "references": options.get("references"),
        "shots": options.get("shots", 0),
        "scoring_version": 1,
    }
    return {**card.as_dict(), "identity": identity}
