"""The plain arrays that compiled code takes."""

from collections import namedtuple

# Types of terms; a band is an equality that may be missed by a little, as between steps.
SOS, EQ, INEQ, BAND = range(4)
# Terms: objectives unrolled, one row per sample. kernel (M,), type (M,), step (M,), dim (M,), scale (M,), frames (M,4),
# offset (M,) into params (N,); target (M, MAX_DIM); order (M,) of the difference over steps; band
# (M, MAX_DIM): by how much a component of type BAND may miss its target;
# by_sample (S+1,): rows of sample s are by_sample[s]:by_sample[s+1]; objective (M,): its number; tau: seconds per step.
Terms = namedtuple("Terms", "kernel type step dim scale frames offset params target order band by_sample objective tau")
# Samples: where constraints are looked at. first (T+1,): samples of the interval that ends at step t are
# first[t]:first[t+1], the last of them the step itself; alpha (S,): where in the interval; mask (S,): bits of phases
# whose pairs count.
Samples = namedtuple("Samples", "first alpha mask")
# Options: see SolverOptions in options.py.
Options = namedtuple(
    "Options",
    "mu mu_growth mu_max tolerance outer inner iterations max_step damping step_tolerance gain_tolerance "
    "acceleration velocity detection_distance optimality deadline",
)
# Multipliers of the terms (M, MAX_DIM), of the pairs at each sample (S, P), of the joint limits (T, n, 2), and the
# penalty mu (1,): what a solve can be gone on with.
Multipliers = namedtuple("Multipliers", "terms pairs limits mu")
# Model of the augmented Lagrangian round a path: H (T n, 3 n + PADDING), G (T n,) of what is smooth, and inequalities
# as rows: row (M, n) of the Jacobian by the configuration at alpha (M,) of the interval before step (M,), the value
# (M,) shifted by the multiplier, and the weight (M,) of its half square where it is positive; sample and pair (M,) of a
# row that is a pair's, -1 else; count (1,) rows are used.
Model = namedtuple("Model", "H G row step alpha value weight sample pair count")
# Scratch of one problem. Pairs that are far apart are left alone until something can have come near. Per sample:
# seen (S, n) is the last configuration, travel (S,) bounds how far any point has moved until there, wake (S,) is the
# travel at which the pairs have to be looked at. When they were last: centers (S, shapes, 3), turned (S, n+1, 3, 3) the
# frames' rotations, slack (S, P) by how much each pair may still come nearer, guesses (S, P, 9) see gjk.py; known (S,)
# says whether they ever were. moved (shapes,).
# R, p: frames of the steps (T+2, n+1, 3, 3) where a term needs differences over steps, else of one configuration.
Scratch = namedtuple(
    "Scratch",
    "R p Rm pm Hs gs witness work r rk J Jk qs seen travel wake known centers turned slack guesses moved",
)
