"""The comparison table: every method on every task with paired seeds, and the statistics that say what it shows."""
