"""Published forecasters on ETH-UCY, by the wrappers of ``examples/published``; their code is no part of the package."""

from __future__ import annotations

from motion_gym.benchmarks.objects import FILTERS, Benchmark, External, Part
from motion_gym.training.plans import PLACES

COLUMNS = {"eth": "eth", "eth6": "eth6", **{place: place for place in PLACES[1:]}}
"""``eth6`` is the annotation of eth at its true rate: the same people, and weights of eth."""


def _external(name: str, target: str, fingerprints: str) -> External:
    """A row with the weights of each column's place, whose fingerprints are in the order of the places."""
    names = {column: column.removesuffix("6") for column in COLUMNS}
    return External(name, f"examples.published.{target}", names, dict(zip(PLACES, fingerprints.split(), strict=True)))


FIRST = "eb6e6631a3e27883 9f1b728b37b0bf12 61c6adf7ef1160f4 c015cfd67f65ae17 ffbd2559afe0e9ac"
NEWEST = "b7c3065ae15aed21 c5faeb80523235e8 6fc75f7725818442 982d286ea16acf43 ad1ab6c1cc22aed3"
STGCNN = "social_stgcnn:SocialStgcnn:repo=checkouts/Social-STGCNN"

TERN_WEIGHTS = "f220be6858218dcf deabc03c344f7bd0 ed48d7122608dbc3 22ae5eb8e87ca4ef 3b06c725b3e88e08"
SR_LSTM_WEIGHTS = "52dffbc92a026598 a75bb447ba934bd7 73946bc795e51c1a c8310284b3550a48 b42d3ffe3b95ba67"
TERN, SR_LSTM = "graph_tern:GraphTern:repo=checkouts/GraphTERN", "sr_lstm:SrLstm:repo=checkouts/SR-LSTM"

PUBLISHED = Benchmark(
    "published",
    "Published forecasters with their own weights, each place of ETH-UCY held out",
    (
        Part(
            "Published forecasters, one forecast",
            COLUMNS,
            FILTERS,
            samples=1,
            external=(
                _external("Social-STGCNN, paper's weights", f"{STGCNN}-first", FIRST),
                _external("Social-STGCNN, newest weights", STGCNN, NEWEST),
                _external("Social-STGCNN, newest weights, means", f"{STGCNN},mean=true", NEWEST),
                _external("Graph-TERN", TERN, TERN_WEIGHTS),
                _external("SR-LSTM", SR_LSTM, SR_LSTM_WEIGHTS),
            ),
        ),
        Part(
            "Published forecasters, best of 20",
            COLUMNS,
            FILTERS,
            external=(
                _external("Social-STGCNN, paper's weights", f"{STGCNN}-first", FIRST),
                _external("Social-STGCNN, newest weights", STGCNN, NEWEST),
                _external("Graph-TERN", TERN, TERN_WEIGHTS),
            ),
        ),
    ),
    tables=(
        "motion_gym.benchmarks.reports.forecaster_tables:one_forecast",
        "motion_gym.benchmarks.reports.forecaster_tables:best_of_20",
        "motion_gym.benchmarks.reports.forecaster_tables:best_of_20_scenes",
    ),
    short=(),
)
