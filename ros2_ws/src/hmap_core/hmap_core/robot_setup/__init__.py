"""First robot file for a URDF, and the report on a robot: what is read, what is assumed, and what is guessed.

MoveIt's Setup Assistant does the same with a graphical interface.
"""
