"""Stamps in the forms that people and loggers write: offsets, UTC, epochs, times of day, names of zones."""

import io
from datetime import UTC, datetime, timedelta, timezone

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fusion.errors import UnusableTime
from fusion.readers import read_recording
from fusion.readers.tables.dates import parse_zone_s
from tests.fusion.readers.tables.table_builder import codes, line, read_text

NAMES = "timestamp,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n"
ROWS = 2000
"""Twenty seconds at 100 Hz."""


def stamped(stamps: list[str], names: str = NAMES) -> str:
    return names + "".join(f"{stamp},{line(k)}\n" for k, stamp in enumerate(stamps))


def moments(first: datetime, change_after_s: float = 99.0, step_s: int = 0) -> list[datetime]:
    """The wall clock of each row; it steps once."""
    return [
        first + timedelta(milliseconds=10 * k, seconds=step_s if k >= 100 * change_after_s else 0)
        for k in range(ROWS)
    ]


def written(first: datetime, pattern: str) -> str:
    """Rows stamped by a pattern of strftime, in thousandths."""
    return stamped([moment.strftime(pattern).replace("mmm", f"{moment:%f}"[:3]) for moment in moments(first)])


def aware(first: datetime, change_after_s: float, offsets: tuple[str, str]) -> str:
    """Rows of a wall clock whose offset is written behind each stamp and changes once."""
    before, after = (int(offset[:3]) for offset in offsets)
    clock = moments(first, change_after_s, 3600 * (after - before))
    place = round(100 * change_after_s)
    return stamped(
        [
            f"{moment.isoformat(timespec='milliseconds')}{offsets[k >= place]}"
            for k, moment in enumerate(clock)
        ]
    )


@pytest.mark.parametrize("change_after_s", [0.5, 7.3, 19.5])
@pytest.mark.parametrize(
    ("first", "offsets", "step_s"),
    [
        (datetime(2026, 11, 1, 1, 23, 45), ("-04:00", "-05:00"), -3600),  # noqa: DTZ001
        (datetime(2027, 3, 14, 1, 23, 45), ("-05:00", "-04:00"), 3600),  # noqa: DTZ001
        (datetime(2026, 10, 25, 2, 23, 45), ("+02:00", "+01:00"), -3600),  # noqa: DTZ001
        (datetime(2026, 3, 29, 1, 23, 45), ("+01:00", "+02:00"), 3600),  # noqa: DTZ001
    ],
    ids=["Toronto, fall", "Toronto, spring", "Paris, fall", "Paris, spring"],
)
def test_a_change_of_the_offset_costs_no_time(
    first: datetime, offsets: tuple[str, str], step_s: int, change_after_s: float
) -> None:
    recording = read_text(aware(first, change_after_s, offsets))

    (flag,) = recording.flags
    assert (recording.duration_us, len(recording.segments)) == (20_000_000, 1)
    assert recording.start == first.replace(tzinfo=timezone(timedelta(hours=int(offsets[0][:3]))))
    assert (flag.code, flag.first_s, flag.facts) == ("W-DST", change_after_s, {"step_s": step_s})


@pytest.mark.parametrize(
    ("first", "offsets", "step_s"),
    [
        (datetime(2026, 6, 3, 14, 5, 6), ("-04:00", "-05:00"), -3600),  # noqa: DTZ001
        (datetime(2026, 6, 3, 14, 5, 6), ("-04:00", "+02:00"), 21_600),  # noqa: DTZ001
        (datetime(2026, 11, 1, 1, 23, 45), ("-05:00", "-04:00"), 3600),  # noqa: DTZ001
        (datetime(2026, 11, 1, 1, 23, 45), ("-03:00", "-05:00"), -7200),  # noqa: DTZ001
    ],
    ids=["in June", "across the ocean", "the wrong way", "two hours"],
)
def test_another_offset_on_another_day_is_no_daylight_saving(
    first: datetime, offsets: tuple[str, str], step_s: int
) -> None:
    recording = read_text(aware(first, 7.3, offsets))

    (flag,) = recording.flags
    assert (recording.duration_us, len(recording.segments)) == (20_000_000, 1)
    assert (flag.code, flag.first_s, flag.facts) == ("W-OFFSET", 7.3, {"step_s": step_s})


@pytest.mark.parametrize("step_s", [-3600, 3600])
@pytest.mark.parametrize(
    "change",
    [datetime(2026, 3, 15, 2), datetime(2026, 11, 1, 4), datetime(2026, 6, 7, 2)],  # noqa: DTZ001
    ids=["a Sunday between", "later that Sunday", "a Sunday in June"],
)
def test_an_hour_of_a_wall_clock_where_no_zone_steps_is_no_daylight_saving(
    change: datetime, step_s: int
) -> None:
    clock = moments(change - timedelta(seconds=10), 10.0, step_s)

    recording = read_text(stamped([moment.isoformat(timespec="milliseconds") for moment in clock]))

    assert codes(recording) == ["W-GAP" if step_s > 0 else "W-CLOCK-BACK"]


@pytest.mark.parametrize("after_s", [1, 10, 19])
@pytest.mark.parametrize(
    ("change", "step_s"),
    [
        (datetime(2026, 11, 1, 2), -3600),  # noqa: DTZ001
        (datetime(2027, 3, 14, 2), 3600),  # noqa: DTZ001
        (datetime(2026, 10, 25, 3), -3600),  # noqa: DTZ001
        (datetime(2026, 3, 29, 2), 3600),  # noqa: DTZ001
    ],
    ids=["Toronto, fall", "Toronto, spring", "Paris, fall", "Paris, spring"],
)
def test_a_bare_wall_clock_at_its_hour_costs_no_time(change: datetime, step_s: int, after_s: int) -> None:
    clock = moments(change - timedelta(seconds=after_s), after_s, step_s)

    recording = read_text(stamped([moment.isoformat(timespec="milliseconds") for moment in clock]))

    (flag,) = recording.flags
    assert (recording.duration_us, len(recording.segments)) == (20_000_000, 1)
    assert (flag.code, flag.first_s, flag.facts) == ("W-DST", after_s, {"step_s": step_s})


@pytest.mark.parametrize(
    ("first", "step_s"),
    [(datetime(2026, 11, 1, 1, 59, 50), -3600), (datetime(2027, 3, 14, 1, 59, 50), 3600)],  # noqa: DTZ001
)
def test_whole_seconds_at_the_hour_of_the_change_cost_no_time(first: datetime, step_s: int) -> None:
    clock = moments(first, 10.0, step_s)

    recording = read_text(stamped([f"{moment:%Y-%m-%dT%H:%M:%S}" for moment in clock]))

    assert recording.duration_us == 20_000_000
    assert codes(recording) == ["W-DST", "W-JITTER"]


@pytest.mark.parametrize("tail", ["Z", "+00:00", "+00", " UTC", " GMT", " +0000", "+00:00[Etc/UTC]"])
def test_utc_is_known_and_said(tail: str) -> None:
    recording = read_text(written(datetime(2026, 3, 2, 7, 57), f"%Y-%m-%dT%H:%M:%S.mmm{tail}"))  # noqa: DTZ001

    assert recording.start == datetime(2026, 3, 2, 7, 57, tzinfo=UTC)
    assert (recording.time_zone, codes(recording)) == ("UTC+00:00", ["W-UTC"])


@pytest.mark.parametrize(
    ("tail", "offset"),
    [
        ("-04:00", "UTC-04:00"),
        (" -04:00", "UTC-04:00"),
        ("-0400", "UTC-04:00"),
        (" EDT", "UTC-04:00"),
        (" HNE", "UTC-05:00"),
        (" cest", "UTC+02:00"),
        ("+05:30", "UTC+05:30"),
        (" PM EST", "UTC-05:00"),
    ],
)
def test_a_zone_behind_the_stamp_is_read(tail: str, offset: str) -> None:
    recording = read_text(written(datetime(2026, 11, 2, 12, 5), f"%Y-%m-%d %H:%M:%S.mmm{tail}"))  # noqa: DTZ001

    assert recording.start is not None
    assert (f"{recording.start:%H:%M}", recording.time_zone) == ("12:05", offset)
    assert (recording.duration_us, codes(recording)) == (20_000_000, [])


@pytest.mark.parametrize("name", ["AST", "BST", "XYZ"])
def test_the_name_of_a_zone_of_several_meanings_is_refused(name: str) -> None:
    text = written(datetime(2026, 11, 2, 12, 5), f"%Y-%m-%d %H:%M:%S.mmm {name}")  # noqa: DTZ001

    with pytest.raises(UnusableTime) as refusal:
        read_text(text)

    assert refusal.value.facts == {"why": "zone name", "line": 2}


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("-03:30", -12_600), ("+1400", 50_400), ("+15:00", None), ("z", 0), ("IST", None), ("-05", -18_000)],
)
def test_a_zone_is_told_in_seconds_or_not_at_all(text: str, seconds: int | None) -> None:
    assert parse_zone_s(text) == seconds


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
    assert (recording.duration_us, codes(recording)) == (20_000_000, ["W-UTC"])


def test_a_counter_since_power_on_is_no_epoch() -> None:
    recording = read_text(stamped([str(183_412_000 + 10_000 * k) for k in range(ROWS)]))

    assert (recording.start, recording.time_zone, codes(recording)) == (None, None, [])


@pytest.mark.parametrize(
    ("first", "pattern", "said"),
    [
        (datetime(2026, 3, 2, 7, 0), "%H:%M:%S.mmm", "07:00:00"),  # noqa: DTZ001
        (datetime(2026, 3, 2, 23, 59, 50), "%H:%M:%S.mmm", "23:59:50"),  # noqa: DTZ001
        (datetime(2026, 3, 2, 11, 59, 50), "%I:%M:%S.mmm %p", "11:59:50"),  # noqa: DTZ001
        (datetime(2026, 3, 2, 23, 59, 50), "%I:%M:%S.mmm%p", "23:59:50"),  # noqa: DTZ001
        (datetime(2026, 3, 2, 0, 0), "%I:%M:%S.mmm %p", "00:00:00"),  # noqa: DTZ001
    ],
    ids=["morning", "midnight", "noon of 12 h", "midnight of 12 h", "12 AM"],
)
def test_a_time_of_day_gives_durations_and_says_that_the_date_is_unknown(
    first: datetime, pattern: str, said: str
) -> None:
    recording = read_text(written(first, pattern))

    (flag,) = recording.flags
    assert (recording.duration_us, len(recording.segments), recording.start) == (20_000_000, 1, None)
    assert (flag.code, flag.facts) == ("W-NO-DATE", {"time_of_day": said})


def test_a_date_in_the_preamble_goes_with_times_of_day() -> None:
    text = written(datetime(2026, 3, 2, 23, 59, 50), "%H:%M:%S.mmm")  # noqa: DTZ001

    recording = read_text("# start: 2026-03-02T23:59:50-05:00\n" + text)

    assert recording.start == datetime(2026, 3, 3, 4, 59, 50, tzinfo=UTC)
    assert codes(recording) == []


@pytest.mark.parametrize(
    "pattern", ["%Y%m%dT%H%M%S.mmm", "%m/%d/%Y %I:%M:%S.mmm %p", "%d/%m/%Y %H:%M:%S.mmm"]
)
def test_dates_in_other_forms_are_read(pattern: str) -> None:
    first = datetime(2026, 3, 22, 23, 59, 50)  # noqa: DTZ001

    recording = read_text(written(first, pattern))

    assert (recording.start, recording.duration_us, codes(recording)) == (first, 20_000_000, [])


def test_compact_dates_in_utc_are_read() -> None:
    recording = read_text(written(datetime(2026, 3, 22, 23, 59, 50), "%Y%m%dT%H%M%S.mmmZ"))  # noqa: DTZ001

    assert recording.start == datetime(2026, 3, 22, 23, 59, 50, tzinfo=UTC)


def test_stamps_of_an_unknown_form_are_refused_with_line_and_cure() -> None:
    text = written(datetime(2026, 3, 2, 7, 0), "%d %b %Y %H:%M:%S.mmm")  # noqa: DTZ001

    with pytest.raises(UnusableTime) as refusal:
        read_text(text)

    assert refusal.value.facts == {"why": "form", "line": 2}


@pytest.mark.parametrize(
    ("zone", "start", "said"),
    [
        (None, datetime(2026, 3, 2, 7, 57), []),  # noqa: DTZ001
        ("UTC", datetime(2026, 3, 2, 7, 57, tzinfo=UTC), ["W-UTC"]),
        ("America/Toronto", datetime(2026, 3, 2, 7, 57, tzinfo=UTC), ["W-UTC"]),
    ],
)
def test_parquet_stamps_with_a_zone_are_utc(zone: str | None, start: datetime, said: list[str]) -> None:
    first_us = 1_772_438_220_000_000
    stamps = pa.array([first_us + 10_000 * k for k in range(ROWS)], pa.timestamp("us", tz=zone))
    values = [[float(field) for field in line(k).split(",")] for k in range(ROWS)]
    columns = dict(zip(NAMES.strip().split(",")[1:], map(list, zip(*values, strict=True)), strict=True))
    file = io.BytesIO()
    pq.write_table(pa.table({"timestamp": stamps, **columns}), file)

    recording = read_recording(file, file_name="shift.parquet")

    assert (recording.start, codes(recording)) == (start, said)


@pytest.mark.parametrize(
    ("hour", "pause_h"), [(8, 13), (8, 15.5), (18, 13), (18, 20), (23, 12.5)], ids=lambda value: f"{value}"
)
def test_a_pause_of_half_a_day_between_bare_times_is_missing(hour: int, pause_h: float) -> None:
    clock = moments(datetime(2026, 3, 2, hour, 0), 10.0, round(3600 * pause_h))  # noqa: DTZ001

    recording = read_text(stamped([f"{moment:%H:%M:%S.%f}"[:-3] for moment in clock]))

    assert recording.duration_us == 20_000_000 + round(3_600_000_000 * pause_h)
    assert codes(recording) == ["W-GAP", "W-NO-DATE"]


def test_a_bare_clock_set_back_by_an_hour_is_no_new_day() -> None:
    clock = moments(datetime(2026, 3, 2, 18, 0), 10.0, -3600)  # noqa: DTZ001

    recording = read_text(stamped([f"{moment:%H:%M:%S.%f}"[:-3] for moment in clock]))

    assert (recording.duration_us, codes(recording)) == (20_000_000, ["W-CLOCK-BACK", "W-NO-DATE"])


def test_rows_that_came_late_over_midnight_are_put_right() -> None:
    stamps = [f"{moment:%H:%M:%S.%f}"[:-3] for moment in moments(datetime(2026, 3, 2, 23, 59, 50))]  # noqa: DTZ001
    stamps[995:1005] = [*stamps[1000:1005], *stamps[995:1000]]

    recording = read_text(stamped(stamps))

    assert (recording.duration_us, len(recording.segments)) == (20_000_000, 1)
    assert "W-ORDER" in codes(recording)
