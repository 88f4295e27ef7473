"""How often tasks are solved, and how fast: many seeded trials of the whole planner, judged and executed."""
