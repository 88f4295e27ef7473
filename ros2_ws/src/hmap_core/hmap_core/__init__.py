"""hmap_core: the Iterative and Hybrid Sequential Manipulation Planner, free of ROS."""

from hmap_core.compile_cache import use_own_cache
from hmap_core.deferred import defer_imports

__version__ = "0.1.0"

defer_imports()
use_own_cache()
