"""Stamps in the forms that people and loggers write: offsets, UTC, epochs, times of day, names of zones."""

import io
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from acromion.fusion.errors import UnusableTime
from acromion.fusion.readers import read_recording
from acromion.fusion.readers.samples import SampleColumns
from acromion.fusion.readers.time.grid import leave_out_stopped
from acromion.fusion.recording import Recording
from tests.badfiles.arm import minute
from tests.badfiles.order_files import CALENDAR, stray
from tests.badfiles.table_files import line_changed
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import HEADER, line, read_text, table

NAMES = "timestamp,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n"
ROWS = 2000
"""Twenty seconds at 100 Hz."""
TWENTY_S = 20_000_000
wall = datetime.fromisoformat


def stamped(stamps: list[str], names: str = NAMES) -> str:
    return names + "".join(f"{stamp},{line(k)}\n" for k, stamp in enumerate(stamps))


def moments(first: datetime, change_after_s: float = 99.0, step_s: int = 0) -> list[datetime]:
    """Return the wall clock of each row; it steps once."""
    return [
        first + timedelta(milliseconds=10 * k, seconds=step_s if k >= 100 * change_after_s else 0)
        for k in range(ROWS)
    ]


def written(first: str, pattern: str) -> str:
    """Return rows stamped by a pattern of strftime, in thousandths."""
    clock = moments(wall(first))
    return stamped([moment.strftime(pattern).replace("mmm", f"{moment:%f}"[:3]) for moment in clock])


def read_aware(first: datetime, change_after_s: float, offsets: tuple[str, str]) -> Recording:
    """Read rows of a wall clock whose offset is written behind each stamp and changes once."""
    before, after = (int(offset[:3]) for offset in offsets)
    clock = moments(first, change_after_s, 3600 * (after - before))
    place = round(100 * change_after_s)
    return read_text(
        stamped(
            [f"{one.isoformat(timespec='milliseconds')}{offsets[k >= place]}" for k, one in enumerate(clock)]
        )
    )


def read_wall(first: datetime, change_after_s: float, step_s: int) -> Recording:
    """Read rows of a bare wall clock that steps once."""
    clock = moments(first, change_after_s, step_s)
    return read_text(stamped([moment.isoformat(timespec="milliseconds") for moment in clock]))


@pytest.mark.parametrize(
    ("first", "offsets", "step_s"),
    [
        ("2026-06-03T14:05:06", ("-04:00", "-05:00"), -3600),
        ("2026-06-03T14:05:06", ("-04:00", "+02:00"), 21_600),
        ("2026-11-01T01:23:45", ("-05:00", "-04:00"), 3600),
        ("2026-11-01T01:23:45", ("-03:00", "-05:00"), -7200),
    ],
    ids=["in June", "across the ocean", "the wrong way", "two hours"],
)
def test_another_offset_on_another_day_is_no_daylight_saving(
    first: str, offsets: tuple[str, str], step_s: int
) -> None:
    recording = read_aware(wall(first), 7.3, offsets)

    (flag,) = recording.flags
    assert recording.start == wall(first + offsets[0])
    assert (recording.duration_us, len(recording.segments)) == (TWENTY_S, 1)
    assert (flag.code, flag.first_s, flag.facts) == ("W-OFFSET", 7.3, {"step_s": step_s})


@pytest.mark.parametrize("step_s", [-3600, 3600])
@pytest.mark.parametrize(
    "change",
    ["2026-03-15T02:00", "2026-11-01T04:00", "2026-06-07T02:00"],
    ids=["a Sunday between", "later that Sunday", "a Sunday in June"],
)
def test_an_hour_of_a_wall_clock_where_no_zone_steps_is_no_daylight_saving(change: str, step_s: int) -> None:
    recording = read_wall(wall(change) - timedelta(seconds=10), 10.0, step_s)

    assert recording.duration_us == TWENTY_S + 1_000_000 * max(0, step_s)
    assert codes(recording) == ["W-GAP" if step_s > 0 else "W-CLOCK-BACK"]


@pytest.mark.parametrize(("change", "step_s"), [("2026-11-01T02:00", -3600), ("2027-03-14T02:00", 3600)])
def test_whole_seconds_at_the_hour_of_the_change_cost_no_time(change: str, step_s: int) -> None:
    clock = moments(wall(change) - timedelta(seconds=10), 10.0, step_s)

    recording = read_text(stamped([f"{moment:%Y-%m-%dT%H:%M:%S}" for moment in clock]))

    assert (recording.duration_us, codes(recording)) == (TWENTY_S, ["W-DST", "W-JITTER"])


@pytest.mark.parametrize("tail", ["Z", "z", "+00:00", "+00", " UTC", " GMT", " +0000", "+00:00[Etc/UTC]"])
def test_utc_is_known_and_said(tail: str) -> None:
    recording = read_text(written("2026-03-02 07:57", f"%Y-%m-%dT%H:%M:%S.mmm{tail}"))

    assert recording.start == datetime(2026, 3, 2, 7, 57, tzinfo=UTC)
    assert (recording.time_zone, codes(recording)) == ("UTC+00:00", ["W-UTC"])


@pytest.mark.parametrize(
    ("tail", "offset"),
    [
        *(("-04:00", "UTC-04:00"), (" -04:00", "UTC-04:00"), ("-0400", "UTC-04:00"), ("-05", "UTC-05:00")),
        *((" EDT", "UTC-04:00"), (" HNE", "UTC-05:00"), (" cest", "UTC+02:00"), (" PM EST", "UTC-05:00")),
        *(("+05:30", "UTC+05:30"), ("-03:30", "UTC-03:30"), ("+1400", "UTC+14:00")),
    ],
)
def test_a_zone_behind_the_stamp_is_read(tail: str, offset: str) -> None:
    recording = read_text(written("2026-11-02 12:05", f"%Y-%m-%d %H:%M:%S.mmm{tail}"))

    assert recording.start is not None
    assert (f"{recording.start:%H:%M}", recording.time_zone) == ("12:05", offset)
    assert (recording.duration_us, codes(recording)) == (TWENTY_S, [])


@pytest.mark.parametrize("places", [0, 3, 6, 9], ids=["s", "ms", "us", "ns"])
@pytest.mark.parametrize("has_unit", [True, False], ids=["named", "unnamed"])
def test_an_epoch_gives_the_start_in_utc(places: int, has_unit: bool) -> None:
    first_ms = 1_772_438_220_000  # 2026-03-02 07:57:00 UTC: 20,514 days and 28,620 s
    unit = {0: "s", 3: "ms", 6: "us", 9: "ns"}[places]
    stamps = [
        f"{(first_ms + 10 * k) / 1000:.3f}" if places == 0 else str((first_ms + 10 * k) * 10 ** (places - 3))
        for k in range(ROWS)
    ]
    names = NAMES.replace("timestamp", f"timestamp_{unit}") if has_unit else NAMES

    recording = read_text(stamped(stamps, names))

    assert recording.start == datetime(2026, 3, 2, 7, 57, tzinfo=UTC)
    assert (recording.time_zone, recording.understood["time"]) == ("UTC+00:00", "number since 1970")
    assert (recording.duration_us, codes(recording)) == (TWENTY_S, ["W-UTC"])


def test_a_counter_since_power_on_is_no_epoch() -> None:
    recording = read_text(stamped([str(183_412_000 + 10_000 * k) for k in range(ROWS)]))

    assert (recording.start, recording.time_zone, codes(recording)) == (None, None, [])


@pytest.mark.parametrize(
    ("first", "pattern"),
    [
        ("07:00:00", "%H:%M:%S.mmm"),
        ("23:59:50", "%H:%M:%S.mmm"),
        ("11:59:50", "%I:%M:%S.mmm %p"),
        ("23:59:50", "%I:%M:%S.mmm%p"),
        ("00:00:00", "%I:%M:%S.mmm %p"),
    ],
    ids=["morning", "midnight", "noon of 12 h", "midnight of 12 h", "12 AM"],
)
def test_a_time_of_day_gives_durations_and_says_that_the_date_is_unknown(first: str, pattern: str) -> None:
    recording = read_text(written(f"2026-03-02 {first}", pattern))

    (flag,) = recording.flags
    assert (recording.duration_us, len(recording.segments), recording.start) == (TWENTY_S, 1, None)
    assert (flag.code, flag.facts) == ("W-NO-DATE", {"time_of_day": first})


def test_a_date_in_the_preamble_goes_with_times_of_day() -> None:
    text = "# start: 2026-03-02T23:59:50-05:00\n" + written("2026-03-02 23:59:50", "%H:%M:%S.mmm")

    recording = read_text(text)

    assert recording.start == datetime(2026, 3, 3, 4, 59, 50, tzinfo=UTC)
    assert codes(recording) == []


@pytest.mark.parametrize(
    "pattern", ["%Y%m%dT%H%M%S.mmm", "%m/%d/%Y %I:%M:%S.mmm %p", "%d/%m/%Y %H:%M:%S.mmm"]
)
def test_dates_in_other_forms_are_read_over_midnight(pattern: str) -> None:
    recording = read_text(written("2026-03-22 23:59:50", pattern))

    assert (recording.duration_us, codes(recording)) == (TWENTY_S, [])
    assert recording.start == wall("2026-03-22 23:59:50")


@pytest.mark.parametrize(
    ("zone", "start", "said"),
    [
        (None, "2026-03-02 07:57", []),
        ("UTC", "2026-03-02 07:57+00:00", ["W-UTC"]),
        ("America/Toronto", "2026-03-02 07:57+00:00", ["W-UTC"]),
    ],
)
def test_parquet_stamps_with_a_zone_are_utc(zone: str | None, start: str, said: list[str]) -> None:
    first_us = 1_772_438_220_000_000
    stamps = pa.array([first_us + 10_000 * k for k in range(ROWS)], pa.timestamp("us", tz=zone))
    values = [[float(field) for field in line(k).split(",")] for k in range(ROWS)]
    columns = dict(zip(NAMES.strip().split(",")[1:], map(list, zip(*values, strict=True)), strict=True))
    file = io.BytesIO()
    pq.write_table(pa.table({"timestamp": stamps, **columns}), file)

    recording = read_recording(file, file_name="shift.parquet")

    assert (recording.start, codes(recording)) == (wall(start), said)


@pytest.mark.parametrize(
    ("hour", "pause_h", "said"),
    [
        *((hour, pause_h, "W-GAP") for hour, pause_h in ((8, 13.0), (8, 15.5), (18, 20.0), (23, 12.5))),
        (18, -1.0, "W-CLOCK-BACK"),
    ],
)
def test_a_step_between_bare_times_is_a_pause_or_a_clock_set_back(
    hour: int, pause_h: float, said: str
) -> None:
    clock = moments(wall(f"2026-03-02 {hour:02d}:00"), 10.0, round(3600 * pause_h))

    recording = read_text(stamped([f"{moment:%H:%M:%S.%f}"[:-3] for moment in clock]))

    assert recording.duration_us == TWENTY_S + max(0, round(3_600_000_000 * pause_h))
    assert codes(recording) == [said, "W-NO-DATE"]


def test_rows_that_came_late_over_midnight_are_put_right() -> None:
    stamps = [f"{moment:%H:%M:%S.%f}"[:-3] for moment in moments(wall("2026-03-02 23:59:50"))]
    stamps[995:1005] = [*stamps[1000:1005], *stamps[995:1000]]

    recording = read_text(stamped(stamps))

    assert (recording.duration_us, len(recording.segments)) == (TWENTY_S, 1)
    assert "W-ORDER" in codes(recording)


# Rows come to stand in the order in which they were measured, or nobody claims that they do.

ACC_G, GYR_DPS = minute()


@pytest.mark.parametrize(
    "text",
    [
        stray([0] * 50),
        stray(range(7, 57)),
        line_changed(2001, lambda _: "20000000,0,0,1")(),
        line_changed(2001, lambda _: "20000000,0,0,x,0,0,0")(),
        line_changed(2001, lambda _: "20000000,0,0,NaN,0,0,0")(),
    ],
    ids=["50 stamps at 0", "50 stamps nearly still", "short", "no number", "NaN"],
)
def test_every_sample_but_the_spoilt_one_is_where_it_was_measured(text: str | bytes) -> None:
    (segment,) = read_text(text).segments

    kept = np.arange(6000) != 2000
    np.testing.assert_allclose(segment.acc_g[kept], ACC_G[kept], atol=1e-4)
    np.testing.assert_allclose(segment.gyr_dps[kept], GYR_DPS[kept], atol=1e-3)


def test_the_hour_that_comes_twice_in_fall_is_no_piece_that_goes_on() -> None:
    first = datetime(2026, 11, 1, 1, 30)  # noqa: DTZ001
    moments = [first + timedelta(seconds=k / 10, hours=-1 if k >= 18_000 else 0) for k in range(36_000)]
    rows = [f"{moment.isoformat(timespec='milliseconds')},{line(k)}" for k, moment in enumerate(moments)]

    recording = read_text(CALENDAR + "\n" + "\n".join(rows) + "\n")

    assert codes(recording) == ["W-DST"]
    assert recording.start == first


# Rows that stand in a table twice are counted once.

REPEATED_ROWS = len(ACC_G)
PERIOD_US = 10_000


def row(k: int, stamp_us: int) -> str:
    values = (*ACC_G[k], *GYR_DPS[k])
    return ",".join([str(stamp_us), *(f"{value:.6f}" for value in values)]) + "\n"


def read_rows(numbers: Iterable[int]) -> Recording:
    return read_text(HEADER + "\n" + "".join(row(k, PERIOD_US * k) for k in numbers))


def accelerations(recording: Recording) -> NDArray[np.float32]:
    return np.concatenate([segment.acc_g for segment in recording.segments])


@pytest.mark.parametrize(
    ("numbers", "repeated"),
    [
        ([*range(REPEATED_ROWS), *range(REPEATED_ROWS)], REPEATED_ROWS),
        ([*range(3000), *range(2000, REPEATED_ROWS)], 1000),
        ([*range(3000), *range(2970, REPEATED_ROWS)], 30),
        ([*range(3000), *range(2000, 3000), *range(2000, REPEATED_ROWS)], 2000),
    ],
    ids=["a file put after itself", "ten seconds again", "0.3 s again", "ten seconds thrice"],
)
def test_rows_that_come_again_are_counted_once(numbers: list[int], repeated: int) -> None:
    recording = read_rows(numbers)

    once = read_rows(range(REPEATED_ROWS))
    assert recording.duration_us == once.duration_us
    assert np.array_equal(accelerations(recording), accelerations(once))
    assert [(flag.code, flag.count) for flag in recording.flags] == [("W-DUP", repeated)]


def test_a_counter_that_starts_over_with_other_readings_repeats_nothing() -> None:
    rows = [row(k, PERIOD_US * (k % 3000)) for k in range(REPEATED_ROWS)]

    recording = read_text(HEADER + "\n" + "".join(rows))

    assert recording.duration_us == PERIOD_US * REPEATED_ROWS
    assert "W-DUP" not in codes(recording)


def test_a_held_value_that_a_clock_set_back_stamps_again_is_no_copy() -> None:
    rows = [row(min(k, 2900), PERIOD_US * (k if k < 3000 else k - 50)) for k in range(3040)]

    recording = read_text(HEADER + "\n" + "".join(rows))

    assert codes(recording)[0] == "W-CLOCK-BACK"


# A clock that stops while the sensor goes on: rows with one and the same stamp, for seconds.

SECOND_US = 1_000_000
STOPPED_ROWS = 6000
"""A minute at 100 Hz."""


def stopped(first: int, stop: int, stamp_us: int | None = None, hole_us: int = 0) -> list[int]:
    """A minute whose clock stops at a row, shows one stamp up to another, and goes on as if nothing was."""
    held = 10_000 * first if stamp_us is None else stamp_us
    return [held if first <= k < stop else 10_000 * k + hole_us * (k >= stop) for k in range(STOPPED_ROWS)]


@pytest.mark.parametrize("rows", [60, 2400])
def test_rows_of_a_stopped_clock_are_missing_time(rows: int) -> None:
    recording = read_text(table(stopped(3000, 3000 + rows)))

    assert sum(len(segment) for segment in recording.segments) == STOPPED_ROWS - rows
    assert recording.duration_us == 60 * SECOND_US
    assert codes(recording) == ["W-ROWS-DROPPED", "W-GAP"]


def test_rows_of_a_stopped_clock_beside_a_hole_are_missing() -> None:
    recording = read_text(table(stopped(3000, 4000, hole_us=15 * SECOND_US)))

    assert [(s.start_us, len(s)) for s in recording.segments] == [(0, 3000), (55 * SECOND_US, 2000)]
    assert codes(recording) == ["W-ROWS-DROPPED", "W-GAP"]


@pytest.mark.parametrize("stamp_us", [None, 0])
def test_a_clock_that_stops_before_the_end_leaves_the_rest_as_it_was(stamp_us: int | None) -> None:
    """Before, the rows had another rate than the sensor's, or division by zero ended the reading."""
    recording = read_text(table(stopped(4000, STOPPED_ROWS, stamp_us)))

    assert [(len(s), round(s.rate_hz, 6)) for s in recording.segments] == [(4000, 100.0)]
    assert [(flag.code, flag.count) for flag in recording.flags] == [("W-ROWS-DROPPED", 2000)]


@pytest.mark.parametrize("offset_us", [0, 10**12])
@pytest.mark.parametrize("rows", [60, 2900])
def test_a_clock_that_starts_after_the_sensor_gives_no_time_before(rows: int, offset_us: int) -> None:
    stamps = [0] * rows + [offset_us + 10_000 * k for k in range(rows, STOPPED_ROWS)]

    recording = read_text(table(stamps))

    assert [(len(s), round(s.rate_hz, 6)) for s in recording.segments] == [(STOPPED_ROWS - rows, 100.0)]
    assert [(flag.code, flag.count) for flag in recording.flags] == [("W-ROWS-DROPPED", rows)]


@pytest.mark.parametrize("rows_in_a_second", [4, 100, 130])
def test_a_clock_of_whole_seconds_has_not_stopped(rows_in_a_second: int) -> None:
    seconds = [k // 100 for k in range(STOPPED_ROWS)]
    seconds[3000 : 3000 + rows_in_a_second] = [30] * rows_in_a_second

    recording = read_text(table(SECOND_US * s for s in seconds))

    assert "W-CLOCK-FWD" not in codes(recording)
    assert "W-ROWS-DROPPED" not in codes(recording)


def test_rows_in_uneven_bunches_are_no_stopped_clock() -> None:
    """Without knowing when each was measured there is nothing to time them by."""
    lengths = np.random.default_rng(5).geometric(1 / 40, 400)
    stamps = 10_000 * np.repeat(np.cumsum(lengths), lengths)
    columns = SampleColumns()
    rows = columns.extend(len(stamps))
    columns.stamps[rows] = stamps

    flags = leave_out_stopped(columns)

    assert flags == ()
    assert columns.stamps[: columns.rows].tolist() == stamps.tolist()


@pytest.mark.parametrize("stamps", [stopped(1000, STOPPED_ROWS), [0]], ids=["most rows", "one row"])
def test_a_clock_that_stands_most_of_the_time_is_refused(stamps: list[int]) -> None:
    with pytest.raises(UnusableTime):
        read_text(table(stamps))
