"""The live page: scenes, plans, runs and recorded bags in a browser, without ROS.

It is drawn by viser, whose names for the parts of a scene are paths: ``/robots/panda_1``.
"""
