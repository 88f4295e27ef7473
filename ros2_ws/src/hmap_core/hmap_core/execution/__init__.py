"""Execution of plans: one executor behind ports for controllers, observation and clock; neither ROS nor the simulation."""
