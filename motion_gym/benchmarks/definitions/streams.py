"""The benchmark of online adaptation: every adapter on every kind of shift, with settings chosen on another shift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from motion_gym.benchmarks.objects import Benchmark, Shifts

TRIED: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "style": [{"memory": m} for m in (8, 16, 64)],
    "refine": [{"memory": m} for m in (16, 64)],
    "finetune": [{"rate": r, "least": n} for r in (1e-4, 3e-4, 1e-3, 3e-3) for n in (6, 12)],
    "ema_anchor": [{"rate": r, "anchor": a} for r in (1e-4, 3e-4, 1e-3) for a in (0.001, 0.01)],
    "kalman": [{"ridge": r, "forgetting": f} for r in (1.0, 10.0, 100.0) for f in (0.97, 0.99, 1.0)],
    "ekf": [{"noise": n, "spread": s} for n in (0.1, 0.3, 1.0) for s in (0.003, 0.01, 0.03)],
}
"""Settings of each adapter to choose from; other settings, and adapters that are not named, have their defaults."""
STGAT_ROWS = (
    "finetune:parts=all,every=4",
    "finetune:parts=last_layer,every=4",
    "ema_anchor:parts=all,every=4",
    "kalman",
    "hedge",
    "ekf:parts=last_layer,every=4",
)
TRAFFIC_ROWS = ("finetune:parts=last_layer,every=4", "kalman", "hedge")
FITTED_ROWS = ("kalman", "hedge")
"""Adapters of a predictor that is fitted in closed form."""
STYLE_ROWS = (
    "style",
    "refine",
    "finetune:parts=all",
    "finetune:parts=style",
    "finetune:parts=modulator",
    "finetune:parts=last_layer",
    "ema_anchor:parts=all",
    "kalman",
    "hedge",
    "ekf:parts=modulator",
)


STRAIGHT, ROUNDABOUT = (f"highway:style=normal,scenario={scenario}" for scenario in ("straight", "roundabout"))


def _kinds(domains: Sequence[str], frames: Sequence[int], again: Sequence[str] = ()) -> dict[str, dict[str, Any]]:
    """Arguments of ``stream`` by kind.

    Args:
        domains: Domains in order.
        frames: Frames of each visit of a domain, for sudden, gradual and recurring shifts.
        again: Order of the visits of the recurring stream; by default all domains, twice.
    """
    sudden, gradual, recurring = frames
    back: dict[str, Any] = {"domains": list(again or domains), "kind": "sudden" if again else "recurring"}
    return {
        "sudden": {"domains": list(domains), "kind": "sudden", "frames": sudden},
        "gradual": {"domains": list(domains), "kind": "gradual", "frames": gradual},
        "recurring": {**back, "frames": recurring},
    }


_CLASSES = ("sdd:scene=deathCircle,class=pedestrian", "sdd:scene=deathCircle,class=biker")
_SCENES = ("sdd:scene=hyang", "sdd:scene=deathCircle")

ONLINE = Benchmark(
    "online",
    "Online adaptation: predictors that learn from matured ground truth while a stream shifts",
    shifts={
        "style": Shifts(
            "Crowds of another style: d = 0.3, then 0.6",
            "modular_invariant",
            "style",
            _kinds(("orca:d=0.3", "orca:d=0.6"), (6400, 1600, 1200)),
            "modular_invariant:weights=online/orca",
            STYLE_ROWS,
            TRIED,
            {"domains": ["orca:d=0.3", "orca:d=0.5"], "frames": 1600, "split": "val"},
            "style/held_out",
        ),
        "alpha": Shifts(
            "Another noise: eth with alpha = 1, then 64",
            "erm",
            "spurious",
            _kinds(("eth:alpha=1", "eth:alpha=64"), (420, 420, 200)),
            {"eth:alpha=1.0": "erm:weights=online/alpha_1", "eth:alpha=64.0": "erm:weights=online/alpha_64"},
            STGAT_ROWS,
            TRIED,
            {"domains": ["zara2:alpha=8", "zara2:alpha=32"], "frames": 180, "split": "val"},
            "spurious",
        ),
        "places": Shifts(
            "Other places: hotel, zara1, univ",
            "erm_no_sigma",
            "online/places",
            _kinds(("hotel", "zara1", "univ"), (200, 200, 200), ("hotel", "zara1", "univ", "hotel")),
            "erm_no_sigma:weights=original/zara2",
            STGAT_ROWS,
            TRIED,
            {"domains": ["zara2", "eth6"], "frames": 200},
            "online/places",
        ),
        "traffic_style": Shifts(
            "Traffic: calm drivers, then aggressive ones",
            "kalman_residual",
            "vehicles",
            _kinds(("highway:style=calm", "highway:style=aggressive"), (200, 200, 100)),
            "kalman_residual:weights=online/traffic_styles",
            TRAFFIC_ROWS,
            TRIED,
            {"domains": ["highway:style=normal", "highway:style=brisk"], "frames": 160, "split": "val"},
            "vehicles",
        ),
        "traffic_scenario": Shifts(
            "Traffic: a straight road, then a roundabout",
            "kalman_residual",
            "vehicles",
            _kinds((STRAIGHT, ROUNDABOUT), (200, 200, 100)),
            {
                STRAIGHT: "kalman_residual:weights=vehicles",
                ROUNDABOUT: "kalman_residual:weights=online/roundabout",
            },
            TRAFFIC_ROWS,
            TRIED,
            {"domains": [STRAIGHT, "highway:style=normal,scenario=merge"], "frames": 160, "split": "val"},
            "vehicles",
        ),
        "drone_class": Shifts(
            "Drone video, another class at deathCircle: pedestrians, then bikers",
            "linear",
            "",
            _kinds(_CLASSES, (2400, 2400, 1200)),
            "linear",
            FITTED_ROWS,
            TRIED,
            {"domains": ["sdd:scene=gates,class=pedestrian", "sdd:scene=gates,class=biker"], "frames": 2400},
            fitted_to=("sdd:scene=bookstore coupa little nexus,class=pedestrian,split=0.8 0.2 0",),
        ),
        "drone_scene": Shifts(
            "Drone video, another scene: hyang, then deathCircle",
            "linear",
            "",
            _kinds(_SCENES, (2400, 2400, 1200)),
            "linear",
            FITTED_ROWS,
            TRIED,
            {"domains": ["sdd:scene=gates", "sdd:scene=little"], "frames": 2400},
            fitted_to=("sdd:scene=bookstore coupa nexus,split=0.8 0.2 0",),
        ),
    },
)
