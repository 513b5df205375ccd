"""How a process that others are forked from loads what they share with it."""

import gc
import importlib

READING = ("app.jobs.attempt", "app.reading")
ALL = (*READING, "app.workflow", "app.inspection")


def load(names: tuple[str, ...]) -> None:
    """Load modules, and the part of the compiler that fetches what was compiled before.

    The garbage collector rests meanwhile: nothing of what is loaded here is ever let go, and looking through
    it again and again takes a sixth of the time. Frozen, it is not looked at in the children either, so that
    memory shared with them stays shared.
    """
    gc.disable()
    for name in names:
        importlib.import_module(name)
    importlib.import_module("fusion.numba_kernels").make_ready()
    gc.freeze()
    gc.enable()
