"""Distances between sets of convex shapes, compiled with Numba for the optimiser and the sampling-based planners."""

from hmap_core.collision.convex import ConvexSet, convex_set, set_distance

__all__ = ["ConvexSet", "convex_set", "set_distance"]
