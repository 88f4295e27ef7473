"""Makes the compiled functions plain Python, so that their source can be compared, debugged and measured for coverage.

Numba's own switch for this, NUMBA_DISABLE_JIT, leaves out what it cannot run in Python: ``cfunc`` and ``intrinsic``.
:func:`install` gives both a meaning there; it has to be called before anything of hmap_core is imported.
"""

import ctypes
import os
import sys

import numpy as np

POINTERS = {"float64*": ctypes.POINTER(ctypes.c_double), "int64*": ctypes.POINTER(ctypes.c_int64)}
FAILED = []  # what went wrong inside of a callback, from which no exception gets out


class Callback:
    """What ``cfunc`` makes of a function: something with the address of a C function that calls it."""

    def __init__(self, function, signature):
        def call(*arguments):
            try:
                function(*arguments)
            except BaseException as error:
                FAILED.append(error)

        kinds = [POINTERS.get(str(kind), ctypes.c_int64) for kind in signature.args]
        self._kept = ctypes.CFUNCTYPE(None, *kinds)(call)
        self.address = ctypes.cast(self._kept, ctypes.c_void_p).value


def call_kernel(address, n, *arrays):
    """The kernel at an address, with its arrays given by their addresses."""
    ctypes.CFUNCTYPE(None, ctypes.c_int64, *[ctypes.c_void_p] * len(arrays))(int(address))(int(n), *map(int, arrays))
    if FAILED:
        raise FAILED.pop()


def _call_generated(address, *arrays):
    """A function that CasADi generated, with its arrays given by their addresses."""
    kinds = [ctypes.c_void_p] * 4 + [ctypes.c_int]
    return ctypes.CFUNCTYPE(ctypes.c_int, *kinds)(int(address))(*map(int, arrays), 0)


def _integers(address):
    return ctypes.cast(int(address), POINTERS["int64*"])


INTRINSICS = {function.__name__: function for function in (call_kernel, _call_generated, _integers)}


def install() -> None:
    """From here on numba compiles nothing."""
    assert "hmap_core" not in sys.modules, "too late: hmap_core is imported already"
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    import numba
    import numba.extending

    numba.config.DISABLE_JIT = 1
    numba.cfunc = lambda signature, **options: lambda function: Callback(function, signature)
    numba.extending.intrinsic = lambda function: INTRINSICS[function.__name__]
    np.seterr(divide="ignore", invalid="ignore")  # compiled code says nothing either
