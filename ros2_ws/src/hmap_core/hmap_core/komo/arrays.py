"""The plain arrays that compiled code takes."""

from collections import namedtuple

# Terms: objectives unrolled, one row per step. kernel (M,), type (M,), step (M,), dim (M,), scale (M,), frames (M,4),
# offset (M,) into params (N,); by_step (T+1,): rows of step t are by_step[t]:by_step[t+1].
Terms = namedtuple("Terms", "kernel type step dim scale frames offset params by_step")
# Options: see SolverOptions in transcription.py.
Options = namedtuple(
    "Options",
    "mu mu_growth mu_max tolerance outer inner iterations max_step damping step_tolerance gain_tolerance "
    "acceleration velocity substeps activity",
)
# Scratch of one problem. Pairs that are far apart are left alone until something can have come near: travel (samples,)
# bounds how far any point has moved at a sample, seen (samples, n) is the configuration it was last updated at, and
# until (samples, P) is the travel at which a pair has to be looked at again.
Scratch = namedtuple("Scratch", "R p Hs gs row centers axes witness work r J qs travel seen until")
