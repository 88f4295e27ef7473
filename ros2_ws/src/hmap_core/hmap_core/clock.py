"""The monotonic clock inside compiled code, so that a long loop can keep a deadline."""

import time

import numpy as np
from numba import njit, types

# int clock_gettime(clockid_t, struct timespec *) of the C library, which every process has loaded
_clock_gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.CPointer(types.int64)))
_MONOTONIC = time.CLOCK_MONOTONIC


@njit(cache=True, error_model="numpy", nogil=True)
def now():
    """Seconds of the monotonic clock; as :func:`time.monotonic`."""
    read = np.empty(2, np.int64)
    _clock_gettime(_MONOTONIC, read.ctypes)
    return read[0] + 1e-9 * read[1]
