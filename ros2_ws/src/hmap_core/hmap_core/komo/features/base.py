"""Features: differentiable maps of a configuration, each one compiled kernel.

A kernel is a numba ``cfunc`` of the signature :data:`KERNEL`. It gets the frames of all moving links, writes its value
r (dim,) and adds its Jacobian to J (dim, n), which arrives as zeros. The solver calls kernels by address, so a new
feature is a new file: nothing else has to know of it.
"""

from dataclasses import dataclass, field

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_F, _I = types.CPointer(types.float64), types.CPointer(types.int64)
# kernel(n, R (n+1,3,3), p (n+1,3), first (n+1,), prismatic (n,), q (n,), frames, params, r, J (dim,n))
KERNEL = types.void(types.int64, _F, _F, _I, _I, _F, _I, _F, _F, _F)
CALLBACK = dict(cache=True, error_model="numpy")  # of kernels
MAX_DIM = 32
MAX_FRAMES = 4


@intrinsic
def call_kernel(typingctx, address, n, R, p, first, prismatic, q, frames, params, r, J):
    """Calls the kernel at ``address``; arrays are passed as the integer addresses of their data."""
    signature = types.void(*([types.int64] * 11))

    def codegen(context, builder, sig, args):
        pointer = ir.IntType(8).as_pointer()
        int64 = ir.IntType(64)
        function_type = ir.FunctionType(ir.VoidType(), [int64] + [pointer] * 9)
        function = builder.inttoptr(args[0], function_type.as_pointer())
        builder.call(function, [args[1]] + [builder.inttoptr(a, pointer) for a in args[2:]])
        return cgutils.get_null_value(ir.IntType(8).as_pointer())

    return signature, codegen


@dataclass(frozen=True)
class Feature:
    """A kernel with the frames and numbers that it is used with.

    Attributes:
        name: what it measures, for messages.
        kernel: address of the compiled kernel.
        dim: length of its value, at most MAX_DIM.
        frames: numbers of the frames it looks at (0 is the world), at most MAX_FRAMES.
        params: its constants, kernel-specific; offsets, targets. May differ between instances of a batch.
        unit: unit of each component of the value.
        metres: how many of the components, the first ones, are lengths; None: all if the unit is m, else none.
    """

    name: str
    kernel: int
    dim: int
    frames: tuple[int, ...] = ()
    params: np.ndarray = field(default_factory=lambda: np.zeros(0))
    unit: str = "m"
    metres: int | None = None

    @property
    def lengths(self) -> int:
        if self.metres is not None:
            return self.metres
        return self.dim if self.unit == "m" else 0
