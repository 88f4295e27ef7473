"""Features written as CasADi expressions of frame poses, compiled once and used with any robot.

CasADi derives the expression with respect to the frames, not the joints. A point carried by a frame at p moves with the
joint velocity w as dp = w x (p - o) and an axis of it as dR = [w]x R, where the joint's axis passes through o; so each
component d of the value needs two vectors per frame, its derivative f_d by the position and the moment
m_d = sum_c R[:, c] x dr_d/dR[:, c], and a joint about z through o contributes z . ((p - o) x f_d + m_d).

The expression becomes C, the system's compiler makes a shared library of it, and the library is kept by the hash of the
serialised function. Without a compiler CasADi evaluates it itself, ten to twenty times slower.
"""

from __future__ import annotations  # those that name CasADi would load it

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import casadi
import numpy as np
from llvmlite import ir
from numba import carray, cfunc, types
from numba.extending import intrinsic

from hmap_core.compile_cache import cache_root, source_hash
from hmap_core.exceptions import InputError
from hmap_core.komo.features.base import CALLBACK, KERNEL, MAX_DIM, MAX_FRAMES, Feature

FLAGS = ("-O2", "-fPIC", "-shared", "-fno-fast-math")
COMPILER_TIMEOUT = 60.0  # s
_POSE = 12  # numbers of a frame: position, then rotation row by row
_WRENCH = 6  # numbers of a derivative by a frame: position, then moment
# Slots of the description (int64) of a compiled function that travels as the first "frame" of a feature.
_CODE, _DIM, _FRAMES, _PARAMS, _ARGUMENTS, _RESULTS, _INTEGERS, _REALS, _SIZE = range(9)
# What CasADi generates: int f(const double** arg, double** res, long long* iw, double* w, int mem).
_POINTERS = ctypes.POINTER(ctypes.c_void_p)
GENERATED = ctypes.CFUNCTYPE(ctypes.c_int, _POINTERS, _POINTERS, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)


@dataclass(frozen=True)
class FrameSymbols:
    """A frame in an expression: position (3, 1) in metres and rotation (3, 3), world."""

    position: casadi.SX
    rotation: casadi.SX


Expression: TypeAlias = "Callable[[Sequence[FrameSymbols], casadi.SX], casadi.SX]"


@intrinsic
def _call_generated(typingctx, address, arguments, results, integers, reals):
    """Calls the GENERATED function at ``address``; its result is 0 when it worked."""

    def codegen(context, builder, sig, args):
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.IntType(32), [pointer] * 4 + [ir.IntType(32)])
        function = builder.inttoptr(args[0], kind.as_pointer())
        given = [builder.inttoptr(a, pointer) for a in args[1:]]
        return builder.sext(builder.call(function, [*given, ir.Constant(ir.IntType(32), 0)]), ir.IntType(64))

    return types.int64(*([types.int64] * 5)), codegen


@intrinsic
def _integers(typingctx, address):
    """The address of numbers as a pointer to int64."""

    def codegen(context, builder, sig, args):
        return builder.inttoptr(args[0], ir.IntType(64).as_pointer())

    return types.CPointer(types.int64)(types.int64), codegen


@cfunc(KERNEL, **CALLBACK)
def _kernel(n, R_, p_, first_, prismatic_, q_, frames_, params_, r_, J_):
    R, p = carray(R_, (n + 1, 3, 3)), carray(p_, (n + 1, 3))
    first, prismatic = carray(first_, n + 1), carray(prismatic_, n)
    frames = carray(frames_, MAX_FRAMES)
    about = carray(_integers(frames[0]), _SIZE)
    dim, count = about[_DIM], about[_FRAMES]
    r, J, params = carray(r_, dim), carray(J_, (dim, n)), carray(params_, about[_PARAMS])
    # all memory is this call's own, so threads do not meet; numbers of 8 bytes, one after the other
    reals = (_POSE + dim * _WRENCH) * count
    integers = reals + about[_REALS]
    arguments = integers + about[_INTEGERS]
    results = arguments + about[_ARGUMENTS]
    room = np.empty(results + about[_RESULTS])
    at, pointers = room.ctypes.data, room.view(np.int64)
    poses, wrench = room[: _POSE * count], room[_POSE * count : reals]
    for f in range(count):
        a = frames[1 + f]
        for i in range(3):
            poses[_POSE * f + i] = p[a, i]
            for j in range(3):
                poses[_POSE * f + 3 + 3 * i + j] = R[a, i, j]
    pointers[arguments], pointers[arguments + 1] = at, params.ctypes.data
    pointers[results], pointers[results + 1] = r.ctypes.data, at + 8 * _POSE * count
    failed = _call_generated(about[_CODE], at + 8 * arguments, at + 8 * results, at + 8 * integers, at + 8 * reals)
    if failed != 0:
        for d in range(dim):
            r[d] = np.nan
    for f in range(count):
        a = frames[1 + f]
        for k in range(first[a], a):
            z0, z1, z2 = R[k + 1, 0, 2], R[k + 1, 1, 2], R[k + 1, 2, 2]
            x0, x1, x2 = p[a, 0] - p[k + 1, 0], p[a, 1] - p[k + 1, 1], p[a, 2] - p[k + 1, 2]
            for d in range(dim):
                own = (d * count + f) * _WRENCH
                f0, f1, f2 = wrench[own], wrench[own + 1], wrench[own + 2]
                if prismatic[k] == 1:
                    J[d, k] += z0 * f0 + z1 * f1 + z2 * f2
                else:
                    J[d, k] += z0 * (x1 * f2 - x2 * f1 + wrench[own + 3])
                    J[d, k] += z1 * (x2 * f0 - x0 * f2 + wrench[own + 4])
                    J[d, k] += z2 * (x0 * f1 - x1 * f0 + wrench[own + 5])


def _derive(name: str, expression: Expression, frames: int, params: int) -> casadi.Function:
    """(poses (12 F,), params) -> (value (dim,), wrenches (6 F, dim): a column per component, frame after frame)."""
    poses, numbers = casadi.SX.sym("poses", _POSE * frames), casadi.SX.sym("params", params)
    symbols = []
    for f in range(frames):
        own = poses[_POSE * f : _POSE * (f + 1)]
        symbols.append(FrameSymbols(own[:3], casadi.reshape(own[3:], 3, 3).T))
    value = casadi.densify(casadi.vec(casadi.SX(expression(symbols, numbers))))
    by_pose = casadi.jacobian(value, poses).T
    wrenches = []
    for f, frame in enumerate(symbols):
        columns = [by_pose[_POSE * f + 3 + c : _POSE * (f + 1) : 3, :] for c in range(3)]
        moments = []
        for d in range(value.numel()):
            crosses = [casadi.cross(frame.rotation[:, c], columns[c][:, d]) for c in range(3)]
            moments.append(crosses[0] + crosses[1] + crosses[2])
        wrenches += [by_pose[_POSE * f : _POSE * f + 3, :], casadi.horzcat(*moments)]
    outputs = [value, casadi.densify(casadi.vertcat(*wrenches))]
    return casadi.Function(f"hmap_{hashlib.sha256(name.encode()).hexdigest()[:8]}", [poses, numbers], outputs)


def find_compiler() -> str | None:
    """The C compiler: $CC, or what the system calls cc, gcc or clang; None where there is none."""
    return _first_program((os.environ.get("CC", ""), "cc", "gcc", "clang"), os.environ.get("PATH"))


@cache  # to look through PATH takes longer than all else that a feature costs
def _first_program(names: tuple[str, ...], path: str | None) -> str | None:
    return next((found for found in (shutil.which(name, path=path) for name in names if name) if found), None)


def library(function: casadi.Function, compiler: str) -> Path | None:
    """The shared library of a function, compiled unless it is kept already; None when the compiler fails."""
    key = hashlib.sha256(f"{casadi.__version__} {FLAGS} {function.serialize()}".encode()).hexdigest()[:24]
    folder = cache_root() / source_hash() / "symbolic"  # removed together with the rest when the sources change
    kept = folder / f"{key}.so"
    if kept.exists():
        return kept
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            source, made = Path(scratch) / "feature.c", Path(scratch) / "feature.so"
            generator = casadi.CodeGenerator(source.name, {"with_header": False})
            generator.add(function)
            generator.generate(scratch + os.sep)
            command = [compiler, *FLAGS, "-o", str(made), str(source), "-lm"]
            subprocess.run(command, check=True, capture_output=True, timeout=COMPILER_TIMEOUT)
            os.replace(made, kept)  # at once, so that another process never sees half a library
    except (OSError, subprocess.SubprocessError):
        return None
    return kept


def evaluator(function: casadi.Function):
    """The function as a GENERATED callback: CasADi's evaluator under the interpreter's lock, for want of a compiler."""
    sizes = [function.numel_in(i) for i in range(2)] + [function.numel_out(i) for i in range(2)]
    arrays = [np.zeros(size) for size in sizes]
    buffer, evaluate = function.buffer()
    for i in range(2):
        buffer.set_arg(i, arrays[i].data)
        buffer.set_res(i, arrays[2 + i].data)
    lock = threading.Lock()

    @GENERATED
    def call(arguments, results, integers, reals, memory) -> int:
        addresses = arguments[0], arguments[1], results[0], results[1]
        theirs = [_doubles(address, size) for address, size in zip(addresses, sizes, strict=True)]
        with lock:
            for own, given in zip(arrays[:2], theirs[:2], strict=True):
                own[:] = given
            evaluate()
            for given, own in zip(theirs[2:], arrays[2:], strict=True):
                given[:] = own
        return 0

    return call, buffer


def _doubles(address: int, size: int) -> np.ndarray:
    if not size:
        return np.zeros(0)
    numbers = (ctypes.c_double * size).from_address(address)
    return np.frombuffer(numbers)  # type: ignore[call-overload]  # its buffer protocol is declared from Python 3.12 on


class SymbolicMap:
    """A derived expression, ready to be called by the kernel; what the kernel sees lives as long as the object.

    Args:
        name: what it measures.
        expression: called with the frames' symbols and the parameters (params, 1), returns the value (dim, 1).
        frames, params: how many of each.
        compiler: path of a C compiler; None: CasADi evaluates the expression.

    Attributes:
        compiled: whether machine code does the work.
        address: of its description, as the kernel takes it.
    """

    def __init__(self, name: str, expression: Expression, frames: int, params: int, compiler: str | None):
        if not 1 <= frames < MAX_FRAMES:
            raise InputError(f"feature '{name}' looks at {frames} frames; allowed: 1 to {MAX_FRAMES - 1}")
        self.name = name
        self.function = f = _derive(name, expression, frames, params)
        self.dim = f.size1_out(0)
        if not 1 <= self.dim <= MAX_DIM:
            raise InputError(f"feature '{name}' has {self.dim} components; allowed: 1 to {MAX_DIM}")
        file = library(f, compiler) if compiler else None
        self.compiled = file is not None
        self._kept: Any
        if file:
            self._kept = ctypes.CDLL(str(file))
            code = getattr(self._kept, f.name())
        else:
            self._kept = evaluator(f)
            code = self._kept[0]
        self._description = np.zeros(_SIZE, np.int64)
        self._description[[_CODE, _DIM, _FRAMES, _PARAMS]] = _address(code), self.dim, frames, params
        self._description[[_ARGUMENTS, _RESULTS, _INTEGERS, _REALS]] = f.sz_arg(), f.sz_res(), f.sz_iw(), f.sz_w()
        self.address = self._description.ctypes.data


def _address(function) -> int:
    address = ctypes.cast(function, ctypes.c_void_p).value
    if address is None:
        raise ValueError(f"{function} is at no address")
    return address


@cache  # features hold addresses: what they point to stays
def symbolic_map(name: str, expression: Expression, frames: int, params: int, compiler: str | None) -> SymbolicMap:
    """The map of an expression; derived and compiled once in a process."""
    return SymbolicMap(name, expression, frames, params, compiler)


def symbolic_feature(
    name: str,
    expression: Expression,
    frames: Sequence[int],
    params: Sequence[float] | np.ndarray = (),
    unit: str = "m",
    use_compiler: bool = True,
    metres: int | None = None,
) -> Feature:
    """A feature from a CasADi expression.

    Args:
        name: what it measures, for messages.
        expression: a function at module level, called once with a :class:`FrameSymbols` per frame and the parameters
            (N, 1); returns the value, (dim, 1) in units of ``unit``.
        frames: numbers of the frames it looks at, at most MAX_FRAMES - 1; 0 is the world.
        params: (N,) numbers it is used with; they may differ by step and instance without compiling anew.
        unit: unit of the components.
        use_compiler: False to let CasADi evaluate it even where there is a compiler.
        metres: how many of the components, the first ones, are lengths; see :class:`Feature`.

    Raises:
        InputError: too many frames or components.
    """
    params = np.asarray(params, float).reshape(-1)
    made = symbolic_map(name, expression, len(frames), len(params), find_compiler() if use_compiler else None)
    return Feature(name, _kernel.address, made.dim, (made.address, *frames), params, unit, metres)
