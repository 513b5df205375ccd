"""Readers of other packages, asked as our own are: one that fails is named, and stops no other."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint
from typing import TypeVar

import numpy as np

from fusion.errors import FailedReader, FusionError
from fusion.plugins import find_entry_points, find_version
from fusion.readers.source import Source
from fusion.recording import Recording

LONGEST_CAUSE = 200
PLAIN_NAME = re.compile(r"\w[\w +\-./()]{0,59}")
"""A device's name is printed in reports, tables and Markdown."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class PlugIn:
    """A reader of another package: ``entry`` names a module or an object with ``recognise`` and ``read``."""

    entry: EntryPoint

    @property
    def name(self) -> str:
        """Name of the entry point."""
        return self.entry.name

    def recognise(self, source: Source) -> bool:
        """Whether the file is the plug-in's.

        Raises FailedReader: it cannot be loaded, or fails.
        """
        return self._ask(lambda: bool(self.entry.load().recognise(source)))

    def read(self, source: Source, rate_hz: float | None) -> Recording:
        """Read the file; the recording bears the name and the version of the plug-in.

        Raises
        ------
        FailedReader
            It fails, or what it gives is no recording.
        fusion.errors.FusionError
            As the plug-in refuses the file.
        """
        recording = self._ask(lambda: self.entry.load().read(source, rate_hz))
        fault = self._ask(lambda: find_fault(recording))
        if fault:
            raise self._fail(fault)
        named: Recording = replace(recording, reader=(self.name, find_version(self.entry)))
        return named

    def _ask(self, work: Callable[[], T]) -> T:
        """Do the plug-in's part; whatever it raises, but a refusal of ours, is its failure."""
        try:
            return work()
        except MemoryError:
            raise
        except (Exception, SystemExit) as error:
            if isinstance(error, FusionError) and type(error).__module__ == FusionError.__module__:
                raise
            raise self._fail(f"{type(error).__name__}: {error}") from error

    def _fail(self, cause: str) -> FailedReader:
        return FailedReader(reader=self.name, version=find_version(self.entry), cause=cause[:LONGEST_CAUSE])


def find_plugins() -> tuple[PlugIn, ...]:
    """Return the readers that are installed, without loading them."""
    return tuple(PlugIn(entry) for entry in find_entry_points())


def find_fault(recording: object) -> str:
    """Say what a plug-in's recording lacks; empty where nothing does."""
    if not isinstance(recording, Recording):
        return f"read gave {type(recording).__name__}, not a Recording"
    if not PLAIN_NAME.fullmatch(recording.device):
        return "device is no plain name of 1 to 60 letters, digits, spaces and any of + - . / ( )"
    end_us = 0
    for segment in recording.segments:
        if not segment.rate_hz > 0:
            return "a segment without a rate"
        for name, values in (("acc_g", segment.acc_g), ("gyr_dps", segment.gyr_dps)):
            is_fit = values.dtype == np.float32 and values.shape == (len(segment), 3)
            if not is_fit or not np.isfinite(values).all():
                return f"{name} is not float32 of shape (n, 3), all finite"
        if segment.start_us < end_us:
            return "segments overlap, or are not in the order of time"
        end_us = segment.end_us
    is_whole = bool(recording.segments) and end_us <= recording.duration_us + 1
    return "" if is_whole else "no segment, or no duration"
