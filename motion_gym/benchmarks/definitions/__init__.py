"""The benchmarks that ship, one file a subject, defined with the classes of ``benchmarks.objects``."""
