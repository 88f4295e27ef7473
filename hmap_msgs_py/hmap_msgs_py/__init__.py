"""Conversions between messages and numpy or plain Python, and the interface definitions for reading bags without ROS.

Importing a conversion module needs ROS and hmap_msgs; :mod:`hmap_msgs_py.definitions` needs neither.

Plain data are dicts. Their keys are the field names of hmap_core's types, so
``ContactPoint(**contact_from_message(m))`` works without this package depending on the planner. Functions to messages
take such a dict, or any object with these attributes. All values of messages are checked: NaN, a quaternion that is not
normalised, or a wrong size raises :class:`~hmap_msgs_py.checks.ConversionError`.
"""

__version__ = "0.1.0"
