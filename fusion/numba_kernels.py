"""How loops over samples are compiled, so that the first call after installation does not wait for long.

What costs the compiler time: expressions of whole arrays (1 to 3 s each), ``np.zeros`` and ``np.eye`` in a
kernel (0.1 to 0.3 s), functions that are inlined before their types are known, and ways in that nobody uses.
Kernels therefore write plain loops, take their room as arguments, and leave inlining to LLVM, which does it
as well; neither kind can be called from C. The compiler's steps for what such loops do not hold (closures,
literals, arrays made inside) are left out, and nothing is collected as garbage while it works (decision 39).
"""

import gc
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager
from numba.core.typed_passes import (
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import (
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    TranslateByteCode,
)

STEPS: tuple[Any, ...] = (
    TranslateByteCode,
    FixupArgs,
    IRProcessing,
    GenericRewrites,
    ReconstructSSA,
    NopythonTypeInference,
    PreLowerStripPhis,
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
)
"""Of numba's ``DefaultPassBuilder.define_nopython_pipeline``, in its order."""

Given = ParamSpec("Given")
Result = TypeVar("Result")


class _Undisturbed(CompilerBase):
    """What is made while compiling is in use until the end: looking for garbage meanwhile is in vain."""

    def compile_extra(self, func: object) -> Any:
        """Compile while the collector rests."""
        compile_as_ever: Any = super().compile_extra
        was_on = gc.isenabled()
        gc.disable()
        try:
            return compile_as_ever(func)
        finally:
            if was_on:
                gc.enable()


class PlainLoops(_Undisturbed):
    """The compiler for loops over given arrays."""

    def define_pipelines(self) -> list[Any]:
        """Its steps."""
        make: Any = PassManager
        steps = make("plain loops")
        for step in STEPS:
            steps.add_pass(step, step.__name__)
        steps.finalize()
        return [steps]


class AnyLoops(_Undisturbed):
    """The compiler for loops that make arrays."""

    def define_pipelines(self) -> list[Any]:
        """All of numba's steps."""
        define: Any = DefaultPassBuilder.define_nopython_pipeline
        return [define(self.state)]


def kernel(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Compile a function that Python calls; the result is kept on disk."""
    return _compile(function, PLAIN | {"cache": True})


def inner(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Compile a function that only kernels call."""
    return _compile(function, PLAIN | {"no_cpython_wrapper": True})


def fused(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Compile what turns vectors, for kernels only; a product and a sum are rounded once (a fifth faster).

    So the last bits of a float64 depend on the processor, as they do in numpy's products of matrices.
    """
    return _compile(function, PLAIN | {"no_cpython_wrapper": True, "fastmath": {"contract"}})


def kernel_making_arrays(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """As ``kernel``, for a function in which arrays are made, or sliced and given on."""
    return _compile(function, {"pipeline_class": AnyLoops, "cache": True})


def inner_making_arrays(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """As ``inner``, called by those."""
    return _compile(function, {"pipeline_class": AnyLoops, "no_cpython_wrapper": True})


def _compile(function: Callable[Given, Result], options: dict[str, Any]) -> Callable[Given, Result]:
    decorate: Any = numba.njit  # its type stubs leave out the options about ways in
    made = decorate(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)
    compiled: Callable[Given, Result] = made(function)
    return compiled


PLAIN: dict[str, Any] = {"pipeline_class": PlainLoops, "_nrt": False}
"""``_nrt``: no counting of references, as nothing is allocated."""


@kernel
def _add_one(number: int) -> int:
    return number + 1


def make_ready() -> None:
    """Load what the first kernel of a process needs: it takes as long as fifty kernels."""
    _add_one(0)
