"""Driving: a planner drives an ego vehicle among others, with the forecasts of any predictor."""
