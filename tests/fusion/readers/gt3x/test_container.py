"""The archive around a `.gt3x`: judged before it is unpacked, refused with the cause."""

import io
import zipfile

import pytest

from fusion.errors import (
    CorruptArchive,
    DamagedFile,
    EmptyFile,
    MissingMember,
    NoGyroscope,
    NoSamples,
    OldDevice,
    TruncatedArchive,
    UnknownColumns,
    UnsafeArchive,
    WrongExtension,
)
from fusion.readers import read_recording
from tests.fusion.readers.gt3x.gt3x_builder import (
    INFO,
    T0,
    log_of,
    pack,
    read_log,
    record,
    schema,
    second,
    spans_s,
)


def test_an_empty_file_is_refused() -> None:
    with pytest.raises(EmptyFile):
        read_recording(io.BytesIO())


@pytest.mark.parametrize("keep", [0.5, 0.999], ids=["cut in half", "index lost"])
def test_a_cut_archive_is_refused_with_its_size(keep: float) -> None:
    content = pack(log_of(range(20))).getvalue()
    cut = content[: int(len(content) * keep)]

    with pytest.raises(TruncatedArchive) as refusal:
        read_recording(io.BytesIO(cut))

    assert refusal.value.facts == {"n": len(cut)}


def test_a_flipped_byte_in_a_packed_member_is_refused() -> None:
    content = bytearray(pack(log_of(range(20)), compression=zipfile.ZIP_DEFLATED).getvalue())
    content[200] ^= 0xFF

    with pytest.raises(CorruptArchive) as refusal:
        read_recording(io.BytesIO(content))

    assert refusal.value.facts == {"member": "log.bin"}


def test_bytes_lost_in_the_middle_are_refused() -> None:
    content = pack(log_of(range(20))).getvalue()

    with pytest.raises(CorruptArchive):
        read_recording(io.BytesIO(content[:5000] + content[5100:]))


def archive_of(members: dict[str, bytes]) -> io.BytesIO:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return file


@pytest.mark.parametrize("absent", ["log.bin", "info.txt"])
def test_a_missing_part_is_named(absent: str) -> None:
    members = {"log.bin": log_of(range(20)), "info.txt": INFO.encode()}
    del members[absent]

    with pytest.raises(MissingMember) as refusal:
        read_recording(archive_of(members))

    assert refusal.value.facts == {"member": absent}


def test_the_generation_without_gyroscope_is_refused_by_name() -> None:
    with pytest.raises(OldDevice):
        read_recording(archive_of({"activity.bin": b"", "lux.bin": b"", "info.txt": INFO.encode()}))


@pytest.mark.parametrize(
    "name", ["../../../tmp/evil.txt", "/etc/evil.txt", "a\\b.txt", "C:evil.txt"], ids=repr
)
def test_an_unsafe_member_name_is_refused(name: str) -> None:
    members = {"log.bin": log_of(range(20)), "info.txt": INFO.encode(), name: b""}

    with pytest.raises(UnsafeArchive) as refusal:
        read_recording(archive_of(members))

    assert refusal.value.facts == {"reason": "name"}


def test_too_many_members_are_refused() -> None:
    with pytest.raises(UnsafeArchive) as refusal:
        read_recording(archive_of({f"m{k}": b"" for k in range(65)}))

    assert refusal.value.facts["reason"] == "members"


def test_a_zip_bomb_is_refused_before_it_is_unpacked() -> None:
    with pytest.raises(UnsafeArchive) as refusal:
        read_recording(archive_of({"log.bin": bytes(30_000_000), "info.txt": INFO.encode()}))

    assert refusal.value.facts["reason"] == "ratio"


def test_a_doubled_member_is_refused() -> None:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("log.bin", log_of(range(20)))
        archive.writestr("info.txt", INFO)
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr("log.bin", b"")

    with pytest.raises(UnsafeArchive) as refusal:
        read_recording(file)

    assert refusal.value.facts == {"reason": "duplicate"}


def test_an_encrypted_member_is_refused() -> None:
    content = bytearray(pack(log_of(range(20))).getvalue())
    entry = content.index(b"PK\x01\x02")
    content[entry + 8] |= 1

    with pytest.raises(UnsafeArchive) as refusal:
        read_recording(io.BytesIO(content))

    assert refusal.value.facts == {"reason": "encrypted"}


def test_an_empty_log_has_no_samples() -> None:
    with pytest.raises(NoSamples):
        read_log(b"")


def test_a_log_with_the_primary_accelerometer_only_has_no_gyroscope() -> None:
    with pytest.raises(NoGyroscope):
        read_log(b"".join(record(26, T0 + s, bytes(600)) for s in range(20)))


def test_samples_without_a_schema_are_refused_as_a_part_that_is_missing() -> None:
    with pytest.raises(MissingMember) as refusal:
        read_log(b"".join(second(T0 + s) for s in range(20)))

    assert refusal.value.facts == {"member": "SENSOR_SCHEMA"}


def test_samples_of_a_schema_without_a_scale_are_refused() -> None:
    with pytest.raises(UnknownColumns):
        read_log(record(24, T0, schema(0.0)) + b"".join(second(T0 + s) for s in range(20)))


def test_samples_that_were_wiped_are_refused_as_damaged() -> None:
    wiped = b"".join(record(25, T0 + s, bytes(2102)) for s in range(20))

    with pytest.raises(DamagedFile) as refusal:
        read_log(record(24, T0, schema()) + wiped)

    assert refusal.value.code == "E-CORRUPT"


def test_a_table_named_gt3x_is_refused_by_its_content() -> None:
    with pytest.raises(WrongExtension) as refusal:
        read_recording(io.BytesIO(b"Timestamp,Accelerometer X\n1,2\n"), file_name="shift.gt3x")

    assert refusal.value.facts == {"ext": ".gt3x", "kind": "text", "right": ".csv"}


def test_a_gt3x_named_csv_is_refused_with_the_right_name() -> None:
    with pytest.raises(WrongExtension) as refusal:
        read_recording(pack(log_of(range(20))), file_name="shift.csv")

    assert refusal.value.facts["right"] == ".gt3x"


@pytest.mark.parametrize("payload", [b"?", b""], ids=["one byte", "no byte"])
def test_many_tiny_records_cost_linear_time(payload: bytes) -> None:
    recording = read_log(record(77, T0, payload) * 200_000 + log_of(range(200)))

    assert spans_s(recording) == [(0.0, 20_000)]
