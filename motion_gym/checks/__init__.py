"""The rules of the contract, the leak probe and verification; ``rules(kind)`` lists, ``run_checks`` reports."""

from motion_gym.checks.checker import rules, run_checks

__all__ = ["rules", "run_checks"]
