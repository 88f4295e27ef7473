"""hmap_core: the Iterative and Hybrid Sequential Manipulation Planner, free of ROS."""

__version__ = "0.1.0"
