"""motion-gym: test motion forecasters on places, sensors and crowds they were not trained on."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from motion_gym.catalog import adapter, domain, predictor
from motion_gym.contract import (
    FUTURE,
    HISTORY,
    ActionError,
    DataError,
    Domain,
    Forecast,
    MotionGymError,
    Observation,
    Predictor,
    PredictorError,
    Recording,
    SpecError,
    Truth,
)
from motion_gym.stepping.registration import register, register_all

if TYPE_CHECKING:
    from motion_gym.benchmarks.running import benchmark
    from motion_gym.checks.checker import check_adapter, check_domain, check_predictor
    from motion_gym.checks.inspection import inspect
    from motion_gym.checks.leaks import leak_probe
    from motion_gym.data.domains import RecordedDomain
    from motion_gym.data.recordings import read_recording
    from motion_gym.online.evaluation import evaluate_online
    from motion_gym.online.scores import OnlineCard
    from motion_gym.online.streams import Segment, Stream, stream
    from motion_gym.scoring.evaluation import Scorecard, compare, evaluate
    from motion_gym.scoring.show import show
    from motion_gym.stepping.dicts import forecast_to_dict, observation_from_dict, truth_from_infos
    from motion_gym.stepping.outstanding import Outstanding
    from motion_gym.stepping.pettingzoo_env import parallel_env

__version__ = "0.1.0"

# Loaded when first used, so that importing motion_gym costs little.
_LAZY = {
    "OnlineCard": "motion_gym.online.scores",
    "Outstanding": "motion_gym.stepping.outstanding",
    "Segment": "motion_gym.online.streams",
    "Stream": "motion_gym.online.streams",
    "RecordedDomain": "motion_gym.data.domains",
    "Scorecard": "motion_gym.scoring.evaluation",
    "benchmark": "motion_gym.benchmarks.running",
    "check_adapter": "motion_gym.checks.checker",
    "check_domain": "motion_gym.checks.checker",
    "check_predictor": "motion_gym.checks.checker",
    "compare": "motion_gym.scoring.evaluation",
    "evaluate": "motion_gym.scoring.evaluation",
    "forecast_to_dict": "motion_gym.stepping.dicts",
    "evaluate_online": "motion_gym.online.evaluation",
    "inspect": "motion_gym.checks.inspection",
    "leak_probe": "motion_gym.checks.leaks",
    "observation_from_dict": "motion_gym.stepping.dicts",
    "parallel_env": "motion_gym.stepping.pettingzoo_env",
    "read_recording": "motion_gym.data.recordings",
    "show": "motion_gym.scoring.show",
    "stream": "motion_gym.online.streams",
    "truth_from_infos": "motion_gym.stepping.dicts",
}

__all__ = [
    "FUTURE",
    "HISTORY",
    "ActionError",
    "DataError",
    "Domain",
    "Forecast",
    "MotionGymError",
    "Observation",
    "OnlineCard",
    "Outstanding",
    "Predictor",
    "PredictorError",
    "RecordedDomain",
    "Recording",
    "Scorecard",
    "Segment",
    "SpecError",
    "Stream",
    "Truth",
    "adapter",
    "benchmark",
    "check_adapter",
    "check_domain",
    "check_predictor",
    "compare",
    "domain",
    "evaluate",
    "evaluate_online",
    "forecast_to_dict",
    "inspect",
    "leak_probe",
    "observation_from_dict",
    "parallel_env",
    "predictor",
    "read_recording",
    "register",
    "show",
    "stream",
    "truth_from_infos",
]

register_all()


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module 'motion_gym' has no attribute '{name}'")
