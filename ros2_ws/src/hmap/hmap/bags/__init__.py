"""Recorded runs: bags that survive a kill, what is in them, and what is wrong with them."""
