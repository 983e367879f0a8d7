"""Recordings, data sets on disk, windows, the base class of domains, and storage."""
