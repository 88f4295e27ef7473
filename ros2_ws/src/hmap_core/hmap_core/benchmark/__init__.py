"""What is measured, on which problems, and against which peer. ``docs/benchmarks.md`` says what the numbers mean."""
