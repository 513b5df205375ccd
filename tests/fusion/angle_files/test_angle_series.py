"""Ready angle series: what is read, what is missing, what is refused."""

import hashlib
import io

import numpy as np
import pytest

from acromion.fusion.angle_files.angle_series import read_angle_series
from acromion.fusion.elevation import Elevation
from acromion.fusion.errors import FusionError
from acromion.fusion.recording import QualityFlag, Recording

HEADER = "time_s,elevation_deg\n"


def write(angles: list[str], period_s: float = 0.01, start_s: float = 0.0) -> str:
    return HEADER + "".join(f"{start_s + i * period_s:.6f},{angle}\n" for i, angle in enumerate(angles))


def read(text: str | bytes) -> tuple[Recording, Elevation]:
    return read_angle_series(io.BytesIO(text.encode() if isinstance(text, str) else text))


def test_an_even_series_is_one_segment_at_its_own_rate_from_its_first_row() -> None:
    text = write(["-0.3", "20.5", "180.3"] * 100, start_s=1000.0)

    recording, elevation = read(text)

    (segment,) = elevation.segments
    assert (recording.device, recording.duration_us, recording.rate_hz) == ("angles", 3_000_000, 100.0)
    assert recording.sha256 == hashlib.sha256(text.encode()).hexdigest()
    assert segment.start_us == 0
    assert segment.elevation_deg[:3].tolist() == [0.0, 20.5, 180.0]  # a hair outside is the edge
    assert segment.valid.all()


def test_a_long_stretch_without_angles_ends_the_segment_and_is_missing() -> None:
    recording, elevation = read(write(["10"] * 100 + [""] * 50 + ["20"] * 100))

    assert [(s.start_us, len(s)) for s in elevation.segments] == [(0, 100), (1_500_000, 100)]
    assert recording.flags == (QualityFlag("W-GAP", 1, 0.5),)
    assert recording.duration_us == 2_500_000


def test_rows_left_out_of_the_file_are_missing_like_empty_ones() -> None:
    lines = write(["10"] * 250).splitlines(keepends=True)
    _, elevation = read("".join(lines[:101] + lines[106:]))  # 60 ms: not bridged

    assert [(s.start_us, len(s)) for s in elevation.segments] == [(0, 100), (1_050_000, 145)]


def test_a_hole_of_up_to_50_ms_is_bridged_but_not_valid() -> None:
    _, elevation = read(write(["10"] * 100 + [""] * 4 + ["20"] * 100))

    (segment,) = elevation.segments
    assert np.flatnonzero(~segment.valid).tolist() == [100, 101, 102, 103]
    assert segment.elevation_deg[99:105].tolist() == [10.0, 12.0, 14.0, 16.0, 18.0, 20.0]
    assert segment.bridged == ((100, 104),)


def test_empty_rows_at_both_ends_are_missing() -> None:
    recording, elevation = read(write([""] * 10 + ["10"] * 100 + [""] * 10))

    assert recording.duration_us == 1_200_000
    assert [(s.start_us, len(s)) for s in elevation.segments] == [(100_000, 100)]


def test_stamps_rounded_to_hundredths_make_no_holes_at_60_hz() -> None:
    text = HEADER + "".join(f"{i / 60:.2f},10\n" for i in range(6000))
    _, elevation = read(text)

    (segment,) = elevation.segments
    assert segment.rate_hz == pytest.approx(60.0, rel=1e-4)
    assert segment.valid.all()


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + write(["10", "20"]),
        write(["10", "20"]).replace("\n", "\r\n"),
        "elevation_deg,note,time_s\n10,a,0\n20,b,0.01\n",
        '"time_s","elevation_deg"\n0,10\n0.01,20\n',
        write(["10", "20"]).rstrip("\n"),
        write(["10", "NaN", "20"]).replace("0.020000", "0.020001"),
    ],
    ids=[
        "byte order mark",
        "Windows lines",
        "other columns",
        "quotes",
        "no last line end",
        "NaN for missing",
    ],
)
def test_how_the_table_is_written_does_not_matter(text: str) -> None:
    _, elevation = read(text)

    segment = elevation.segments[0]
    assert segment.elevation_deg[segment.valid].tolist() == [10.0, 20.0]


def test_a_few_unreadable_values_are_missing_and_told() -> None:
    recording, elevation = read(write(["10"] * 500 + ["ten"] + ["10"] * 500))

    assert QualityFlag("W-ROWS-DROPPED", 1) in recording.flags
    assert np.count_nonzero(~elevation.segments[0].valid) == 1


@pytest.mark.parametrize(
    ("text", "code", "facts"),
    [
        ("", "E-EMPTY", {}),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "E-TYPE", {"kind": "binary"}),
        ("a,b\n1,2\n", "E-COLS", {"list": "a,b"}),
        (HEADER, "E-TIME", {"why": "rows"}),
        (write(["10"]), "E-TIME", {"why": "rows"}),
        (write(["10", "", ""]), "E-TIME", {"why": "rows"}),
        (HEADER + "0,10\n1,10\n1,10\n", "E-TIME", {"why": "backwards", "line": 4}),
        (HEADER + "0,10\n1e12,10\n", "E-TIME", {"why": "span"}),
        (write(["", ""]), "E-SHORT", {"s": 0.0}),
        (write(["10", "300"]), "E-ANGLE", {"value": "300", "line": 3}),
        (write(["10", "inf"]), "E-ANGLE", {"value": "inf", "line": 3}),
        (write(["10", "x"]), "E-ROW", {"k": 1, "line": 2}),
        (HEADER + "0;10\n1;20\n", "E-ROW", {"k": 2, "line": 2}),
        (HEADER + "0,10\n,20\n", "E-ROW", {"k": 1, "line": 3}),
    ],
    ids=[
        "nothing", "a picture", "other columns", "no row", "one row", "one angle", "time stands still",
        "thirty thousand years", "no angle", "300 degrees", "infinite", "words", "semicolons", "no time",
    ],
)  # fmt: skip
def test_what_is_no_angle_series_is_refused_with_its_reason(
    text: str | bytes, code: str, facts: dict[str, object]
) -> None:
    with pytest.raises(FusionError) as error:
        read(text)

    assert (error.value.code, error.value.facts) == (code, facts)


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_a_series_from_a_french_spreadsheet_gives_the_same_angles(delimiter: str) -> None:
    angles = [f"{30 + i / 4:.2f}" for i in range(200)] + ["?"]
    english = write(angles, 0.1)
    french = "\ufeff" + english.replace(",", delimiter).replace(".", ",").replace("\n", "\r\n")

    (first, laid), (second, again) = read(english), read(french)

    assert np.array_equal(laid.segments[0].elevation_deg, again.segments[0].elevation_deg)
    assert second.duration_us == first.duration_us
    assert {flag.code for flag in second.flags} - {flag.code for flag in first.flags} == {"W-LOCALE"}
