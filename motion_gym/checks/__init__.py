"""The rules of the contract, and the leak probe."""
