"""The two clocks, the ledger of forecasts, and the environments that show them."""
