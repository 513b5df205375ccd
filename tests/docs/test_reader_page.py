"""The reader of ``docs/write-a-reader.md`` as it is printed: what it reads, and what it refuses."""

import io
import struct
from types import SimpleNamespace
from typing import Any

import pytest

from acromion.fusion.errors import UnreadableFile
from tests.plugin import START, read_blocks

ROW = struct.pack("<6h", 0, 0, 2048, 0, 0, 0)


@pytest.fixture(scope="module")
def reader() -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(read_blocks()[1], names)
    return names


def read(reader: dict[str, Any], content: bytes) -> Any:
    return reader["read"](SimpleNamespace(file=io.BytesIO(content)), None)


def make_head(rate_hz: int = 100, start_s: int = START) -> bytes:
    return struct.pack("<4sHHq", b"ACME", 7, rate_hz, start_s)


def test_a_whole_file_gives_its_samples_and_its_start(reader: dict[str, Any]) -> None:
    recording = read(reader, make_head() + 3 * ROW)

    assert recording.segments[0].acc_g.tolist() == [[0, 0, 1]] * 3
    assert f"{recording.start:%Y-%m-%dT%H:%M:%S%z}" == "2026-03-02T08:00:00+0000"


@pytest.mark.parametrize(
    "content",
    [
        make_head()[:9],
        make_head(),
        make_head() + ROW[:5],
        make_head(rate_hz=0) + ROW,
        make_head(start_s=2**62) + ROW,
        make_head(start_s=-1) + ROW,
    ],
    ids=[
        "a cut header",
        "no row",
        "a cut row",
        "no rate",
        "a start past every calendar",
        "a start before 1970",
    ],
)
def test_a_file_that_is_not_whole_is_refused(reader: dict[str, Any], content: bytes) -> None:
    with pytest.raises(UnreadableFile):
        read(reader, content)
