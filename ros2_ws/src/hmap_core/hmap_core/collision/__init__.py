"""Distances between convex shapes, compiled: what the optimiser and the sampling planners ask millions of times."""

from hmap_core.collision.convex import ConvexSet, convex_set, set_distance

__all__ = ["ConvexSet", "convex_set", "set_distance"]
