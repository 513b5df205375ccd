"""The archive around a `.gt3x`: judged before it is unpacked, refused with the cause.

`tests/badfiles` (rows 1 to 16 and 41 to 42) has the other archives.
"""

import io
import zipfile
from collections.abc import Mapping

import pytest

from fusion.errors import DamagedFile, FusionError, UnsafeArchive, WrongExtension
from tests.badfiles.gt3x_files import archive
from tests.fusion.readers.gt3x.gt3x_builder import INFO, T0, log_of, pack, read_log, record, schema, second
from tests.fusion.readers.seen import read_file

LOG = log_of(range(20))
WHOLE = pack(LOG).getvalue()
PACKED = pack(LOG, compression=zipfile.ZIP_DEFLATED).getvalue()
ENTRY = WHOLE.index(b"PK\x01\x02")
PARTS: Mapping[str, bytes | str] = {"log.bin": LOG, "info.txt": INFO}


def flip(content: bytes, at: int, bits: int = 0xFF) -> bytes:
    return content[:at] + bytes([content[at] ^ bits]) + content[at + 1 :]


def double_log() -> bytes:
    file = io.BytesIO(WHOLE)
    with zipfile.ZipFile(file, "a") as added, pytest.warns(UserWarning, match="Duplicate name"):
        added.writestr("log.bin", b"")
    return file.getvalue()


@pytest.mark.parametrize(
    ("content", "code", "facts"),
    [
        (WHOLE[: len(WHOLE) // 2], "E-ZIP-TRUNC", {"n": len(WHOLE) // 2}),
        (WHOLE[:-40], "E-ZIP-TRUNC", {"n": len(WHOLE) - 40}),
        (flip(PACKED, 200), "E-ZIP-CRC", {"member": "log.bin"}),
        (WHOLE[:5000] + WHOLE[5100:], "E-ZIP-CRC", {"member": "log.bin"}),
        (archive({"info.txt": INFO}), "E-GT3X-PART", {"member": "log.bin"}),
        (archive({"log.bin": LOG}), "E-GT3X-PART", {"member": "info.txt"}),
        (double_log(), "E-ZIP-UNSAFE", {"reason": "duplicate"}),
        (flip(WHOLE, ENTRY + 8, 1), "E-ZIP-UNSAFE", {"reason": "encrypted"}),
    ],
    ids=["half", "no index", "flipped", "bytes lost", "no log", "no info", "doubled", "encrypted"],
)
def test_a_damaged_archive_is_refused_with_its_cause(content: bytes, code: str, facts: object) -> None:
    with pytest.raises(FusionError) as refusal:
        read_file(content)

    assert (refusal.value.code, refusal.value.facts) == (code, facts)


@pytest.mark.parametrize("name", ["../../../tmp/evil.txt", "/etc/evil.txt", "a\\b.txt", "C:evil.txt"])
def test_an_unsafe_member_name_is_refused(name: str) -> None:
    with pytest.raises(UnsafeArchive) as refusal:
        read_file(archive({**PARTS, name: b""}))

    assert refusal.value.facts == {"reason": "name"}


def test_too_many_members_are_refused() -> None:
    with pytest.raises(UnsafeArchive) as refusal:
        read_file(archive({f"m{k}": b"" for k in range(65)}))

    assert refusal.value.facts["reason"] == "members"


def test_a_zip_bomb_is_refused_before_it_is_unpacked() -> None:
    with pytest.raises(UnsafeArchive) as refusal:
        read_file(archive({"log.bin": bytes(30_000_000), "info.txt": INFO}, zipfile.ZIP_DEFLATED))

    assert refusal.value.facts["reason"] == "ratio"


def test_samples_without_a_schema_are_refused_as_a_part_that_is_missing() -> None:
    with pytest.raises(FusionError) as refusal:
        read_log(b"".join(second(T0 + s) for s in range(20)))

    assert (refusal.value.code, refusal.value.facts) == ("E-GT3X-PART", {"member": "SENSOR_SCHEMA"})


def test_samples_that_were_wiped_are_refused_as_damaged() -> None:
    wiped = b"".join(record(25, T0 + s, bytes(2102)) for s in range(20))

    with pytest.raises(DamagedFile):
        read_log(record(24, T0, schema()) + wiped)


def test_a_table_named_gt3x_is_refused_by_its_content() -> None:
    with pytest.raises(WrongExtension) as refusal:
        read_file(b"Timestamp,Accelerometer X\n1,2\n", "shift.gt3x")

    assert refusal.value.facts == {"ext": ".gt3x", "kind": "text", "right": ".csv"}


def test_a_gt3x_named_csv_is_refused_with_the_right_name() -> None:
    with pytest.raises(WrongExtension) as refusal:
        read_file(WHOLE, "shift.csv")

    assert refusal.value.facts["right"] == ".gt3x"
