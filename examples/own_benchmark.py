"""A benchmark of one's own: motion-gym run own_benchmark:NARROW --predictor own_predictor:Turning."""

from motion_gym.benchmarks.objects import Benchmark, Claim, Part

DISTANCES = Part(
    "Small crowds that keep a distance d",
    {f"d = {d}": f"orca:d={d},scenes=100" for d in (0.2, 0.6)},  # name and spec of each column
    ("constant_velocity", "linear"),  # rows that need no weights
    pooled={"both": ("d = 0.2", "d = 0.6")},  # a column that is the mean of others
    samples=1,  # k
)
NARROW = Benchmark(
    "narrow",
    "Crowds of two: linear regression against constant velocity",
    (DISTANCES,),
    claims=(Claim("Linear regression has a lower error", ["linear"], ["constant_velocity"], significant=False),),
)
