"""The problems of the benchmark: seeded instances."""
