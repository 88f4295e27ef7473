"""hmap_core: the Iterative and Hybrid Sequential Manipulation Planner, free of ROS."""

from hmap_core.compile_cache import use_own_cache

__version__ = "0.1.0"

use_own_cache()
