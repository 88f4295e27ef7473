"""How bodies rest: centre of mass, resting faces, contact points, and the equilibrium of forces with friction."""
