"""Starts the nodes as processes, gives them a goal, and ends them, on machines without ``ros2 launch``."""
