"""All that children share with the server they come from (:mod:`app.jobs.forking`); loaded by it alone.

The garbage collector rests meanwhile: nothing of what is loaded here is ever let go, and looking through it
again and again takes a sixth of the time. Frozen, it is not looked at in the children either, so that memory
shared with them stays shared.
"""

import gc
import importlib

_SCIENCE = ("app.workflow", "app.inspection")


def load() -> None:
    """Load the science, and the part of the compiler that fetches what was compiled before."""
    gc.disable()
    for name in _SCIENCE:
        importlib.import_module(name)
    importlib.import_module("fusion.numba_kernels").make_ready()
    gc.freeze()
    gc.enable()


load()
