"""Axivity AX6 `.cwa`: accelerometer and gyroscope, in blocks that each have a stamp of the device's clock.

Source: Open Movement, Docs/ax3/cwa.h and ax3-technical.md. Compared to the readers that were looked at
(openmovement, actipy, scikit-digital-health): a block whose checksum fails is missing time, never samples and
never closed up with its neighbours; the true rate is measured; nothing is resampled.

The blocks come first, then their clock; :func:`read` follows.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.errors import (
    DamagedFile,
    NoGyroscope,
    NoSamples,
    UnknownColumns,
    UnknownRate,
    UnusableTime,
)
from acromion.fusion.numba_kernels import inner, kernel
from acromion.fusion.readers.samples import SampleColumns
from acromion.fusion.readers.source import EARLY_END_S, MAX_DAMAGED_PERCENT, Source, read_chunks, scan_pieces
from acromion.fusion.readers.time.clock import datetime_at_us, flag_drift, hash_serial, trust_clock
from acromion.fusion.readers.time.grid import (
    FASTEST_HZ,
    LONGEST_GAP_US,
    SLOWEST_HZ,
    FittedRun,
    Grid,
    Holes,
    flag_time,
    place_segments,
)
from acromion.fusion.recording import (
    LONGEST_BRIDGE_US,
    MICROSECONDS,
    QualityFlag,
    Recording,
    Stated,
    flag_counts,
    flag_gaps,
)

# The blocks, including those of a damaged file, and their samples.
#
# Layout (Open Movement, Docs/ax3/cwa.h): after a header of 1024 bytes, blocks of 512: "AX", the length 508, a
# head of 30 bytes in all, 480 bytes of samples, and a word that makes the 256 words of the block add up to
# zero. Sectors that are all ones or all zeros were never written.

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
def has_signature(buffer, at_byte):  # type: ignore[no-untyped-def]
    """Whether a block's first four bytes are at ``at_byte``; the caller makes sure that there is room."""
    return (
        buffer[at_byte] == 0x41
        and buffer[at_byte + 1] == 0x58
        and buffer[at_byte + 2] == 0xFC
        and buffer[at_byte + 3] == 0x01
    )


@kernel
def is_block(buffer, at_byte):  # type: ignore[no-untyped-def]
    """Whether a whole block with a correct checksum starts at ``at_byte``."""
    if at_byte + BLOCK_BYTES > len(buffer) or not has_signature(buffer, at_byte):
        return False
    total = np.int64(0)
    for k in range(at_byte, at_byte + BLOCK_BYTES, 2):
        total += buffer[k] + 256 * np.int64(buffer[k + 1])
    return total & 0xFFFF == 0


@inner
def is_unwritten(buffer, first_byte, stop_byte):  # type: ignore[no-untyped-def]
    """Whether the bytes are all ones or all zeros."""
    if buffer[first_byte] != 0x00 and buffer[first_byte] != 0xFF:
        return False
    for k in range(first_byte + 1, stop_byte):  # noqa: SIM110 (numba does not support generators)
        if buffer[k] != buffer[first_byte]:
            return False
    return True


@inner
def leads_on(buffer, at_byte):  # type: ignore[no-untyped-def]
    """Whether ``at_byte`` can follow a block: another block starts there, unwritten space, or the end."""
    if at_byte + BLOCK_BYTES > len(buffer):
        return True
    return has_signature(buffer, at_byte) or is_unwritten(buffer, at_byte, at_byte + BLOCK_BYTES)


@inner
def note_damage(tally, size_bytes):  # type: ignore[no-untyped-def]
    """Count damaged bytes, and where the damage is."""
    if tally[BAD_CHECKSUMS] + tally[RESYNCS] == 0:
        tally[FIRST_DAMAGE] = tally[GOOD]
    tally[LAST_DAMAGE] = tally[GOOD]
    tally[DAMAGED_BYTES] += size_bytes


@inner
def pass_sector(buffer, at_byte, tally):  # type: ignore[no-untyped-def]
    """Step over a sector that is not a block; return the next place to read.

    If the next sector can follow a block, only this block is lost. Otherwise the next valid block is searched
    for byte by byte.
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
def scan_blocks(buffer, is_last, starts, tally):  # type: ignore[no-untyped-def]
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
def take_samples(buffer, starts, layouts, scales, into):  # type: ignore[no-untyped-def]
    """Write the samples of blocks one after the other, acceleration and angular rate.

    ``layouts``: rows and axes of each block, shape (n, 2); ``scales``: g and deg/s of one count, (n, 2). A
    row is the gyroscope's three int16, the accelerometer's three, and what else there is, little-endian. Of
    an AX3 it is the accelerometer alone: three int16, or (0 axes) three numbers of 10 bits with an exponent.
    """
    acc, gyr = into
    row = 0
    for block in range(len(starts)):
        step = 2 * layouts[block, 1]
        if step < 12:
            for k in range(layouts[block, 0]):
                at = starts[block] + HEAD_BYTES + k * (step if step else 4)
                packed = np.int64(0)
                for place in range(4):
                    packed |= np.int64(buffer[at + place]) << (8 * place)
                for axis in range(3):
                    pull = np.int16(buffer[at + 2 * axis] | (buffer[at + 2 * axis + 1] << 8))
                    if step == 0:
                        low = (packed >> (10 * axis)) & 1023
                        pull = np.int16((low - 1024 if low > 511 else low) << (packed >> 30))
                    gyr[row, axis] = 0.0
                    acc[row, axis] = pull * scales[block, 0]
                row += 1
            continue
        for k in range(layouts[block, 0]):
            at = starts[block] + HEAD_BYTES + k * step
            for axis in range(3):
                turn = np.int16(buffer[at + 2 * axis] | (buffer[at + 2 * axis + 1] << 8))
                pull = np.int16(buffer[at + 6 + 2 * axis] | (buffer[at + 7 + 2 * axis] << 8))
                gyr[row, axis] = turn * scales[block, 1]
                acc[row, axis] = pull * scales[block, 0]
            row += 1


# The clock: one stamp for each block, from which segments, holes and the true rate follow.
#
# The sensor samples by a separate clock; each block gives the reading of the device's clock at one of its
# rows, to 1/32768 s. The stamps of successive blocks show whether time is missing between them, within their
# own scatter: the limit is half a sample period (a step longer than 1.5 periods is a hole), or eight times
# the scatter of the stamps where that is more and no block's number is missing. Where the row that a stamp
# belongs to moves by one, the limit is a period more: that row is rounded (40 to 41 in a real AX6, whose
# stamps go on 0.4065 s apart).

# The order of the blocks: one session, each block once, by their numbers where some came late.

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Decoded blocks, one entry each.

    ``first_row``, ``n_rows``: where the samples are in the columns; ``session``, ``sequence``: the block's
    numbers; ``rate_code``: of the nominal rate; ``anchor_us``: the device's clock, microseconds since 1970,
    at the row ``anchor_row`` counted from the block's first, which may lie outside it; -1: no stamp.
    """

    first_row: Indices
    n_rows: Indices
    session: Indices
    sequence: Indices
    rate_code: Indices
    anchor_us: Indices
    anchor_row: Indices

    def __len__(self) -> int:
        return len(self.first_row)

    def take(self, chosen: NDArray[np.bool_] | Indices) -> "Blocks":
        """Return some of the blocks, or all in another order."""
        return Blocks(*(getattr(self, name)[chosen] for name in self.__slots__))


def order_blocks(
    blocks: Blocks, columns: SampleColumns, session: int
) -> tuple[Blocks, tuple[QualityFlag, ...]]:
    """Drop other sessions and duplicates, and sort late blocks; the columns are reordered alike.

    ``session``: the session in the header.
    """
    is_own = find_session(blocks, session)
    own = blocks.take(is_own)
    order, late = find_order(own)
    ordered = own.take(order)
    is_double = find_doubles(ordered)
    identical = count_identical(ordered, columns, np.flatnonzero(is_double))
    kept = ordered.take(~is_double)
    other_rows = int(blocks.n_rows[~is_own].sum())
    counts = {
        Caveat.SESSION: int(np.count_nonzero(~is_own)),
        Caveat.ORDER: late,
        Caveat.DUP: identical,
        Caveat.DUP_CONFLICT: int(np.count_nonzero(is_double)) - identical,
    }
    facts = {Caveat.SESSION: {"n": other_rows}}
    flags = tuple(
        QualityFlag(code, count, facts=facts.get(code, {})) for code, count in counts.items() if count
    )
    if not flags:
        return kept, flags
    columns.arrange(find_rows(kept))
    return replace(kept, first_row=np.cumsum(kept.n_rows) - kept.n_rows), flags


def find_session(blocks: Blocks, named: int) -> NDArray[np.bool_]:
    """Mark the blocks of one session: the named one if it has blocks, else the one with most blocks.

    A device's file is emptied when it is set up again: a block with another number is left over from an
    earlier recording, perhaps another person's. Blocks without a number (0) are kept.
    """
    numbers, counts = np.unique(blocks.session[blocks.session != 0], return_counts=True)
    if len(numbers) < 2:
        return np.ones(len(blocks), np.bool_)
    own = named if named in numbers else int(numbers[np.argmax(counts)])
    is_own: NDArray[np.bool_] = (blocks.session == own) | (blocks.session == 0)
    return is_own


def find_order(blocks: Blocks) -> tuple[Indices, int]:
    """Return the order of the blocks and how many were late, by number and clock.

    If the number steps back while the clock advances, the device restarted and no block was late.
    """
    order = np.arange(len(blocks))
    back = np.diff(blocks.sequence) <= 0
    on = np.diff(blocks.anchor_us) > 0
    if not np.any(back & ~on):
        return order, 0
    starts = np.concatenate([[0], np.flatnonzero(back & on) + 1, [len(blocks)]])
    late = 0
    for part in np.unique(np.searchsorted(starts, np.flatnonzero(back & ~on), "right")).tolist():
        inside = slice(int(starts[part - 1]), int(starts[part]))
        sequence = blocks.sequence[inside]
        places = np.argsort(sequence, kind="stable")
        anchors = blocks.anchor_us[inside][places]
        if np.all(np.diff(anchors[anchors >= 0]) >= 0):
            late += int(np.count_nonzero(sequence < np.maximum.accumulate(sequence)))
            order[inside] = places + inside.start
    return order, late


def find_doubles(blocks: Blocks) -> NDArray[np.bool_]:
    """Mark blocks with the numbers and the stamp of the one before."""
    is_double = np.zeros(len(blocks), np.bool_)
    names = (blocks.session, blocks.sequence, blocks.anchor_us)
    is_double[1:] = np.logical_and.reduce([np.diff(values) == 0 for values in names])
    return is_double


def count_identical(blocks: Blocks, columns: SampleColumns, doubles: Indices) -> int:
    """Return how many of the duplicates have the content of the block before."""
    alike = doubles[blocks.n_rows[doubles] == blocks.n_rows[doubles - 1]]
    if len(alike) == 0:
        return 0
    here, before = (find_rows(blocks.take(alike - shift)) for shift in (0, 1))
    is_same = np.all(columns.acc[here] == columns.acc[before], axis=1)
    is_same &= np.all(columns.gyr[here] == columns.gyr[before], axis=1)
    edges = np.cumsum(blocks.n_rows[alike]) - blocks.n_rows[alike]
    return int(np.count_nonzero(np.logical_and.reduceat(is_same, edges)))


def find_rows(blocks: Blocks) -> Indices:
    """Return the rows of the blocks, in their order."""
    stops = np.cumsum(blocks.n_rows)
    shifts = np.repeat(blocks.first_row - (stops - blocks.n_rows), blocks.n_rows)
    rows: Indices = np.arange(len(shifts)) + shifts
    return rows


HIGHEST_RATE_HZ, HIGHEST_CODE = 3200.0, 15
WIDEST_RATE_ERROR = 0.1
"""The sensor is made to keep its rate within a few percent."""
SURE_SCATTERS = 8.0
NORMAL_PER_MEDIAN = 1.4826
"""The standard deviation of a normal scatter for its median absolute deviation."""
LONGEST_ALONE_US = 86_400 * MICROSECONDS
"""A single first or last block, so far from the others, has a wrong stamp."""
LATE_BLOCKS = 8
"""How far to look for stamps that take a step back: until then the stamps between are not believed."""
FITTED_BLOCKS = 8
"""A shorter run takes the period of the whole recording: its own would be too uncertain."""
END_BLOCKS = 25
Floats = NDArray[np.float64]


def nominal_hz(rate_code: NDArray[np.int64]) -> Floats:
    """Return the rate that the sensor was set to (Open Movement, cwa.h)."""
    return np.asarray(HIGHEST_RATE_HZ / 2.0 ** (HIGHEST_CODE - (rate_code & HIGHEST_CODE)), np.float64)


def cut_blocks(blocks: Blocks, columns: SampleColumns) -> tuple[Grid, int | None]:
    """Cut ordered blocks into segments; ``columns`` hold their rows one after the other.

    Also gives the device's clock at the first row, microseconds since 1970; None if no block has a stamp.

    Raises UnusableTime or UnknownRate: the stamps give no even sampling at a usable rate.
    """
    period_us = measure_periods(blocks)
    lengths_us = blocks.n_rows * period_us
    starts_us = place_starts(blocks, period_us)
    jitter_us, limits_us = find_limits(blocks, starts_us, period_us)
    n_unstamped = int(np.count_nonzero(blocks.anchor_us < 0)) % len(blocks)  # if none has a stamp, 0
    mended = mend_starts(starts_us, lengths_us, limits_us) + n_unstamped
    holes = find_holes(blocks, starts_us, period_us, limits_us)
    runs = fit_runs(blocks, holes, starts_us, period_us)
    segments = place_segments(columns, holes, runs)
    usual_us = float(np.median(period_us))
    duration_us = segments[-1].end_us
    flags = flag_time(holes, mended, jitter_us / usual_us) + flag_gaps(segments, duration_us)
    grid = Grid(segments, duration_us, flags, usual_us, jitter_us)
    return grid, round(starts_us[0]) if np.any(blocks.anchor_us >= 0) else None


def measure_periods(blocks: Blocks) -> Floats:
    """The sample period of each block, microseconds: for each nominal rate the median over its blocks.

    Raises
    ------
    UnusableTime
        The stamps do not fit the nominal rate.
    UnknownRate
        A rate is outside the range that shows arm movement.
    """
    at_row = np.cumsum(blocks.n_rows) - blocks.n_rows + blocks.anchor_row
    rows, steps_us = np.diff(at_row), np.diff(blocks.anchor_us).astype(np.float64)
    follows = (np.diff(blocks.sequence) == 1) & (np.diff(blocks.session) == 0) & (rows > 0)
    follows &= (np.diff(blocks.rate_code) == 0) & (blocks.anchor_us[1:] >= 0) & (blocks.anchor_us[:-1] >= 0)
    period_us = MICROSECONDS / nominal_hz(blocks.rate_code)
    for code in np.unique(blocks.rate_code):
        chosen = follows & (blocks.rate_code[1:] == code)
        measured_us = float(np.median(steps_us[chosen] / rows[chosen])) if chosen.any() else 0.0
        if measured_us != 0.0:
            period_us[blocks.rate_code == code] = measured_us
    if np.any(np.abs(period_us * nominal_hz(blocks.rate_code) / MICROSECONDS - 1.0) > WIDEST_RATE_ERROR):
        raise UnusableTime(why="irregular")
    rates_hz = MICROSECONDS / period_us
    is_usable = (rates_hz >= SLOWEST_HZ) & (rates_hz <= FASTEST_HZ)
    if not is_usable.all():
        raise UnknownRate(m=round(float(rates_hz[np.argmin(is_usable)]), 4))
    return period_us


def place_starts(blocks: Blocks, period_us: Floats) -> Floats:
    """Return the time of each block's first row, us; for a block without a stamp, from its number."""
    missed = np.clip(np.diff(blocks.sequence, prepend=blocks.sequence[0] - 1) - 1, 0, None)
    missed = np.where(missed * blocks.n_rows * period_us > LONGEST_GAP_US, 0, missed)
    rows_us = blocks.n_rows * period_us
    counted_us = np.cumsum((missed + 1) * rows_us) - rows_us
    known = np.flatnonzero(blocks.anchor_us >= 0)
    if len(known) == 0:
        return counted_us
    starts_us = blocks.anchor_us - blocks.anchor_row * period_us
    before = known[np.maximum(np.searchsorted(known, np.arange(len(blocks)), "right") - 1, 0)]
    return np.where(blocks.anchor_us >= 0, starts_us, starts_us[before] + counted_us - counted_us[before])


def find_lags(starts_us: Floats, lengths_us: Floats) -> Floats:
    """Return how much later each block begins than the one before ends."""
    return starts_us[1:] - (starts_us[:-1] + lengths_us[:-1])


def find_limits(blocks: Blocks, starts_us: Floats, period_us: Floats) -> tuple[float, Floats]:
    """Return the scatter of the stamps, and the lag that means missing time, for each block but the first.

    If the numbers show a missing block, half a period is enough.
    """
    lags_us = find_lags(starts_us, blocks.n_rows * period_us)
    if len(lags_us) == 0:
        return 0.0, lags_us
    middle_us = np.median(lags_us)
    scatter_us = NORMAL_PER_MEDIAN * float(np.median(np.abs(lags_us - middle_us)))
    is_skipped = np.diff(blocks.sequence) > 1
    sure_us = np.where(is_skipped, 0.0, SURE_SCATTERS * scatter_us)
    has_moved = np.abs(np.diff(blocks.anchor_row)) == 1
    least_us = np.where(has_moved, 1.5, 0.5) * period_us[1:]
    return scatter_us / np.sqrt(2.0), np.maximum(least_us, sure_us)


def mend_starts(starts_us: Floats, lengths_us: Floats, limits_us: Floats) -> int:
    """Correct stamps that contradict their neighbours, in place; return how many.

    Raises UnusableTime if one block in ten would have a wrong stamp or a hole before it.
    """
    lags_us = find_lags(starts_us, lengths_us)
    places = np.flatnonzero(np.abs(lags_us) > limits_us)
    if len(places) > len(starts_us) // 10 + 100:
        raise UnusableTime(why="irregular")
    mended = done = 0
    for place in places.tolist():
        taken_back = np.cumsum(lags_us[place : place + LATE_BLOCKS + 1])
        (ends,) = np.nonzero(np.abs(taken_back[1:]) <= limits_us[place])
        if place < done or len(ends) == 0:
            continue
        stop = place + 1 + int(ends[0]) + 1
        starts_us[place + 1 : stop] = starts_us[place] + np.cumsum(lengths_us[place : stop - 1])
        mended += stop - place - 1
        done = stop
    if len(starts_us) < 3:
        return mended
    # a first or last stamp that lies over a day from all others
    is_far = np.abs(find_lags(starts_us, lengths_us)) > LONGEST_ALONE_US
    if is_far[0] and not is_far[1]:
        starts_us[0] = starts_us[1] - lengths_us[0]
    if is_far[-1] and not is_far[-2]:
        starts_us[-1] = starts_us[-2] + lengths_us[-2]
    return mended + int(is_far[0] and not is_far[1]) + int(is_far[-1] and not is_far[-2])


def find_holes(blocks: Blocks, starts_us: Floats, period_us: Floats, limits_us: Floats) -> Holes:
    """Find the places with missing rows, a clock that was set or a changed rate."""
    lags_us = find_lags(starts_us, blocks.n_rows * period_us)
    steps_us = lags_us + period_us[:-1]
    is_other_rate = np.diff(period_us) != 0.0
    is_hole = (lags_us > limits_us) | ((lags_us < -limits_us) & (steps_us <= 0.0)) | is_other_rate
    before = np.flatnonzero(is_hole)
    step_us = np.rint(steps_us[before]).astype(np.int64)
    added = np.maximum(1, np.rint(steps_us[before] / period_us[before]).astype(np.int64) - 1)
    is_bridge = (step_us > 0) & (step_us <= LONGEST_BRIDGE_US) & ~is_other_rate[before]
    return Holes(blocks.first_row[before + 1], step_us, np.where(is_bridge, added, 0))


def fit_runs(blocks: Blocks, holes: Holes, starts_us: Floats, period_us: Floats) -> list[FittedRun]:
    """Fit a line to the stamps of each unbroken run."""
    is_cut = holes.added == 0
    row_edges = [0, *holes.row[is_cut].tolist(), int(blocks.n_rows.sum())]
    edges = [*np.searchsorted(blocks.first_row, row_edges[:-1]).tolist(), len(blocks)]
    is_set = [False, *holes.is_set[is_cut].tolist()]
    runs = []
    for number, was_set in enumerate(is_set):
        first, stop = edges[number], edges[number + 1]
        first_row, stop_row = row_edges[number], row_edges[number + 1]
        inside = holes.take(first_row, stop_row)
        rows = blocks.first_row[first:stop] - first_row
        put_in = np.concatenate([[0], np.cumsum(inside.added)])
        places = (rows + put_in[np.searchsorted(inside.row, rows, "right")]).astype(np.float64)
        offset_us, fitted_us = fit_ends(starts_us[first:stop], places, float(period_us[first]))
        first_us = round(starts_us[first])
        runs.append(FittedRun(first_row, stop_row, first_us, offset_us, fitted_us, 0.0, was_set))
    return runs


def fit_ends(starts_us: Floats, places: Floats, period_us: float) -> tuple[float, float]:
    """Fit a line from a run's first stamps to its last; return the offset of its first row and its period.

    Least squares would not do: over hours the sensor's clock drifts with its temperature, so a line through
    the middle would miss the ends, and the ends give the duration.
    """
    off_us = starts_us - starts_us[0] - places * period_us
    n = min(END_BLOCKS, len(places) // 4)
    if len(places) < FITTED_BLOCKS:
        return float(np.median(off_us)), period_us
    early, late = slice(0, n), slice(len(places) - n, None)
    rise_us = float(np.median(off_us[late]) - np.median(off_us[early]))
    tilt = rise_us / float(np.mean(places[late]) - np.mean(places[early]))
    return float(np.median(off_us[early]) - tilt * np.mean(places[early])), period_us + tilt


# The header of a `.cwa`: the device, and its planned end. Names of people in it are not read.

HEADER_BYTES = 1024
MAGIC = b"MD\xfc\x03"
AX6 = 0x64
_FIELDS = struct.Struct("<4xBHIHII")  # hardware, device id, session, upper half of the id, start, stop
_UNSET = 0xFFFF
FIRST_YEAR = 2000


@dataclass(frozen=True, slots=True)
class DeviceHeader:
    """The facts of the header, if it is not lost. ``planned_end_s``: Unix seconds, None for no plan."""

    is_ax6: bool = False
    device_id: int = 0
    session: int = 0
    planned_end_s: int | None = None

    @property
    def serial_hash(self) -> str | None:
        """SHA-256 of the device's number, first 12 hexadecimal digits."""
        return hash_serial(str(self.device_id)) if self.device_id else None


def parse_header(head: bytes) -> DeviceHeader:
    """Read the header at the beginning of a file."""
    if not head.startswith(MAGIC) or len(head) < HEADER_BYTES:
        return DeviceHeader()
    hardware, lower, session, upper, _, stop = _FIELDS.unpack_from(head)
    device_id = lower | (0 if upper == _UNSET else upper << 16)
    planned_s = int(unpack_stamps(np.array([stop], np.uint32))[0])
    return DeviceHeader(hardware == AX6, device_id, session, planned_s if planned_s >= 0 else None)


def unpack_stamps(packed: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Unix seconds of the device's own clock from its packed dates; -1 if they are not dates.

    From the highest bit: six of years since 2000, four of the month, five of the day, five of the hour, six
    of the minute, six of the second.
    """
    fields = [(packed >> shift) & ((1 << bits) - 1) for shift, bits in _STAMP_FIELDS]
    years, months, days, hours, minutes, seconds = (field.astype(np.int64) for field in fields)
    month = ((years + FIRST_YEAR - 1970) * 12 + months - 1).astype("datetime64[M]")
    date = month.astype("datetime64[D]") + (days - 1)
    is_date = (months >= 1) & (months <= 12) & (days >= 1) & (date.astype("datetime64[M]") == month)
    is_time = (hours < 24) & (minutes < 60) & (seconds < 60)
    unix_s = date.astype(np.int64) * 86_400 + hours * 3600 + minutes * 60 + seconds
    return np.where(is_date & is_time, unix_s, -1)


_STAMP_FIELDS = ((26, 6), (22, 4), (17, 5), (12, 5), (6, 6), (0, 6))


INERTIAL_AXES = (6, 9)
"""Gyroscope and accelerometer; the same and a magnetometer."""
PLAIN_AXES = 3
WORDS = 2
"""The packing of samples in words of 16 bits."""
HAS_FRACTION, FRACTION_BITS = 0x8000, 0x7FFF
FULL_COUNT = 32_768.0
WIDEST_G = 16.0
USUAL_RANGE_CODE = 2
"""2000 deg/s, where a block does not tell the gyroscope's range."""


def recognise(source: Source) -> bool:
    """Whether the file begins with the header of a `.cwa`, or has a sound block where the first one lies."""
    return is_cwa(source.head)


def is_cwa(head: bytes) -> bool:
    """As :func:`recognise`, by the first bytes."""
    first = np.frombuffer(head[: HEADER_BYTES + BLOCK_BYTES], np.uint8)
    return head.startswith(MAGIC) or is_block(first, HEADER_BYTES)


def read(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (the blocks tell it)
    """Read accelerometer and gyroscope of an AX6.

    Raises
    ------
    acromion.fusion.errors.UnreadableFile
        The gyroscope was off (or it is an AX3), or more than 5 % of the file is damaged.
    NoSamples, acromion.fusion.errors.UnusableTime, acromion.fusion.errors.UnknownRate
    """
    log = decode_log(read_chunks(source, HEADER_BYTES), source.size_bytes, source)
    log.refuse_unusable()
    return build_recording(parse_header(source.head), log)


@dataclass(slots=True)
class BlockLog:
    """The content of the blocks, gathered piece by piece; ``heads`` of those with samples, shape (n,)."""

    columns: SampleColumns = field(default_factory=lambda: SampleColumns(has_stamps=False))
    tally: NDArray[np.int64] = field(default_factory=lambda: np.zeros(TALLY_PLACES, np.int64))
    parts: list[NDArray[np.void]] = field(default_factory=list)
    n_bytes: int = 0
    n_plain: int = 0
    n_unknown: int = 0

    @property
    def heads(self) -> NDArray[np.void]:
        """The heads of all blocks that were decoded, in the order of the file."""
        return np.concatenate(self.parts) if self.parts else np.empty(0, BLOCK_HEAD)

    def refuse_unusable(self) -> None:
        """Raise if no sample can be trusted."""
        damaged_percent = 100.0 * float(self.tally[DAMAGED_BYTES]) / max(1, self.n_bytes)
        if damaged_percent > MAX_DAMAGED_PERCENT:
            before = unpack_stamps(self.heads["stamp"][: int(self.tally[FIRST_DAMAGE])])
            clock = datetime_at_us(int(before[-1]) * MICROSECONDS) if len(before) else None
            known = {} if clock is None else {"clock": clock.strftime("%Y-%m-%d %H:%M:%S")}
            raise DamagedFile(p=round(damaged_percent, 1), **known)
        if self.columns.rows:
            return
        if self.n_plain:
            raise NoGyroscope(cure="AX6")
        if self.n_unknown:
            raise UnknownColumns(list="CWA")
        raise NoSamples


def decode_log(pieces: Iterable[bytes], size_bytes: int = 0, source: Source | None = None) -> BlockLog:
    """Find and decode the blocks in one pass over what follows the header.

    ``pieces``: the bytes after the header.
    ``size_bytes``: size of the file, to estimate the room for the samples.
    ``source``: source of the pieces, to refuse too many rows.
    """
    log = BlockLog(SampleColumns(source, has_stamps=False))
    to_come = size_bytes

    def scan(buffer: NDArray[np.uint8], is_last: bool) -> tuple[int, NDArray[np.int64]]:  # noqa: FBT001
        starts = np.empty(len(buffer) // BLOCK_BYTES + 1, np.int64)
        used, found = scan_blocks(buffer, is_last, starts, log.tally)
        log.n_bytes += len(buffer) if is_last else used
        return used, starts[:found]

    for buffer, starts in scan_pieces(pieces, scan):
        rows_of_bytes = buffer[starts[:, np.newaxis] + np.arange(HEAD_BYTES)]
        heads = np.ascontiguousarray(rows_of_bytes).reshape(-1).view(BLOCK_HEAD)
        axes, rows = (heads["axes"] >> 4).astype(np.int64), heads["count"].astype(np.int64)
        is_packed = heads["axes"] & 0xF != WORDS
        is_inertial = np.isin(axes, INERTIAL_AXES) & ~is_packed
        row_bytes = np.where(is_packed, 4, 2 * axes)
        if source is not None and source.is_thigh:
            is_inertial = axes == PLAIN_AXES
        fits = is_inertial & (rows > 0) & (rows * row_bytes <= SAMPLE_BYTES)
        log.n_plain += int(np.count_nonzero(axes == PLAIN_AXES))
        log.n_unknown += int(np.count_nonzero(~fits & (rows > 0) & (axes != PLAIN_AXES)))
        columns = log.columns
        room = columns.extend(int(rows[fits].sum()))
        layouts = np.stack([rows[fits], np.where(is_packed, 0, axes)[fits]], axis=1)
        scales = np.stack(find_ranges(heads[fits]), axis=1) / np.float32(FULL_COUNT)
        take_samples(buffer, starts[fits], layouts, scales, (columns.acc[room], columns.gyr[room]))
        log.parts.append(heads[fits])
        if columns.rows and to_come:
            columns.reserve(len(buffer), to_come)
            to_come = 0
    log.columns.trim()
    return log


def find_ranges(heads: NDArray[np.void]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Full scale of each block (32,768 counts), g and deg/s.

    The upper three bits n beside the light sensor's: 2^(8 + n) counts are 1 g; the next three: 8000/2^n deg/s
    are the full scale.
    """
    acc_code, gyr_code = heads["scales"] >> 13, (heads["scales"] >> 10) & 7
    gyr_code = np.where(gyr_code == 0, USUAL_RANGE_CODE, gyr_code)
    acc_range_g = (FULL_COUNT / 2.0 ** (8.0 + acc_code)).astype(np.float32)
    return acc_range_g, (8000.0 / 2.0**gyr_code).astype(np.float32)


def build_blocks(heads: NDArray[np.void]) -> Blocks:
    """Return the numbers of decoded blocks, and the row to which each stamp belongs.

    The format got fractions of a second later. For older readers, the device moves the row to the place of
    the whole second at the nominal rate; this function undoes that.
    """
    rate_code = (heads["rate"] & 0xF).astype(np.int64)
    has_fraction = heads["fraction"] & HAS_FRACTION != 0
    fraction = np.where(has_fraction, heads["fraction"] & FRACTION_BITS, 0).astype(np.int64)
    moved = (2 * fraction * nominal_hz(rate_code).astype(np.int64)) >> 16
    stamp_s = unpack_stamps(heads["stamp"])
    anchor_us = stamp_s * MICROSECONDS + fraction * MICROSECONDS // HAS_FRACTION
    rows = heads["count"].astype(np.int64)
    return Blocks(
        first_row=np.cumsum(rows) - rows,
        n_rows=rows,
        session=heads["session"].astype(np.int64),
        sequence=heads["sequence"].astype(np.int64),
        rate_code=rate_code,
        anchor_us=np.where(stamp_s >= 0, anchor_us, -1),
        anchor_row=heads["offset"].astype(np.int64) + moved,
    )


def build_recording(header: DeviceHeader, log: BlockLog) -> Recording:
    """Put segments and caveats together."""
    heads = log.heads
    laid = build_blocks(heads)
    blocks, mended = order_blocks(laid, log.columns, header.session)
    grid, started_us = cut_blocks(blocks, log.columns)
    start, unset = trust_clock(None if started_us is None else datetime_at_us(started_us))
    if started_us is None:  # the time rests on the header's rate alone
        rate_hz = round(MICROSECONDS / grid.period_us, 3)
        rate = QualityFlag(Caveat.RATE, facts={"rate_hz": rate_hz, "rate_from": "header"})
        unset = (QualityFlag(Caveat.CLOCK_UNSET), rate)
    acc_ranges_g, gyr_ranges_dps = find_ranges(heads)
    rates_hz: list[float] = np.unique(nominal_hz(blocks.rate_code)).tolist()
    nominal_rate_hz = rates_hz[0] if len(rates_hz) == 1 else None
    return Recording(
        device="ax6" if header.is_ax6 or not header.device_id else "other",
        sha256="",
        start=start,
        time_zone=None,
        duration_us=grid.duration_us,
        segments=grid.segments,
        flags=(
            *flag_damage(log, laid, grid),
            *mended,
            *flag_plan(header, blocks, grid, started_us),
            *unset,
            *grid.flags,
        ),
        understood={
            "layout": "Axivity AX6 .cwa",
            "columns": "gyroscope, accelerometer",
            "units": "g, deg/s",
            "units_from": "header",
            "nominal_rate_hz": "" if nominal_rate_hz is None else f"{nominal_rate_hz:g}",
            "jitter_us": f"{grid.jitter_us:.1f}",
            "samples": str(int(blocks.n_rows.sum())),
            "records": str(len(blocks)),
            "clock": "local",
        },
        stated=Stated(is_known=True, units_from="header", nominal_rate_hz=nominal_rate_hz),
        jitter_us=float(grid.jitter_us),
        serial_hash=header.serial_hash,
        acc_range_g=min(WIDEST_G, float(acc_ranges_g.min())),
        gyr_range_dps=float(gyr_ranges_dps.min()),
    )


def flag_damage(log: BlockLog, blocks: Blocks, grid: Grid) -> tuple[QualityFlag, ...]:
    """Blocks that do not verify, with the place of the first and the last, and a tail that is cut off."""
    end_s = grid.duration_us / MICROSECONDS
    places = [int(log.tally[place]) - 1 for place in (FIRST_DAMAGE, LAST_DAMAGE)]
    stamps_us = blocks.anchor_us[np.clip(places, 0, len(blocks) - 1)] - blocks.anchor_us[0]
    first_s, last_s = np.clip(stamps_us / MICROSECONDS, 0.0, end_s).tolist()
    counts = {
        Caveat.CHECKSUM: int(log.tally[BAD_CHECKSUMS]),
        Caveat.RESYNC: int(log.tally[RESYNCS]),
        Caveat.ROWS_DROPPED: log.n_plain + log.n_unknown,
    }
    flags = flag_counts(counts, first_s, last_s)
    tail_bytes = int(log.tally[TAIL_BYTES])
    if tail_bytes:
        flags += (QualityFlag(Caveat.TRUNC_TAIL, 1, 0.0, end_s, end_s, {"n": tail_bytes}),)
    return flags


def flag_plan(
    header: DeviceHeader, blocks: Blocks, grid: Grid, started_us: int | None
) -> tuple[QualityFlag, ...]:
    """Flag a recording that ends before its planned end, or has another rate than the one set."""
    flags: tuple[QualityFlag, ...] = ()
    if header.planned_end_s is not None and started_us is not None:
        early_s = header.planned_end_s - (started_us + grid.duration_us) / MICROSECONDS
        flags += (QualityFlag(Caveat.EARLY_END),) if early_s > EARLY_END_S else ()
    rate_hz = max(grid.segments, key=len).rate_hz
    rates_hz: list[float] = nominal_hz(np.unique(blocks.rate_code)).tolist()
    set_hz = min(rates_hz, key=lambda one_hz: abs(one_hz - rate_hz))
    return flags + flag_drift(set_hz, rate_hz)
