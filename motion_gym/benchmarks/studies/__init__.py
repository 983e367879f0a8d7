"""Studies of benchmarks: values other than scores, computed once and stored."""
