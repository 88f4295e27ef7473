"""The parts of the node ``world``: the stepping thread, the controllers' actions, the cameras."""
