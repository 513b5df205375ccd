"""Compile the loops over samples, and store the compiled code.

These cost compile time: expressions of whole arrays (1 to 3 s each), ``np.zeros`` and ``np.eye`` in a kernel
(0.1 to 0.3 s), functions that are inlined before their types are known, and unused entry points. Kernels
therefore use plain loops, take their work arrays as arguments, and leave inlining to LLVM; they cannot be
called from C. The compiler skips its steps for features that such loops do not have (closures, literals,
arrays made inside). The garbage collector is off during compilation.

The compiled code is stored in a private folder that is created when the first kernel runs; an import writes
nothing. Decorate every kernel of this package with the functions here, never with numba directly.
"""

import contextlib
import gc
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, InTreeCacheLocator, NullCache
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager
from numba.core.runtime.nrt import rtsys
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
"""The steps of numba's ``DefaultPassBuilder.define_nopython_pipeline``, in its order."""

Given = ParamSpec("Given")
Result = TypeVar("Result")


class _WithoutCollection(CompilerBase):
    """A compiler that runs with the garbage collector off: all its objects stay in use until the end."""

    def compile_extra(self, func: object) -> Any:
        """Compile with the garbage collector off."""
        compile_function: Any = super().compile_extra
        was_on = gc.isenabled()
        gc.disable()
        try:
            return compile_function(func)
        finally:
            if was_on:
                gc.enable()


class PlainLoops(_WithoutCollection):
    """The compiler for loops over given arrays."""

    def define_pipelines(self) -> list[Any]:
        """Return the steps of :data:`STEPS`."""
        make: Any = PassManager
        steps = make("plain loops")
        for step in STEPS:
            steps.add_pass(step, step.__name__)
        steps.finalize()
        return [steps]


class AnyLoops(_WithoutCollection):
    """The compiler for loops that create arrays."""

    def define_pipelines(self) -> list[Any]:
        """Return all of numba's steps."""
        define: Any = DefaultPassBuilder.define_nopython_pipeline
        return [define(self.state)]


@cache
def make_kernel_folder() -> Path | None:
    """Create the folder of the compiled code; None if no folder can be written.

    Uses ``NUMBA_CACHE_DIR`` if it is writable. If it is not (a container with a read-only disk), its content
    is copied to a private folder, because numba does not read a cache that it cannot write.
    """
    named = os.environ.get("NUMBA_CACHE_DIR")
    given = Path(named) if named else None
    if given:
        with contextlib.suppress(OSError):
            given.mkdir(parents=True, exist_ok=True)
        if os.access(given, os.W_OK):
            return given
    folder = _make_private_folder()
    if folder and given and given.is_dir():
        _copy_compiled(given, folder)
    return folder


def _make_private_folder() -> Path | None:
    """Create a folder that only this user can write; in a shared folder another user could plant code."""
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or "~/.cache"
    kernels = _fingerprint_kernels()
    user = f"acromion-{os.getuid()}" if hasattr(os, "getuid") else "acromion"
    for place in (Path(base).expanduser() / "acromion", Path(tempfile.gettempdir()) / user):
        folder = place / f"kernels-{kernels}"
        try:
            place.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK) and _is_owned_by_user(place) and _is_owned_by_user(folder):
            return folder
    return None


def _fingerprint_kernels() -> str:
    """Hash the sources that are compiled.

    numba only notices changes in a function's own file. A kernel with an inlined function from another file
    would keep the old code.
    """
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        source = path.read_bytes()
        if b"numba" in source:
            digest.update(path.name.encode() + source)
    return digest.hexdigest()[:12]


def _is_owned_by_user(folder: Path) -> bool:
    return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()


def _copy_compiled(given: Path, folder: Path) -> None:
    """Copy the compiled code into an empty folder, once and atomically for several processes."""
    if any(folder.iterdir()):
        return
    copy = Path(tempfile.mkdtemp(dir=folder.parent))
    shutil.copytree(given, copy, dirs_exist_ok=True)
    copy.chmod(0o700)
    with contextlib.suppress(OSError):
        copy.replace(folder)
    shutil.rmtree(copy, ignore_errors=True)


DONE = "prepared"
"""Marker file in the folder of the compiled code: everything after the reading is compiled."""
USUAL_KERNELS = 90
"""Number of cache files that a first analysis leaves, for the progress display."""


def measure_progress() -> float:
    """Return the share that is compiled, 0 to 1; 1 also if compiled code cannot be stored."""
    folder = make_kernel_folder()
    if folder is None or (folder / DONE).exists():
        return 1.0
    return min(sum(1 for _ in folder.rglob("*.nbc")) / USUAL_KERNELS, 0.99)


def mark_prepared() -> None:
    """Record that everything an analysis needs after the reading is compiled."""
    folder = make_kernel_folder()
    if folder is not None:
        (folder / DONE).touch()


class _KernelLocator(InTreeCacheLocator):
    """Locate numba's compiled code of one source file in our folder."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        shared: Any = super()
        shared.__init__(py_func, py_file)
        self._cache_path = str(Path(str(make_kernel_folder())) / shared.get_suitable_cache_subpath(py_file))


class _KernelCacheImpl(CompileResultCacheImpl):
    """The compile results that numba writes, in our folder only."""

    _locator_classes: Any = (_KernelLocator,)


class _KernelCache(FunctionCache):
    """Compiled code of one kernel on disk."""

    _impl_class = _KernelCacheImpl

    def load_overload(self, sig: object, target_context: object) -> Any:
        """Load the compiled code and its runtime, without the modules that only the compiler needs.

        numba's own method first imports the implementation of every type and function it can compile,
        including scipy's linear algebra: 0.25 s of processor time. If no compiled code is found, the compiler
        imports them.
        """
        rtsys.initialize(target_context)
        cache: Any = self
        with cache._guard_against_spurious_io_errors():  # noqa: SLF001
            return cache._load_overload(sig, target_context)  # noqa: SLF001


class _CacheOnFirstCall(NullCache):
    """Placeholder for a kernel's cache until the kernel is first called."""

    def __init__(self, dispatcher: Any) -> None:
        self._dispatcher = dispatcher

    def load_overload(self, sig: object, target_context: object) -> Any:
        """Open the cache and look up the kernel; numba calls this before it compiles."""
        open_cache: Any = _KernelCache
        opened: Any = open_cache(self._dispatcher.py_func) if make_kernel_folder() else NullCache()
        self._dispatcher._cache = opened  # noqa: SLF001  (numba has no public way)
        return opened.load_overload(sig, target_context)


def njit(
    *, cache: bool = False, **options: Any
) -> Callable[[Callable[Given, Result]], Callable[Given, Result]]:
    """Decorate as ``numba.njit`` does; with ``cache``, store the result on disk as ``kernel`` does."""

    def decorate(function: Callable[Given, Result]) -> Callable[Given, Result]:
        compiled: Any = numba.njit(**options)(function)
        _unify_integer_types(compiled)
        kept: Callable[Given, Result] = _keep_on_disk(compiled) if cache else compiled
        return kept

    return decorate


def _keep_on_disk(compiled: Any) -> Any:
    if hasattr(compiled, "enable_caching"):  # otherwise a plain function: NUMBA_DISABLE_JIT
        compiled._cache = _CacheOnFirstCall(compiled)  # noqa: SLF001  (numba has no public way)
    return compiled


def kernel(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Compile a function that Python calls; store the result on disk."""
    compiled: Callable[Given, Result] = _keep_on_disk(_compile(function, PLAIN))
    return compiled


def inner(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Compile a function that only kernels call."""
    return _compile(function, PLAIN | {"no_cpython_wrapper": True})


def fused(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Compile a function on vectors, for kernels only; rounds a product and sum once (a fifth faster).

    The last bits of a float64 therefore depend on the processor, as in numpy's matrix products.
    """
    return _compile(function, PLAIN | {"no_cpython_wrapper": True, "fastmath": {"contract"}})


def kernel_making_arrays(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Compile as ``kernel`` does, for a function that creates arrays or passes slices to other functions."""
    compiled: Callable[Given, Result] = _keep_on_disk(_compile(function, {"pipeline_class": AnyLoops}))
    return compiled


def inner_making_arrays(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Compile as ``inner`` does, for kernels that create arrays."""
    return _compile(function, {"pipeline_class": AnyLoops, "no_cpython_wrapper": True})


def _compile(function: Callable[Given, Result], options: dict[str, Any]) -> Callable[Given, Result]:
    decorate: Any = numba.njit  # its type stubs omit the options about entry points
    made = decorate(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)
    compiled: Callable[Given, Result] = made(function)
    _unify_integer_types(compiled)
    return compiled


def _unify_integer_types(compiled: Any) -> None:
    """Compile once for all integers; numba would compile a function again for each constant argument."""
    if not hasattr(compiled, "get_call_template"):  # a plain function: NUMBA_DISABLE_JIT
        return
    resolve, widen = compiled.get_call_template, cast("Callable[[object], object]", types.unliteral)

    def resolve_types(args: Iterable[object], named: Mapping[str, object]) -> Any:
        return resolve(tuple(map(widen, args)), {name: widen(given) for name, given in named.items()})

    compiled.get_call_template = resolve_types


PLAIN: dict[str, Any] = {"pipeline_class": PlainLoops, "_nrt": False}
"""``_nrt``: no reference counting, because nothing is allocated."""


@kernel
def _add_one(number: int) -> int:
    return number + 1


def make_ready() -> None:
    """Load the dependencies of the first kernel of a process; this takes as long as fifty kernels."""
    _add_one(0)
