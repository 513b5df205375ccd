"""The form of a sealed file."""

import io
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.storage.keys import RecordingKey
from app.storage.sealed import (
    HEAD_BYTES,
    PIECE_BYTES,
    SealedFile,
    Sealer,
    measure_content,
    measure_growing,
    measure_grown,
    measure_sealed,
    read_growing,
    read_head,
)
from app.storage.store import BrokenSeal

KEY = RecordingKey("rec_0123456789abcdef", bytes(range(32)))
CONTENT = random.Random(1).randbytes(3 * PIECE_BYTES + 5)
SEALED_BYTES = PIECE_BYTES + 16
SIZES = (0, 1, 16, 17, PIECE_BYTES - 1, PIECE_BYTES, PIECE_BYTES + 1, 3 * PIECE_BYTES)


def seal(content: bytes, chunk_bytes: int = 1 << 18) -> bytes:
    sealed = io.BytesIO()
    sealer = Sealer(sealed.write, KEY)
    for start in range(0, len(content), chunk_bytes):
        sealer.write(content[start : start + chunk_bytes])
    sealer.close()
    return sealed.getvalue()


def open_sealed(sealed: bytes, key: RecordingKey = KEY) -> SealedFile:
    head = read_head(sealed)
    assert head is not None
    return SealedFile(io.BytesIO(sealed), key, head)


def read_all(sealed: bytes) -> bytes:
    return b"".join(open_sealed(sealed).read_pieces())


@pytest.mark.parametrize("size", SIZES)
def test_what_was_sealed_is_read_again(size: int) -> None:
    assert read_all(seal(CONTENT[:size])) == CONTENT[:size]


@pytest.mark.parametrize("size", SIZES)
def test_both_sizes_follow_from_each_other(size: int) -> None:
    assert len(seal(CONTENT[:size])) == measure_sealed(size)
    assert measure_content(measure_sealed(size)) == size


def test_a_size_that_no_sealed_file_has_is_told() -> None:
    empty = measure_sealed(0)
    assert [measure_content(size) for size in (0, empty - 1, empty + 1, empty + 16)] == [-1, -1, -1, -1]


@pytest.mark.parametrize("size", SIZES)
def test_both_sizes_of_an_unfinished_file_follow_from_each_other(size: int) -> None:
    assert measure_grown(measure_growing(size)) == size


def test_a_file_is_sealed_alike_whatever_pieces_it_comes_in() -> None:
    fine, coarse = seal(CONTENT, 999), seal(CONTENT, len(CONTENT))
    assert len(fine) == len(coarse)
    assert read_all(fine) == read_all(coarse)


def test_the_same_content_is_never_sealed_to_the_same_bytes() -> None:
    assert seal(b"x" * 100)[HEAD_BYTES:] != seal(b"x" * 100)[HEAD_BYTES:]


def test_no_part_of_the_content_is_left_in_clear() -> None:
    canary = b"a canary of thirty-two bytes, so"
    assert canary not in seal(canary * 100)


@pytest.mark.parametrize(("first", "count"), [(0, 7), (PIECE_BYTES - 3, 6), (3 * PIECE_BYTES, 99), (5, 0)])
def test_any_part_can_be_read_alone(first: int, count: int) -> None:
    assert open_sealed(seal(CONTENT)).read(first, count) == CONTENT[first : first + count]


def test_a_part_is_read_although_another_piece_is_damaged() -> None:
    sealed = bytearray(seal(CONTENT))
    sealed[HEAD_BYTES + 5] ^= 1
    file = open_sealed(bytes(sealed))
    assert file.read(PIECE_BYTES, 10) == CONTENT[PIECE_BYTES : PIECE_BYTES + 10]
    with pytest.raises(BrokenSeal):
        file.read(0, 10)


def swap_pieces(sealed: bytes) -> bytes:
    first, second = HEAD_BYTES + SEALED_BYTES, HEAD_BYTES + 2 * SEALED_BYTES
    return sealed[:HEAD_BYTES] + sealed[first:second] + sealed[HEAD_BYTES:first] + sealed[second:]


def leave_out_a_piece(sealed: bytes) -> bytes:
    return sealed[: HEAD_BYTES + SEALED_BYTES] + sealed[HEAD_BYTES + 2 * SEALED_BYTES :]


def repeat_a_piece(sealed: bytes) -> bytes:
    return sealed[: HEAD_BYTES + SEALED_BYTES] + sealed[HEAD_BYTES:]


def cut_behind_a_piece(sealed: bytes) -> bytes:
    return sealed[: HEAD_BYTES + 2 * SEALED_BYTES]


def take_a_piece_of_another_file(sealed: bytes) -> bytes:
    other = seal(CONTENT)
    return (
        sealed[:HEAD_BYTES]
        + other[HEAD_BYTES : HEAD_BYTES + SEALED_BYTES]
        + sealed[HEAD_BYTES + SEALED_BYTES :]
    )


@pytest.mark.parametrize(
    "alter",
    [
        swap_pieces,
        leave_out_a_piece,
        repeat_a_piece,
        cut_behind_a_piece,
        take_a_piece_of_another_file,
        lambda sealed: sealed[:-1],
        lambda sealed: sealed + b"\0",
        lambda sealed: sealed[:HEAD_BYTES],
    ],
)
def test_pieces_cannot_be_exchanged_repeated_or_left_out(alter: object) -> None:
    altered = alter(seal(CONTENT))  # type: ignore[operator]
    with pytest.raises(BrokenSeal):
        read_all(altered)


@given(place=st.integers(16, measure_sealed(3000) - 1), bit=st.integers(0, 7))
@settings(max_examples=200, deadline=None)
def test_one_altered_bit_is_never_read(place: int, bit: int) -> None:
    sealed = bytearray(seal(CONTENT[:3000]))
    sealed[place] ^= 1 << bit
    id_place = range(48, HEAD_BYTES)
    if place in id_place:  # another key's name: whoever looks it up has another key
        assert read_head(bytes(sealed)) != read_head(seal(b""))
        return
    with pytest.raises(BrokenSeal):
        read_all(bytes(sealed))


def test_another_key_opens_nothing() -> None:
    with pytest.raises(BrokenSeal):
        open_sealed(seal(CONTENT), RecordingKey(KEY.id, bytes(32)))


def test_the_head_names_the_key() -> None:
    head = read_head(seal(b""))
    assert head is not None
    assert head.key_id == KEY.id


@pytest.mark.parametrize("plain", [b"", b"PK\x03\x04" + bytes(200), b"acromion.sealed\x01"])
def test_what_is_not_sealed_has_no_head(plain: bytes) -> None:
    assert read_head(plain) is None


@given(breaks=st.lists(st.integers(0, len(CONTENT)), max_size=6), lost=st.integers(0, 40))
@settings(max_examples=40, deadline=None)
def test_a_file_can_be_gone_on_with_at_any_byte(breaks: list[int], lost: int) -> None:
    """Bytes behind the place were written, and did not count."""
    file = io.BytesIO()
    Sealer(file.write, KEY)
    place = 0
    for end in [*sorted(breaks), len(CONTENT)]:
        head = read_head(file.getvalue())
        assert head is not None
        file.truncate(measure_growing(place))
        file.seek(measure_growing(place) - place % PIECE_BYTES)
        begun = file.read(place % PIECE_BYTES)
        file.seek(measure_growing(place))
        sealer = Sealer(file.write, KEY, head)
        sealer.go_on(place, begun)
        sealer.write(CONTENT[place:end])
        place = end
        if end < len(CONTENT):
            sealer.write(bytes(lost))
    sealer.close()
    assert read_all(file.getvalue()) == CONTENT


@pytest.mark.parametrize("size", [0, 5, PIECE_BYTES, 2 * PIECE_BYTES + 7])
def test_an_unfinished_file_can_be_read(size: int) -> None:
    file = io.BytesIO()
    sealer = Sealer(file.write, KEY)
    sealer.write(CONTENT)
    assert b"".join(read_growing(file, KEY, sealer.head, size)) == CONTENT[:size]


def test_closing_the_same_file_twice_gives_the_same_bytes() -> None:
    """Two servers may finish one upload at once."""
    sealed = seal(CONTENT)
    head = read_head(sealed)
    assert head is not None
    again = io.BytesIO()
    sealer = Sealer(again.write, KEY, head)
    sealer.write(CONTENT)
    sealer.close()
    assert head.encode() + again.getvalue() == sealed
