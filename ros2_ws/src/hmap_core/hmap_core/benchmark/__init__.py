"""Benchmarks against RAI: problems, solvers, judge and measurement. ``docs/benchmarks.md`` explains the numbers."""
