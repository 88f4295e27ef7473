"""The parts of the node ``perception``: the newest measurements, and clouds from pictures."""
