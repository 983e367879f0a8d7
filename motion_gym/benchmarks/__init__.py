"""Benchmarks: their rows and columns, stored runs, tables and figures."""
