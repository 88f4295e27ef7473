"""Algorithm 1: waypoints, contacts and motions put together into a plan."""
