"""A traffic domain that is simulated in a second."""

import pytest

SMALL = {"scenario": "roundabout", "runs": 1, "seconds": 20.0, "stride": 2}
"""Arguments of ``highway``."""
SPEC = "highway:" + ",".join(f"{name}={value}" for name, value in SMALL.items())
FEW = SPEC.replace("stride=2", "stride=10")
"""Four scenes of it, for the oracle, which simulates each of them."""


def needs_highway_env():
    """Skip a test where highway-env is not installed."""
    pytest.importorskip("highway_env", reason='highway-env is not installed: pip install "motion-gym[highway]"')
