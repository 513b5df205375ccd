"""Small takers of ``make_report``'s place: an attempt's child process imports them by name."""

import errno
import itertools
import os
import signal
import time
from pathlib import Path

from acromion.app.request import OnStage, ReportRequest
from acromion.fusion.errors import TooShort, UnknownColumns

RESULTS = (
    b'{"time": {"recorded_s": 28800.0, "analysed_s": 27720.0}, "exposure": {"time_above": ['
    b'{"threshold_deg": 30, "percent": 40.0}, '
    b'{"threshold_deg": 60, "percent": 12.34}, {"threshold_deg": 90, "percent": 3.0}], "entries": ['
    b'{"threshold_deg": 60, "count": 512}], "percentiles_deg": {"50": 24.3, "90": 63.2},'
    b' "minutes": {"p50_deg": []}},'
    b' "quality": {"verdict": "good", "warnings": []}}'
)

EXPORTS = (
    "summary.csv", "summary_fr.csv", "summary.xlsx", "summary.parquet",
    "dictionary.csv", "redcap_import.csv", "redcap_dictionary.csv", "datapackage.json",
)  # fmt: skip


def write_report(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Write every product at once; the report holds the first bytes of the recording."""
    on_stage("reading", 0.0)
    (out / "results.json").write_bytes(RESULTS)
    (out / "elevation.parquet").write_bytes(b"PAR1")
    for name in EXPORTS:
        (out / name).write_bytes(name.encode())
    for language in request.languages:
        (out / f"answer.{language}.txt").write_bytes(language.encode())
        (out / f"report.{language}.html").write_bytes(b"<!doctype html>" + log.read_bytes()[:20])
        (out / f"report.{language}.pdf").write_bytes(b"%PDF-" + language.encode())


def write_niceness(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Refuse, and tell how nice the process is in place of a length."""
    raise TooShort(recorded_s=os.nice(0), min_s=0)


def write_slowly(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Take half a minute, and say who does."""
    (log.parent.parent / "child.pid").write_text(str(os.getpid()))
    on_stage("fusing", 0.5)
    (out / "results.json").write_bytes(b"{")
    time.sleep(30)
    write_report(log, request, out, on_stage)


def never_end(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Go on for ever, with progress."""
    for step in itertools.count():
        on_stage("fusing", 1.0 - 1.0 / (step + 2))
        time.sleep(0.2)


def stand_still(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Never come back, as a process does that was stopped."""
    os.kill(os.getpid(), signal.SIGSTOP)


def read_by_columns(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Refuse a table whose columns nobody named; its first line is the identity of its header."""
    if not request.profile:
        raise UnknownColumns(list="a, b, c", header=log.read_bytes().splitlines()[0].decode())
    write_report(log, request, out, on_stage)


def refuse(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Find the recording too short."""
    raise TooShort(s=4.0)


def be_killed(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Die as if the system had run out of memory."""
    os.kill(os.getpid(), signal.SIGKILL)


def fail_by_bug(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Do what nobody foresaw."""
    raise ZeroDivisionError


def take_all_memory(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Ask for a tebibyte."""
    bytearray(1 << 40)


def write_in_a_second(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Take long enough for something to happen meanwhile."""
    on_stage("fusing", 0.5)
    time.sleep(1)
    write_report(log, request, out, on_stage)


def find_no_room(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Meet a full disk half-way."""
    (out / "results.json").write_bytes(b"{")
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def spoil_recording(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Alter the recording while it is analysed."""
    write_report(log, request, out, on_stage)
    log.write_bytes(b"something else")


def write_pair(*given: object) -> None:
    """Write the report of two into the folder of the attempt."""
    out = given[4]
    assert isinstance(out, Path)
    (out / "report.en.pdf").write_bytes(b"%PDF-two")
