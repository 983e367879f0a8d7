"""Networks and layers that predictors share."""
