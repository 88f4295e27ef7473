"""Benchmark of the whole planner: many seeded trials of planning, judging and execution."""
