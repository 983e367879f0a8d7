"""The training loop, plans and weight files."""
