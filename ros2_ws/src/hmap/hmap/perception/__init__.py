"""The parts of the node ``perception``: what the sensors said last, and clouds from pictures."""
