"""Algorithm 3: contact points on an object, and how a manipulator reaches them."""
