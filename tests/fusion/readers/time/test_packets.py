"""Exports that number their packets and hold no time: MT Manager's, and what a preamble says of the rate."""

import pytest

from fusion.errors import TooShort, UnknownColumns, UnknownRate
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import line, read_text

NAMES = "\t".join(
    ["PacketCounter", "SampleTimeFine", *(f"Acc_{a}_g" for a in "XYZ"), *(f"Gyr_{a}_dps" for a in "XYZ")]
)
PREAMBLE = "// Start Time: Unknown\n// Update Rate: 100.0Hz\n// Firmware Version: 4.0.2\n"


def export(numbers: list[int], preamble: str = PREAMBLE) -> str:
    rows = (f"{n:05d}\t\t" + line(k).replace(",", "\t") for k, n in enumerate(numbers))
    return preamble + NAMES + "\n" + "\n".join(rows) + "\n"


def test_the_rate_of_the_file_goes_before_that_of_the_person() -> None:
    assert read_text(export(list(range(2000))), rate_hz=60.0).rate_hz == pytest.approx(100.0)


def test_a_rate_that_no_logger_has_is_not_believed() -> None:
    text = export(list(range(2000)), "// Update Rate: 100000 Hz\n")

    assert read_text(text, rate_hz=50.0).rate_hz == pytest.approx(50.0)


def test_without_a_rate_a_person_has_to_give_one() -> None:
    with pytest.raises(UnknownRate):
        read_text(export(list(range(2000)), ""))
    assert read_text(export(list(range(2000)), ""), rate_hz=50.0).duration_us == 40_000_000


def test_an_export_with_single_spaces_keeps_its_empty_fields() -> None:
    text = export(list(range(2000)))
    spaced = PREAMBLE + text.removeprefix(PREAMBLE).replace("\t", " ")

    recording = read_text(spaced)

    assert (recording.duration_us, recording.understood["delimiter"]) == (20_000_000, "space")
    assert recording.segments[0].gyr_dps[7].tolist() == [0.5, -0.25, 7.5]
    assert codes(recording) == codes(read_text(text))


def test_packets_that_were_lost_are_missing() -> None:
    recording = read_text(export([*range(1000), *range(1300, 2300)]))

    gap = next(flag for flag in recording.flags if flag.code == "W-GAP")
    assert [len(segment) for segment in recording.segments] == [1000, 1000]
    assert recording.segments[1].start_us == 13_000_000
    assert (gap.first_s, gap.seconds) == (10.0, 3.0)


def test_a_packet_counter_that_starts_over_loses_nothing() -> None:
    recording = read_text(export([n % 65_536 for n in range(65_000, 67_000)]))

    assert recording.duration_us == 20_000_000
    assert "W-GAP" not in codes(recording)


def test_packets_lost_while_the_counter_starts_over_are_missing() -> None:
    numbers = [*range(64_000, 65_500), *range(65_700, 67_000)]

    recording = read_text(export([n % 65_536 for n in numbers]))

    assert recording.duration_us == 30_000_000
    assert sum(flag.seconds for flag in recording.flags if flag.code == "W-GAP") == 2.0


def test_a_column_that_does_not_count_up_is_no_packet_counter() -> None:
    recording = read_text(export([7] * 2000))

    assert recording.duration_us == 20_000_000
    assert recording.understood["time"] == "row number"


def test_less_than_a_second_of_an_unknown_unit_is_too_short() -> None:
    with pytest.raises(TooShort):
        read_text(export([*range(3)], "").replace("_g", "").replace("_dps", ""), rate_hz=100.0)


def test_names_of_columns_that_we_do_not_know_are_told() -> None:
    text = "PacketCounter,Status,Quat_W,Quat_X,Quat_Y,Quat_Z\n" + "1,0,0.5,0.5,0.5,0.5\n" * 100

    with pytest.raises(UnknownColumns) as refusal:
        read_text(text)

    assert refusal.value.facts == {
        "list": "PacketCounter,Status,Quat_W,Quat_X,Quat_Y,Quat_Z",
        "missing": "ax, ay, az, gx, gy, gz",
    }
