"""What `inspect` calls missing is what the analysis calls missing: one count."""

import io

import pytest

from fusion.pipeline import Analysis, analyse
from fusion.quality import TimeAccount
from fusion.quality.time_account import divide_time, find_exclusions
from fusion.readers import read_recording
from fusion.readers.preview import inspect_recording
from tests.badfiles.gt3x_files import replaced, second
from tests.badfiles.order_files import ordered, thinned_at_random
from tests.badfiles.table_files import stalls


def missing_s(analysis: Analysis) -> dict[str, float]:
    """The missing time by what it consists of."""
    return {part.name: part.duration_us / 1e6 for part in analysis.time.parts if part.account == "missing"}


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (ordered(thinned_at_random(2000, 4000)).encode(), "shift.csv"),
        (stalls().encode(), "shift.csv"),
        (replaced(59, second(59, stamp=59 + 3600))(), "shift.gt3x"),
        (replaced(30, second(30, n_rows=60))(), "shift.gt3x"),
    ],
    ids=["pieces under 1 s", "stalls", "last second an hour late", "60 rows in a second"],
)
def test_inspect_and_analysis_count_alike(content: bytes, name: str) -> None:
    recording = read_recording(io.BytesIO(content), file_name=name)

    told = inspect_recording(recording, find_exclusions(recording))

    assert missing_s(analyse(recording)).get("missing", 0.0) == pytest.approx(told["missing_s"], abs=1e-4)


@pytest.mark.parametrize("place", [0, 59])
def test_one_second_alone_makes_no_hole_of_an_hour(place: int) -> None:
    stamp = -3600 if place == 0 else 3659
    content = replaced(place, second(place, stamp=stamp))()

    recording = read_recording(io.BytesIO(content), file_name="shift.gt3x")

    assert recording.duration_us == 60_000_000
    assert [flag.code for flag in recording.flags] == ["W-CLOCK-FWD"]
    assert f"{recording.start:%H:%M:%S}" == "08:00:00"


@pytest.mark.parametrize(
    ("holes_us", "told"),
    [
        (5_000_000, {"missing": 5_000_000}),
        (4_500_000, {"missing": 5_000_000}),
        (3_000_000, {"missing": 3_000_000, "untrusted": 2_000_000}),
    ],
    ids=["only holes", "less than a second", "two seconds that are not trusted"],
)
def test_what_was_recorded_and_is_not_trusted_is_a_part_of_its_own(
    holes_us: int, told: dict[str, int]
) -> None:
    time = TimeAccount(65_000_000, 60_000_000, 5_000_000, 0)

    parts = divide_time(time, {"work": 60_000_000}, (), holes_us).parts

    assert {part.name: part.duration_us for part in parts if part.account == "missing"} == told
