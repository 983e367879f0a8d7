"""Texts that do harm where they are not escaped, and results that hold them."""

import copy

from motion_gym.benchmarks.store import Store

TEXTS = (
    "<script>document.title='harm'</script>",
    "</script><script>document.title='harm'</script>",
    "<img src=x onerror=harm()>",
    "../../../harm",
    "/tmp/harm",
    "one\ntwo\n# Harm\n\n| a | b |",
    "a | b ` c `` d",
    "<!-- results end -->",
    "\x1b]0;harm\x07\x1b[2J\x1b[31m",
    "\x9b2J\r\x00\x7f\u202eharm",
    "{{ 7 * 7 }}{% for %}",
    "$\\harm{$ \\frac",
    "[harm](javascript:harm())",
    "x" * 3000,
    "",
)


def run_named(text):
    """A stored run of windows of the benchmark `style`, as of a user's predictor, with a text in many places."""
    stored = Store("style").runs.values()
    run = copy.deepcopy(next(each for each in stored if each.get("predictor") == "linear"))
    run["identity"] |= {"predictor": text, "session": text or "s"}
    run |= {"predictor": text, "selection": text, "leaks": [text], "scored": text, "aggregation": text}
    run["provenance"] |= {"machine": text, "command": [text], "commit": text}
    return run
