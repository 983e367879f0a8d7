"""Claims of the documentation: the tests that decide them, and their page."""
