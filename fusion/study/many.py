"""Analyse many recordings in several processes, one result at a time."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, replace
from itertools import islice
from multiprocessing import get_context
from os import PathLike
from pathlib import Path

from acromion.fusion.errors import FusionError
from acromion.fusion.pipeline import Analysis, analyse
from acromion.fusion.settings import AnalysisSettings

ChooseSettings = Callable[[Path], AnalysisSettings]


@dataclass(frozen=True, slots=True, eq=False)
class AnalysedFile:
    """The result of one of many recordings.

    ``path``: the recording.
    ``analysis``: its analysis, whose ``recording`` has no samples; None if it cannot be used.
    ``error``: why it cannot be used; None if it can.
    """

    path: Path
    analysis: Analysis | None
    error: FusionError | OSError | None = None


def analyse_many(
    paths: str | PathLike[str] | Iterable[str | PathLike[str]],
    settings: AnalysisSettings | ChooseSettings | None = None,
    workers: int | None = None,
    on_progress: Callable[[int, int, AnalysedFile], None] | None = None,
) -> Iterator[AnalysedFile]:
    """Analyse recordings in several processes and yield each result as soon as it is ready.

    A recording that cannot be used never stops the others. A script must call it below
    ``if __name__ == "__main__":``, because each worker imports the script. ``acromion run`` also writes
    reports and tables, limits memory and time, and continues an interrupted run.

    Parameters
    ----------
    paths
        A recording, or several.
    settings
        For all recordings, or a function that returns those of a path; the defaults if omitted.
    workers
        Number of processes; one fewer than the cores if omitted. One worker is this process.
    on_progress
        Called after each recording with the number done, the number of all, and the result.

    Returns
    -------
    Iterator of AnalysedFile
        In the order in which they are ready. No further recording starts until a result is taken, so memory
        holds at most ``workers`` of them.

    Raises
    ------
    ValueError
        ``workers`` is less than 1.
    concurrent.futures.process.BrokenProcessPool
        A worker was killed, for example for lack of memory.
    """
    every = [Path(path) for path in ([paths] if isinstance(paths, str | PathLike) else paths)]
    count = max(1, (os.cpu_count() or 1) - 1) if workers is None else workers
    if count < 1:
        raise ValueError(f"workers: {workers!r}; allowed: 1 or more")
    chosen = [settings(path) if callable(settings) else settings for path in every]
    results = _analyse_each(every, chosen, min(count, len(every)))
    return _report(results, len(every), on_progress)


def _report(
    results: Iterator[AnalysedFile], total: int, on_progress: Callable[[int, int, AnalysedFile], None] | None
) -> Iterator[AnalysedFile]:
    for done, result in enumerate(results, 1):
        if on_progress is not None:
            on_progress(done, total, result)
        yield result


def _analyse_each(
    paths: list[Path], settings: list[AnalysisSettings | None], workers: int
) -> Iterator[AnalysedFile]:
    tasks = zip(paths, settings, strict=True)
    if workers <= 1:
        yield from (_analyse_one(*task) for task in tasks)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        running: set[Future[AnalysedFile]] = set()
        try:
            while True:
                for task in islice(tasks, workers - len(running)):
                    running.add(pool.submit(_analyse_one, *task))
                if not running:
                    return
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def _analyse_one(path: Path, settings: AnalysisSettings | None) -> AnalysedFile:
    """Analyse a recording; the samples are left out, because they are large and can be read again."""
    try:
        found = analyse(path, settings)
    except (FusionError, OSError) as error:
        return AnalysedFile(path, None, error)
    return AnalysedFile(path, replace(found, recording=replace(found.recording, segments=())))
