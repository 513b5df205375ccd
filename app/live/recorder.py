"""One running live session with its raw file, and the difference between displayed and reported angles."""

import json
import time
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from acromion.app.live.cue_log import format_rule
from acromion.app.live.ports import EarlyPort
from acromion.app.live.raw_file import SYNC_S, UNKNOWN, RawFile, Wearer
from acromion.app.live.sources import SourceFacts
from acromion.app.report.words.numbers import format_duration, format_number, format_percent
from acromion.app.report.words.wording import fill, load_wording
from acromion.app.request import Language
from acromion.fusion.angle_files.elevation_parquet import read_elevation
from acromion.fusion.live import (
    Frames,
    LiveDifference,
    LiveRows,
    LiveSession,
    LiveStatus,
    ShownAngles,
    compare_shown,
)
from acromion.fusion.live.cues import Cue, CueRule, CueWatch
from acromion.fusion.pose.rules import point_along


class Recorder:
    """Writes each frame before it is displayed, and syncs every second."""

    def __init__(
        self,
        path: Path,
        facts: SourceFacts,
        wearer: Wearer = UNKNOWN,
        rules: tuple[CueRule, ...] = (),
    ) -> None:
        """Create the raw file. Raises OSError.

        An axis set by a person overrides the axis of the source.
        """
        self.facts, self.shown = facts, ShownAngles()
        axis = point_along(wearer.arm_axis) if wearer.arm_axis else facts.arm_axis
        self.session = LiveSession(facts.rate_hz, axis)
        self.cues: list[Cue] = []
        self._cue_watch = CueWatch(rules)
        self._synced_s = time.monotonic()
        self._raw = RawFile(path, facts, wearer, " ".join(map(format_rule, rules)))
        self._stated_pose_s: tuple[float, float] | None = None

    @property
    def path(self) -> Path:
        """The path of the raw file."""
        return self._raw.path

    def take(self, frames: Frames) -> LiveRows:
        """Write the frames and return their angles."""
        self._raw.write(frames)
        rows = self.session.take(frames)
        self.shown.keep(rows)
        pose_s = self.session.pose_window_s
        if pose_s is not None and pose_s != self._stated_pose_s:
            self._raw.state_pose(*pose_s)
            self._stated_pose_s = pose_s
        if time.monotonic() - self._synced_s >= SYNC_S:
            self.sync()
        return rows

    def sync(self) -> None:
        """Flush the written data to disk."""
        self._raw.sync()
        self._synced_s = time.monotonic()

    def settle(self, early: EarlyPort) -> bool:
        """Delete the early bytes once the raw file contains all of them; return whether it does."""
        if early.is_behind:
            return False
        self.sync()
        early.release()
        return True

    def take_cues(self, rows: LiveRows) -> list[Cue]:
        """Return and log the cues of these rows."""
        cues = self._cue_watch.take(rows)
        self.cues += cues
        return cues

    def status(self) -> LiveStatus:
        """Return the status of the session."""
        return self.session.status()

    def stop(self) -> Path:
        """End the session; its raw file is now an ordinary recording."""
        self._raw.stop(datetime.now(UTC))
        return self._raw.path

    def break_off(self) -> None:
        """Close the file without marking the session as stopped."""
        self._raw.close()


def measure_difference(shown: ShownAngles, elevation: Path) -> LiveDifference | None:
    """Compare the displayed angles with the report's ``elevation.parquet``."""
    return compare_shown(shown, read_elevation(elevation))


def write_difference(shown: Path, elevation: Path, language: Language, out: Path) -> None:
    """Compare the stored angles of an ended session with the report, and write ``difference.json``."""
    found = measure_difference(ShownAngles.load(shown.read_bytes()), elevation)
    facts = {
        name: tuple(round(one, 6) for one in value) if isinstance(value, tuple) else round(value, 6)
        for name, value in (asdict(found) if found else {}).items()
    }
    facts["compared_s"] = found.compared_s if found else None
    (out / "difference.json").write_text(json.dumps(facts | {"text": describe_difference(found, language)}))


def describe_difference(found: LiveDifference | None, language: Language) -> str:
    """Format the difference as a sentence."""
    words = load_wording(language, "live")["difference"]
    if found is None:
        return str(words["none"])
    names = ("below_30", "from_30", "from_60", "from_90")
    shares = zip(names, found.live_percent, found.report_percent, strict=True)
    facts = {
        "time": format_duration(found.compared_s, language),
        "rmse": format_number(found.rmse_deg, 1, language),
        "bias": format_number(found.bias_deg, 1, language),
        **{
            name: f"{format_percent(live, language)} / {format_percent(report, language)}"
            for name, live, report in shares
        },
    }
    return fill(words["line"], facts)
