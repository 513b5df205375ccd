"""The raw file of a live session: every frame as received, in a format that ``acromion run`` reads.

The header lines that change (when the pose was held, when the session was stopped) have a fixed width and are
overwritten in place. Rows are with the operating system when :meth:`RawFile.write` returns, and on disk after
:meth:`RawFile.sync`, which the session calls every second. An interrupted session has ``stopped: no``; it
loses at most the data of :data:`SYNC_S` plus the time until the interruption was noticed.
"""

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from acromion.app.live.cue_log import format_rule, get_limit, parse_rule
from acromion.app.live.ports import EARLY, read_pieces, read_session_options
from acromion.app.live.sources import SourceFacts
from acromion.app.request import clean_file_name
from acromion.app.store.permissions import create_file
from acromion.fusion.conventions import ArmAxis, Side
from acromion.fusion.errors import FusionError
from acromion.fusion.live import Frames
from acromion.fusion.live.cues import CueRule
from acromion.fusion.live.lines import LineReader
from acromion.fusion.recording import MICROSECONDS

SYNC_S = 1.0
PREFIX = "live-"
COLUMNS = "time_us,counter,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
WIDTH = 40
_NOT_STOPPED = "no"


@dataclass(frozen=True, slots=True)
class Wearer:
    """The arm and subject, and the sensor's axis if it was strapped along the arm."""

    subject: str = ""
    side: Side | None = None
    arm_axis: ArmAxis | None = None


UNKNOWN = Wearer()


class RawFile:
    """Appends frames to a raw file; a context manager."""

    def __init__(self, path: Path, facts: SourceFacts, wearer: Wearer = UNKNOWN, cues: str = "") -> None:
        """Create the file with its header; ``cues`` are the selected rules. Raises OSError."""
        self.path = path
        self._places: dict[str, int] = {}
        self._file = create_file(path)
        start, ranges = facts.start, (facts.acc_range_g, facts.gyr_range_dps)
        acc_range_g, gyr_range_dps = ("" if most is None else f"{most:g}" for most in ranges)
        stated = {
            "device": facts.device,
            "source": clean_file_name(facts.name),
            "start": start.isoformat(timespec="milliseconds") if start else "",
            "rate_hz": f"{facts.rate_hz:.6g}",
            "acc_range_g": acc_range_g,
            "gyr_range_dps": gyr_range_dps,
            **asdict(wearer),
            "cues": cues,
            "pose_window_s": "none".ljust(WIDTH),
            "stopped": _NOT_STOPPED.ljust(WIDTH),
        }
        for name, value in stated.items():
            if value:
                self._file.write(f"# {name}: ".encode())
                self._places[name] = self._file.tell()
                self._file.write(f"{value}\n".encode())
        self._file.write(f"{COLUMNS}\n".encode())
        self.sync()

    def write(self, frames: Frames) -> None:
        """Append frames without loss of precision."""
        rows = zip(
            map(str, frames.time_us.tolist()),
            map(str, frames.counter.tolist()),
            *(map(str, column) for column in frames.acc_g.T),
            *(map(str, column) for column in frames.gyr_dps.T),
            strict=True,
        )
        self._file.write("".join(f"{','.join(row)}\n" for row in rows).encode())
        self._file.flush()

    def state_pose(self, start_s: float, end_s: float) -> None:
        """Write the time window of the pose into the header, in seconds from the first frame."""
        self._overwrite("pose_window_s", f"{start_s:.3f},{end_s:.3f}")

    def stop(self, now: datetime) -> None:
        """Mark the session as stopped in the header, and close the file."""
        self._overwrite("stopped", now.isoformat(timespec="seconds"))
        self.close()

    def sync(self) -> None:
        """Flush the written data to disk."""
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Sync and close without marking the session as stopped."""
        if not self._file.closed:
            self.sync()
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _overwrite(self, name: str, value: str) -> None:
        self._file.flush()
        self._file.seek(self._places[name])
        self._file.write(value.ljust(WIDTH).encode())
        self._file.seek(0, os.SEEK_END)


def was_stopped(path: Path) -> bool:
    """Return whether the session of this file was stopped; False if it was interrupted."""
    with path.open("rb") as file:
        head = file.read(4096)
    return b"# stopped: " in head and f"# stopped: {_NOT_STOPPED} ".encode() not in head


@dataclass(frozen=True, slots=True)
class InterruptedSession:
    """The raw file of an interrupted session, and its duration."""

    path: Path
    elapsed_s: float


def find_interrupted_sessions(folder: Path) -> Iterator[InterruptedSession]:
    """Find interrupted sessions in a folder, oldest first; sessions running in other programs also count."""
    for path in sorted(folder.glob(f"{PREFIX}*.csv")):
        if was_stopped(path):
            continue
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - 4096))
            lines = file.read().split(b"\n")[:-1]
        # the last complete row; the first row is at about 0
        stamp = lines[-1].partition(b",")[0] if lines else b""
        yield InterruptedSession(path, int(stamp) / MICROSECONDS if stamp.isdigit() else 0.0)


# Raw files from early bytes: for a session that was killed before its angles were computed.


def write_early_rows(early: Path, raw: Path) -> bool:
    """Rewrite the raw file from the early bytes and delete those; return False if they contained no row.

    Raises OSError, or ValueError if the session options in the file are incomplete.
    """
    content = early.read_bytes()
    raw.unlink(missing_ok=True)
    reader = LineReader()
    found: list[tuple[Frames | None, float]] = []
    with suppress(FusionError, ValueError):  # keep the frames before the error
        came_s = 0.0
        for piece, came_s in read_pieces(content):
            found.append((reader.feed(piece, round(came_s * MICROSECONDS)), came_s))
        found.append((reader.finish(), came_s))
    read = [(frames, came_s) for frames, came_s in found if frames is not None]
    rows = [frames for frames, _ in read if len(frames)]
    if rows:
        asked, facts, (first, came_s) = read_session_options(content), reader.facts, read[0]
        assert facts is not None
        ago_s = float(first.time_us[-1] - first.time_us[0]) / MICROSECONDS
        source = SourceFacts(
            device=facts.device,
            name=asked["name"],
            rate_hz=facts.rate_hz,
            start=datetime.fromtimestamp(came_s, UTC).astimezone() - timedelta(seconds=ago_s),
            acc_range_g=facts.acc_range_g,
            gyr_range_dps=facts.gyr_range_dps,
        )
        cues = " ".join(format_rule(build_rule(rule)) for rule in asked["cues"])
        with RawFile(raw, source, Wearer(asked["subject"], asked["side"], asked["axis"]), cues) as opened:
            for frames in rows:
                opened.write(frames)
    early.unlink()
    return bool(rows)


def recover_early_files(folder: Path) -> None:
    """Write raw files from the early bytes of interrupted terminal sessions; a file that fails stays.

    The raw files get separate names, because another program may be writing the same session.
    """
    for early in sorted(folder.glob(f"{PREFIX}*{EARLY}")):
        with suppress(OSError, ValueError):
            write_early_rows(early, early.with_name(f"{early.stem}-early.csv"))


def build_session_options(name: str, wearer: Wearer, rules: tuple[CueRule, ...]) -> dict[str, Any]:
    """Return the session options that the file of early bytes stores for the raw file."""
    cues = [{"kind": rule.kind, "angle_deg": rule.angle_deg, "limit": get_limit(rule)} for rule in rules]
    return {
        "name": name,
        "subject": wearer.subject,
        "side": wearer.side,
        "axis": wearer.arm_axis,
        "cues": cues,
    }


def build_rule(asked: dict[str, Any]) -> CueRule:
    """Build a cue rule from its kind, angle and limit. Raises ValueError."""
    return parse_rule(f"{asked['kind']}:{asked['angle_deg']}:{asked['limit']}")
