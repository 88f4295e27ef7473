"""Trajectories: the timing of joint paths, the samples of a plan, and how far a measured state agrees with them."""
