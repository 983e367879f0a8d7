"""The benchmarks that ship, one file a subject, made of the objects that a user makes a benchmark of."""
