"""A manipulation graph above Algorithm 1: which placements of an object are connected by which contacts.

Nodes are placements of one object: stable poses on any face of its convex hull, on any support, over an edge as well.
Edges are contacts that serve at both ends: grasps, or pushes over the support (Alami, Simeon, Laumond, "A geometrical
approach to planning manipulation tasks", ISRR 1989; Wan, Harada, "Regrasp planning using 10,000s of grasps", 2017).
"""
