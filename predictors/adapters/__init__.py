"""Adapters: predictors around a predictor that learn from revealed truth."""
