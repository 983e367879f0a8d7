"""motion-gym: test motion forecasters on places, sensors and crowds they were not trained on."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from motion_gym.catalog import adapter, domain, predictor
from motion_gym.contract import FUTURE, HISTORY, Domain, Forecast, Observation, Predictor, Recording, Truth
from motion_gym.registration import register_all

if TYPE_CHECKING:
    from motion_gym.adapter_checks import check_adapter
    from motion_gym.checks import check_domain, check_predictor
    from motion_gym.dicts import forecast_to_dict, observation_from_dict, truth_from_infos
    from motion_gym.evaluation import Scorecard, compare, evaluate
    from motion_gym.leaks import leak_probe
    from motion_gym.online import evaluate_online
    from motion_gym.online_score import OnlineCard
    from motion_gym.outstanding import Outstanding
    from motion_gym.pettingzoo_env import parallel_env
    from motion_gym.recordings import read_recording
    from motion_gym.streams import Segment, Stream, stream

__version__ = "0.1.0"

# Loaded when first used, so that importing motion_gym costs little.
_LAZY = {
    "OnlineCard": "motion_gym.online_score",
    "Outstanding": "motion_gym.outstanding",
    "Segment": "motion_gym.streams",
    "Stream": "motion_gym.streams",
    "Scorecard": "motion_gym.evaluation",
    "check_adapter": "motion_gym.adapter_checks",
    "check_domain": "motion_gym.checks",
    "check_predictor": "motion_gym.checks",
    "compare": "motion_gym.evaluation",
    "evaluate": "motion_gym.evaluation",
    "forecast_to_dict": "motion_gym.dicts",
    "evaluate_online": "motion_gym.online",
    "leak_probe": "motion_gym.leaks",
    "observation_from_dict": "motion_gym.dicts",
    "parallel_env": "motion_gym.pettingzoo_env",
    "read_recording": "motion_gym.recordings",
    "stream": "motion_gym.streams",
    "truth_from_infos": "motion_gym.dicts",
}

__all__ = [
    "FUTURE",
    "HISTORY",
    "Domain",
    "Forecast",
    "Observation",
    "OnlineCard",
    "Outstanding",
    "Predictor",
    "Recording",
    "Scorecard",
    "Segment",
    "Stream",
    "Truth",
    "adapter",
    "check_adapter",
    "check_domain",
    "check_predictor",
    "compare",
    "domain",
    "evaluate",
    "evaluate_online",
    "forecast_to_dict",
    "leak_probe",
    "observation_from_dict",
    "parallel_env",
    "predictor",
    "read_recording",
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
