"""The window of a shift is on the clock that a person states, also after its zone has changed."""

from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from acromion.app.analysis.inspect import read_on_stated_clock
from acromion.app.batch.folder import Task
from acromion.app.batch.shifts import cut_as_asked, split_into_shifts
from acromion.app.request import ReportRequest
from acromion.app.store.folder import NOTHING_KNOWN
from acromion.fusion.diary import DiaryEntry
from acromion.fusion.errors import UnusableShift
from acromion.fusion.readers import read_recording
from acromion.fusion.readers.time.clock import set_clock
from tests.simulated_week import Week, write_week

CHANGE = datetime(2026, 3, 28, 7)  # noqa: DTZ001  the device's clock; those of Paris change the next night


@pytest.fixture(scope="module")
def weekend(tmp_path_factory: pytest.TempPathFactory) -> Week:
    """Two shifts from 07:00 UTC-05:00: 13:00 and, after the change, 14:00 on the clocks of Paris."""
    return write_week(tmp_path_factory.mktemp("weekend"), days=2, minutes=2, first=CHANGE)


@pytest.mark.parametrize(
    ("shift", "offset_s", "day", "start"),
    [
        ("2026-03-28T13:00:00+01:00/2026-03-28T13:02:00+01:00", 0.0, 0, "2026-03-28T13:00:00+01:00"),
        ("2026-03-29T14:00:00+02:00/2026-03-29T14:02:00+02:00", 0.0, 1, "2026-03-29T14:00:00+02:00"),
        (
            "2026-03-29T13:00:00+02:00/2026-03-29T13:02:00+02:00",
            -3600.0,
            1,
            "2026-03-29T13:00:00+02:00",
        ),
    ],
    ids=["before the change", "after the change", "with a corrected clock"],
)
def test_a_shift_is_cut_and_timed_by_the_stated_clock(
    weekend: Week, shift: str, offset_s: float, day: int, start: str
) -> None:
    request = ReportRequest("week.gt3x", shift=shift, time_zone="Europe/Paris", clock_offset_s=offset_s)

    recording = read_on_stated_clock(weekend.path, request, NOTHING_KNOWN)

    assert recording.start is not None
    assert recording.start.isoformat() == start
    single = read_recording(weekend.days[day])
    assert np.array_equal(recording.segments[0].acc_g, single.segments[0].acc_g)
    assert recording.duration_us == single.duration_us


def test_the_hours_of_a_run_follow_the_zone_that_the_file_names() -> None:
    extent = {"start": "2026-03-28T07:00:00+01:00", "duration_us": 2 * 86_400_000_000, "covered_us": []}
    asked = ReportRequest("week.gt3x", shift="09:00-10:00")

    requests, _ = cut_as_asked(asked, extent | {"time_zone": "Europe/Paris"}, not_removed=False)

    assert requests[1].shift == "2026-03-29T09:00:00+02:00/2026-03-29T10:00:00+02:00"


def test_a_shift_outside_the_recording_is_named_by_the_stated_clock(weekend: Week) -> None:
    shift = "2026-03-30T14:00:00+02:00/2026-03-30T14:02:00+02:00"

    with pytest.raises(UnusableShift) as refusal:
        read_on_stated_clock(
            weekend.path, ReportRequest("week.gt3x", shift=shift, time_zone="Europe/Paris"), NOTHING_KNOWN
        )

    assert refusal.value.facts["window"] == shift


def test_a_device_without_an_offset_keeps_the_hour_of_its_start_after_the_change(weekend: Week) -> None:
    """It reads 07:00 on both days; the clocks of Paris show 08:00 on the second."""
    second = replace(read_recording(weekend.days[1]), start=CHANGE + timedelta(days=1))

    timed = set_clock(second, "Europe/Paris", origin=CHANGE)

    assert timed.start is not None
    assert timed.start.isoformat() == "2026-03-29T08:00:00+02:00"


def test_the_hours_of_a_run_follow_the_stated_zone(weekend: Week, tmp_path: Path) -> None:
    request = ReportRequest("week.gt3x", shift="14:00-14:02", time_zone="Europe/Paris")

    tasks = split_into_shifts([Task(weekend.path, request, tmp_path)], not_removed=False)

    assert tasks[-1].request.shift == "2026-03-29T14:00:00+02:00/2026-03-29T14:02:00+02:00"


def test_of_one_shift_a_pose_without_a_date_is_found_shortly_before_it() -> None:
    extent = {
        "start": "2026-03-02T07:00:00",
        "duration_us": 3_600_000_000,
        "time_zone": "",
        "covered_us": [],
    }
    pose = DiaryEntry("07:00:00", "07:00:10", "pose", line=2)
    asked = ReportRequest("day.gt3x", shift="07:05-07:20", diary=(pose,))

    (request,), _ = cut_as_asked(asked, extent, not_removed=False)

    assert request.shift == "2026-03-02T07:00:00/2026-03-02T07:20:00"
    assert [entry.kind for entry in request.diary] == ["outside", "pose"]
