"""Finding the blocks of a `.cwa` and taking their samples out, also where the file is damaged.

Layout (Open Movement, Docs/ax3/cwa.h): after a header of 1024 bytes, blocks of 512: "AX", the length 508, a
head of 30 bytes in all, 480 bytes of samples, and a word that makes the 256 words of the block add up to
zero. Sectors that are all ones or all zeros were never written.
"""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import inner, kernel

BLOCK_BYTES = 512
HEAD_BYTES = 30
SAMPLE_BYTES = 480
BLOCK_HEAD = np.dtype(
    [
        ("signature", "S4"),
        ("fraction", "<u2"),
        ("session", "<u4"),
        ("sequence", "<u4"),
        ("stamp", "<u4"),
        ("scales", "<u2"),
        ("temperature", "<u2"),
        ("events", "u1"),
        ("battery", "u1"),
        ("rate", "u1"),
        ("axes", "u1"),
        ("offset", "<i2"),
        ("count", "<u2"),
    ]
)

GOOD, BAD_CHECKSUMS, RESYNCS, DAMAGED_BYTES, HUNTED_BYTES, TAIL_BYTES, FIRST_DAMAGE, LAST_DAMAGE = range(8)
"""Places in the tally: blocks that verify; sectors that begin as a block and do not; times the framing was
lost; bytes of both; how long the scan has been hunting (0: it is not); bytes of a last block that was cut
off; good blocks before the first and before the last damage."""
TALLY_PLACES = 8


@inner
def has_signature(buffer: NDArray[np.uint8], at_byte: int) -> bool:
    """Whether a block's four first bytes lie at ``at_byte``; the caller makes sure that there is room."""
    return (
        buffer[at_byte] == 0x41
        and buffer[at_byte + 1] == 0x58
        and buffer[at_byte + 2] == 0xFC
        and buffer[at_byte + 3] == 0x01
    )


@kernel
def is_block(buffer: NDArray[np.uint8], at_byte: int) -> bool:
    """Whether a whole block with a true checksum lies at ``at_byte``."""
    if at_byte + BLOCK_BYTES > len(buffer) or not has_signature(buffer, at_byte):
        return False
    total = np.int64(0)
    for k in range(at_byte, at_byte + BLOCK_BYTES, 2):
        total += buffer[k] + 256 * np.int64(buffer[k + 1])
    return total & 0xFFFF == 0


@inner
def is_unwritten(buffer: NDArray[np.uint8], first_byte: int, stop_byte: int) -> bool:
    """Whether the bytes are all ones or all zeros."""
    if buffer[first_byte] != 0x00 and buffer[first_byte] != 0xFF:
        return False
    for k in range(first_byte + 1, stop_byte):  # noqa: SIM110 (numba knows no generators)
        if buffer[k] != buffer[first_byte]:
            return False
    return True


@inner
def leads_on(buffer: NDArray[np.uint8], at_byte: int) -> bool:
    """Whether what lies at ``at_byte`` can follow a block: another one, never written room, or the end."""
    if at_byte + BLOCK_BYTES > len(buffer):
        return True
    return has_signature(buffer, at_byte) or is_unwritten(buffer, at_byte, at_byte + BLOCK_BYTES)


@inner
def note_damage(tally: NDArray[np.int64], size_bytes: int) -> None:
    """Count damaged bytes, and where the damage is."""
    if tally[BAD_CHECKSUMS] + tally[RESYNCS] == 0:
        tally[FIRST_DAMAGE] = tally[GOOD]
    tally[LAST_DAMAGE] = tally[GOOD]
    tally[DAMAGED_BYTES] += size_bytes


@inner
def pass_sector(buffer: NDArray[np.uint8], at_byte: int, tally: NDArray[np.int64]) -> int:
    """Step over a sector that is no block; return where to go on.

    Where the next sector can follow, the framing is trusted and this block alone is lost; else the next
    block that verifies is hunted byte by byte.
    """
    if tally[HUNTED_BYTES] == 0 and is_unwritten(buffer, at_byte, at_byte + BLOCK_BYTES):
        return at_byte + BLOCK_BYTES
    if tally[HUNTED_BYTES] == 0 and leads_on(buffer, at_byte + BLOCK_BYTES):
        note_damage(tally, BLOCK_BYTES)
        tally[BAD_CHECKSUMS] += 1
        return at_byte + BLOCK_BYTES
    note_damage(tally, 1)
    if tally[HUNTED_BYTES] == 0:
        tally[RESYNCS] += 1
    tally[HUNTED_BYTES] += 1
    return at_byte + 1


@kernel
def scan_blocks(
    buffer: NDArray[np.uint8],
    is_last: bool,  # noqa: FBT001 (numba kernels take their arguments by place)
    starts: NDArray[np.int64],
    tally: NDArray[np.int64],
) -> tuple[int, int]:
    """Write where the blocks of a piece begin; return (bytes used, blocks found). Linear in the bytes."""
    ahead = BLOCK_BYTES if is_last else 2 * BLOCK_BYTES
    at = 0
    found = 0
    while at + ahead <= len(buffer):
        if is_block(buffer, at):
            starts[found] = at
            found += 1
            tally[GOOD] += 1
            tally[HUNTED_BYTES] = 0
            at += BLOCK_BYTES
        else:
            at = pass_sector(buffer, at, tally)
    if is_last and at < len(buffer) and not is_unwritten(buffer, at, len(buffer)):
        tally[TAIL_BYTES] = len(buffer) - at
    return at, found


@kernel
def take_samples(
    buffer: NDArray[np.uint8],
    starts: NDArray[np.int64],
    layouts: NDArray[np.int64],
    scales: NDArray[np.float32],
    into: tuple[NDArray[np.float32], NDArray[np.float32]],
) -> None:
    """Write the samples of blocks one after the other, acceleration and angular rate.

    ``layouts``: rows and axes of each block, shape (n, 2); ``scales``: g and deg/s of one count, (n, 2). A
    row is the gyroscope's three int16, the accelerometer's three, and what else there is, little-endian.
    """
    acc, gyr = into
    row = 0
    for block in range(len(starts)):
        step = 2 * layouts[block, 1]
        for k in range(layouts[block, 0]):
            at = starts[block] + HEAD_BYTES + k * step
            for axis in range(3):
                turn = np.int16(buffer[at + 2 * axis] | (buffer[at + 2 * axis + 1] << 8))
                pull = np.int16(buffer[at + 6 + 2 * axis] | (buffer[at + 7 + 2 * axis] << 8))
                gyr[row, axis] = turn * scales[block, 1]
                acc[row, axis] = pull * scales[block, 0]
            row += 1
