"""Streams, and scores of predictors that learn while they run."""
