"""A dynamics world of the scene in PyBullet, its cameras, and the controllers of its robots. No ROS in here."""
