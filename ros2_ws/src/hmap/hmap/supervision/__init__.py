"""The parts of the node ``supervisor``: the ports of a plan executor over actions and topics, and markers."""
