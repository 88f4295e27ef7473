"""Scenes as data: robots, reusable objects and tasks, read by :mod:`hmap_core.scenes`."""
