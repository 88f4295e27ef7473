"""Starts the nodes as processes, sends them a goal, and ends them, on machines without ``ros2 launch``."""
