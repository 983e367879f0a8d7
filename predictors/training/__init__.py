"""Objectives and trainers that predictors share."""
