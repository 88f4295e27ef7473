"""The parts of the node ``world``: the simulation thread, the controllers' actions, the cameras."""
