"""How loops over samples are compiled, so that the first call after installation does not wait for long.

What costs the compiler time: expressions of whole arrays (1 to 3 s each), ``np.zeros`` and ``np.eye`` in a
kernel (0.1 to 0.3 s), functions that are inlined before their types are known, and ways in that nobody uses.
Kernels therefore write plain loops, take their room as arguments, and leave inlining to LLVM, which does it
as well; neither kind can be called from C.
"""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numba

Given = ParamSpec("Given")
Result = TypeVar("Result")

_compile: Any = numba.njit
"""Its type stubs leave out the options about ways in."""


def kernel(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Compile a function that Python calls; the result is kept on disk."""
    made = _compile(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)
    compiled: Callable[Given, Result] = made(function)
    return compiled


def inner(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Compile a function that only kernels call."""
    made = _compile(nogil=True, error_model="numpy", no_cfunc_wrapper=True, no_cpython_wrapper=True)
    compiled: Callable[Given, Result] = made(function)
    return compiled


def fused(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Compile what turns vectors, for kernels only; a product and a sum are rounded once (a fifth faster).

    So the last bits of a float64 depend on the processor, as they do in numpy's products of matrices.
    """
    made = _compile(
        nogil=True,
        error_model="numpy",
        fastmath={"contract"},
        no_cfunc_wrapper=True,
        no_cpython_wrapper=True,
    )
    compiled: Callable[Given, Result] = made(function)
    return compiled


@kernel
def _add_one(number: int) -> int:
    return number + 1


def make_ready() -> None:
    """Load what the first kernel of a process needs: it takes as long as fifty kernels."""
    _add_one(0)
