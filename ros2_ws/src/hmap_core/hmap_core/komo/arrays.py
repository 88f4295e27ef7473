"""The plain arrays that compiled code takes."""

from collections import namedtuple

# Terms: objectives unrolled, one row per step. kernel (M,), type (M,), step (M,), dim (M,), scale (M,), frames (M,4),
# offset (M,) into params (N,); target (M, MAX_DIM); order (M,) of the difference over steps;
# by_step (T+1,): rows of step t are by_step[t]:by_step[t+1]; tau: seconds per step.
Terms = namedtuple("Terms", "kernel type step dim scale frames offset params target order by_step tau")
# Samples: where collisions are looked at. first (T+1,): samples of the interval that ends at step t are
# first[t]:first[t+1], the last of them the step itself; alpha (S,): where in the interval; mask (S,): bits of phases.
Samples = namedtuple("Samples", "first alpha mask")
# Options: see SolverOptions in transcription.py.
Options = namedtuple(
    "Options",
    "mu mu_growth mu_max tolerance outer inner iterations max_step damping step_tolerance gain_tolerance "
    "acceleration velocity activity",
)
# Multipliers of the terms (M, MAX_DIM), of the pairs at each sample (S, P), of the joint limits (T, n, 2), and the
# penalty mu (1,): what a solve can be gone on with.
Multipliers = namedtuple("Multipliers", "terms pairs limits mu")
# Scratch of one problem. Pairs that are far apart are left alone until something can have come near: travel (S,) bounds
# how far any point has moved at a sample, seen (S, n) is the configuration it was last updated at, until (S, P) is the
# travel at which a pair has to be looked at again, and wake (S,) the least of them. hints (S, P, 9): see gjk.py.
# R, p: frames of the steps (T+2, n+1, 3, 3) where a term needs differences over steps, else of one configuration.
Scratch = namedtuple("Scratch", "R p Rm pm Hs gs row centers hints witness work r rk J Jk qs travel seen until wake")
