"""hmap: the ROS 2 nodes around :mod:`hmap_core`. Nodes only convert, call and report."""

__version__ = "0.1.0"
