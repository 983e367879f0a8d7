"""Error metrics, bootstrap intervals and paired comparisons."""
