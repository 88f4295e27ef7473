"""From a geometric path to a motion in time, and from a plan to what the simulated robots make of it."""
