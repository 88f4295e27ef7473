"""KOMO as a whole method: one NLP over the whole task; the skeleton is given, waypoints are not."""
