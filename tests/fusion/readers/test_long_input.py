"""A megabyte of the worst text ends soon: the time to read grows with its length, not with its square."""

import io
import zipfile
from contextlib import suppress

import pytest

from acromion.fusion import read_recording
from acromion.fusion.errors import FusionError
from acromion.fusion.live.lines import LONGEST_LINE_BYTES, LineReader
from tests.fusion.readers.cwa.cwa_builder import log_of

SIZE_BYTES = 1 << 20
HEADER = b"time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
ROWS = b"".join(b"%d,0.0%d,0.02,1.0,0.1,0.2,0.3\n" % (10_000 * k, k % 9) for k in range(300))
REPEATED = [
    b"a",
    b"x",
    b"(",
    b"0 ",
    b"a b",
    b"ax: 0 ",
    b'" ',
    b", ",
    b"-\n",
    b"sampl",
    b"freq",
    b"<!--",
    b"1:1:1 ",
    b"\xff",
    b"1:01:01.1 -> ",
    b"[1:01:01.1",
    b"A: 1, ",
    b"gyr",
    b"X,",
]


def fill(piece: bytes) -> bytes:
    return piece * (SIZE_BYTES // len(piece))


@pytest.mark.parametrize("piece", REPEATED, ids=repr)
@pytest.mark.parametrize("place", ["line above", "name", "value"])
def test_a_file_with_a_megabyte_of_one_text_is_refused(piece: bytes, place: str) -> None:
    text = fill(piece)
    content = {
        "line above": text + b"\n" + HEADER + b"\n" + ROWS,
        "name": HEADER + b"," + text.replace(b"\n", b" ") + b"\n" + ROWS,
        "value": HEADER + b"\n" + ROWS + b"3000000," + text + b"\n" + ROWS,
    }[place]

    with pytest.raises(FusionError):
        read_recording(io.BytesIO(content))


@pytest.mark.parametrize("piece", ["acc_x gyr_x ", "a x ", "accx:", "shimmer_", "device: ", "ax(g) ay(g) "])
def test_a_name_as_long_as_a_line_may_be_is_read(piece: str) -> None:
    name = piece * (60_000 // len(piece))
    content = f"{HEADER.decode()},{name}\n".encode() + ROWS.replace(b"\n", b",1\n")

    assert read_recording(io.BytesIO(content)).rate_hz == pytest.approx(100.0)


@pytest.mark.parametrize("piece", [b"a", b"ax: 0 ", b"(", b'"'], ids=repr)
def test_a_line_of_a_board_that_is_too_long_is_torn(piece: bytes) -> None:
    reader = LineReader()

    reader.feed(piece * (1 + LONGEST_LINE_BYTES // len(piece)) + b"\n", 0)

    assert reader.torn == 1


@pytest.mark.parametrize("piece", ["gyro", "1", "acc_", " ", "linear "], ids=repr)
def test_a_long_name_in_an_archive_takes_no_long_time(piece: str) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for number in range(4):
            archive.writestr(piece * (60_000 // len(piece)) + f"{number}.csv", "time (s),X,Y,Z\n1,2,3,4\n")

    with pytest.raises(FusionError):
        read_recording(packed)


@pytest.mark.parametrize("whole_blocks", [0, 20])
def test_a_megabyte_of_ones_behind_the_header_of_a_cwa_ends_soon(whole_blocks: int) -> None:
    content = log_of(range(whole_blocks)) + b"\xff" * SIZE_BYTES

    with suppress(FusionError):
        read_recording(io.BytesIO(content))


@pytest.mark.parametrize("name", ["c", "acc_x_", "sensor x [g] "])
def test_a_table_of_thirty_thousand_columns_ends_soon(name: str) -> None:
    names = ",".join(f"{name}{number}" for number in range(30_000))
    row = ",".join("1" * 30_000)
    content = f"{HEADER.decode()},{names}\n" + f"0,0,0,1,0,0,0,{row}\n" * 20

    with pytest.raises(FusionError):
        read_recording(io.BytesIO(content.encode()))
