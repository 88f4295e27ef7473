"""The parts of the node ``supervisor``: planning over services, following a plan through the controllers, markers."""
