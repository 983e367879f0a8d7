"""Scores of a predictor on a domain."""
