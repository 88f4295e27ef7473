"""Algorithm 3: where and how an object may be touched."""
