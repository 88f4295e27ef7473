"""Options of everything that numba's njit compiles."""

# Results must not depend on how the compiler orders sums, so fastmath is off.
OPTIONS = dict(cache=True, fastmath=False, error_model="numpy", nogil=True, _nrt=True)
# Functions that allocate nothing: without counting references to arrays, which would take a third of their time.
PLAIN = dict(OPTIONS, _nrt=False)
INLINE = dict(PLAIN, forceinline=True)  # what is called so often that passing arrays would cost more than the work
