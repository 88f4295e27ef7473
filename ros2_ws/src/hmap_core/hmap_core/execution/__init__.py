"""Execution of plans: one executor behind ports for controllers, observation and clock, without ROS and simulation."""
