"""Write a simulated day in the devices' file formats, with its truth, in one pass and bounded memory.

The `.gt3x` of a GT9X Link, ActiLife's "-IMU.csv" of it, the CSV of a logger with an LSM9DS1; and the exact
truth: truth.parquet and truth.json.
"""

import itertools
import json
import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import UTC, timedelta
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, ZipFile, ZipInfo

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from acromion.fusion.numba_kernels import njit
from acromion.fusion.recording import Float64Array, IntArray
from acromion.fusion.simulation.sensor import KNOT_S, Device, SensorErrors
from acromion.fusion.simulation.shift import SampleBlock, SimulatedShift, simulate_shift


def write_recordings(
    folder: Path, device: Device, duration_h: float, seed: int, rate_hz: float | None = None
) -> tuple[Path, ...]:
    """Simulate a day and write it into ``folder``: all files of :func:`write_shift`."""
    return write_shift(folder, simulate_shift(device, duration_h, seed, rate_hz))


def write_shift(folder: Path, shift: SimulatedShift, *, actilife_csv: bool = True) -> tuple[Path, ...]:
    """Write the recording, then truth.parquet and truth.json; return the paths in this order.

    gt9x: ``shift_seed1.gt3x`` and, unless ``actilife_csv`` is False, ActiLife's export
    ``shift_seed1-IMU.csv``; lsm9ds1: ``shift_seed1.csv``. Creates the folder if needed. The same shift gives
    the same bytes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    truths = folder / "truth.parquet", folder / "truth.json"
    name = f"shift_seed{shift.seed}"
    with ExitStack() as files:
        write_truth = files.enter_context(open_truth(truths, shift))
        if shift.device == "lsm9ds1":
            paths = [folder / f"{name}.csv"]
            write_rows = files.enter_context(open_lsm9ds1_csv(paths[0], shift))
            for block in shift.blocks():
                write_truth(block)
                write_rows(block)
        else:
            paths = [folder / f"{name}.gt3x"]
            writers = [files.enter_context(open_gt3x(paths[0], shift))]
            if actilife_csv:
                paths.append(folder / f"{name}-IMU.csv")
                writers.append(files.enter_context(open_actilife_csv(paths[1], shift)))
            cutter = SecondCutter(shift.rate_hz)
            for block in shift.blocks():
                write_truth(block)
                seconds = cutter.cut(make_rows(shift, block))
                for write in writers if len(seconds.counts) else ():
                    write(seconds)
    return (*paths, *truths)


# The rows of a GT9X's inertial unit, split into the seconds of its clock.

ROW = np.dtype([("acc", ">i2", 3), ("temp", ">i2"), ("gyr", ">i2", 3), ("mag", "<i2", 3), ("pad", "u1")])
"""21 bytes; the magnetometer is little-endian, the rest big-endian, as the device writes it."""
Rows = NDArray[Any]
TEMPERATURE_PER_LSB, TEMPERATURE_AT_ZERO = 1 / 333.87, 21.0
FIELD_UT_PER_LSB = 1 / 6.826667
PADDING = 16
FIELD_REFRESH = 13
"""The magnetometer updates far less often than the rows (23 times in 300 on a real device)."""


@dataclass(frozen=True, slots=True, eq=False)
class ImuSeconds:
    """Whole seconds of rows: ``counts`` (s,) rows in each second from second ``first_s`` on."""

    first_s: int
    counts: IntArray
    rows: Rows

    def starts(self) -> IntArray:
        """Return the index of each second's first row; shape (s + 1,), the last is the number of rows."""
        return np.concatenate(([0], np.cumsum(self.counts)))


def make_rows(shift: SimulatedShift, block: SampleBlock) -> Rows:
    """Return the device's rows of a block."""
    rows = np.empty(len(block.time_s), ROW)
    rows["acc"], rows["gyr"] = shift.count(block.readings)
    knots_s = KNOT_S * np.arange(len(shift.errors.temperature_c))
    temperature_c = np.interp(block.time_s, knots_s, shift.errors.temperature_c)
    rows["temp"] = np.rint((temperature_c - TEMPERATURE_AT_ZERO) / TEMPERATURE_PER_LSB)
    held = np.arange(len(rows)) // FIELD_REFRESH * FIELD_REFRESH
    rows["mag"] = np.rint(block.state.field_ut[held] @ shift.errors.mounting.T / FIELD_UT_PER_LSB)
    rows["pad"] = PADDING
    return rows


class SecondCutter:
    """Collects rows until a second of the device's clock is complete."""

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._second = 0
        self._rest = np.empty(0, ROW)

    def cut(self, rows: Rows) -> ImuSeconds:
        """Add rows and return all seconds that are now complete.

        Row i was measured at i / rate, so second T has the rows from ceil(T rate) on: at 100.09 Hz mostly
        100, sometimes 101.
        """
        rows = np.concatenate((self._rest, rows), dtype=ROW)  # otherwise numpy makes the rows little-endian
        begun = int(np.ceil(self._second * self._rate_hz))
        last = int((begun + len(rows)) / self._rate_hz) + 2
        edges = np.ceil(np.arange(self._second, last) * self._rate_hz).astype(np.int64) - begun
        edges = edges[edges <= len(rows)]
        whole = ImuSeconds(self._second, np.diff(edges), rows[: edges[-1]])
        self._second += len(whole.counts)
        self._rest = rows[edges[-1] :]
        return whole


# .gt3x, as a GT9X Link and ActiLife write it.

PRIMARY_RATE_HZ = 90
"""Rate of the primary accelerometer, to which info.txt refers; not that of the inertial unit."""
ARCHIVE_TIME = (2026, 3, 2, 18, 0, 0)
BATTERY, EVENT, METADATA, CAPSENSE, PARAMETERS, SCHEMA, SENSOR, ACTIVITY2 = 2, 3, 6, 13, 21, 24, 25, 26
PARAMETER_VALUES = (
    (0, 49, 0x0C400000),  # acceleration: 2048 per g
    (0, 50, 0x05418937),  # angular rate: 16.384 per deg/s
    (0, 51, 0x036D3A07),  # magnetic field: 6.8267 per uT
    (0, 57, 0x095377AE),  # temperature: 333.87 per K
    (0, 58, 0x05540000),  # temperature at zero: 21 deg C
    (1, 2, 0),  # no sleep mode
    (1, 10, PRIMARY_RATE_HZ),
    (1, 40, 0xFFFFB9B0),  # UTC offset: -18000 s
    (1, 44, 15),  # acceleration, angular rate, field and temperature are on
)
SCHEMA_COLUMNS = (
    *(("Accelerometer " + axis, 3, 16 * k, 16, 0x0C400000) for k, axis in enumerate("XYZ")),
    ("Temperature", 3, 48, 16, 0x095377AE),
    *(("Gyroscope " + axis, 3, 64 + 16 * k, 16, 0x05418937) for k, axis in enumerate("XYZ")),
    *(("Magnetometer " + axis, 2, 112 + 16 * k, 16, 0x036D3A07) for k, axis in enumerate("XYZ")),
    ("", 0, 160, 8, 0),
)
"""Label, flags (1 big-endian, 2 signed), first bit, bits, scale."""


@contextmanager
def open_gt3x(path: Path, shift: SimulatedShift) -> Iterator[Callable[[ImuSeconds], None]]:
    """Yield a function that writes seconds of rows; info.txt is written at the end."""
    start_s = int(shift.start.replace(tzinfo=UTC).timestamp())  # the device's clock as UTC, as ActiLife does
    second, primary = 0, b""
    with ZipFile(path, "w", ZIP_STORED) as archive:
        with archive.open(ZipInfo("log.bin", ARCHIVE_TIME), "w", force_zip64=False) as log:

            def write_record(kind: int, payload: bytes) -> None:
                log.write(frame_record(kind, start_s + second, payload))

            def write_seconds(seconds: ImuSeconds) -> None:
                nonlocal second, primary
                for begin, end in itertools.pairwise(seconds.starts()):
                    rows = seconds.rows[begin:end]
                    if second % 60 == 0:  # the battery, which falls by 3 mV an hour, and wear
                        write_record(BATTERY, struct.pack("<H", 4150 - second // 1200))
                        write_record(CAPSENSE, bytes((0x3F, 0x18, 0x56, 0x18, 0x00, 0xC8)))
                    primary = _resample_primary(rows)
                    write_record(ACTIVITY2, primary)
                    write_record(SENSOR, b"\x01\x00" + rows.tobytes())
                    second += 1

            _write_opening(write_record)
            yield write_seconds
            if second:  # a last second without rows of the inertial unit, as in real files
                write_record(ACTIVITY2, primary)
        archive.writestr(ZipInfo("info.txt", ARCHIVE_TIME), _describe_device(shift, start_s, second))


def frame_record(kind: int, unix_s: int, payload: bytes) -> bytes:
    """Return a framed payload: separator, type, time, size, payload, checksum."""
    body = struct.pack("<BBIH", 0x1E, kind, unix_s, len(payload)) + payload
    checksum = ~int(np.bitwise_xor.reduce(np.frombuffer(body, np.uint8))) & 0xFF
    return body + bytes((checksum,))


def _write_opening(write_record: Callable[[int, bytes], None]) -> None:
    """Write the records before the first sample; SENSOR_SCHEMA has id 1, and 0 samples per record."""
    owner = {"MetadataType": "InitOwner", "System": "ActiLife", "Parsed": True}
    zone = {
        "MetadataType": "LocalTimeLog",
        "UtcOffset": "-05:00:00",
        "Name": "(UTC-05:00) Eastern Time (US & Canada)",
    }
    write_record(EVENT, b"\x05\x01\x03")
    write_record(METADATA, json.dumps(owner, separators=(",", ":")).encode())
    write_record(METADATA, json.dumps(zone, separators=(",", ":")).encode())
    write_record(PARAMETERS, b"".join(struct.pack("<HHI", *value) for value in PARAMETER_VALUES))
    write_record(EVENT, b"\x05\x01\x01")
    columns = (
        struct.pack("<BBBI", flags, offset, bits, scale) + label.ljust(16).encode()
        for label, flags, offset, bits, scale in SCHEMA_COLUMNS
    )
    write_record(SCHEMA, struct.pack("<HHH", 1, len(SCHEMA_COLUMNS), 0) + b"".join(columns))


def _resample_primary(rows: Rows) -> bytes:
    """Return the primary accelerometer's second: 90 samples at 256 counts per g, clipped at 8 g."""
    picked = rows["acc"][np.arange(PRIMARY_RATE_HZ) * len(rows) // PRIMARY_RATE_HZ]
    return np.clip(np.rint(picked / 8), -2048, 2047).astype("<i2").tobytes()


def _describe_device(shift: SimulatedShift, start_s: int, duration_s: int) -> bytes:
    """Return info.txt; dates are .NET ticks (100 ns since the year 1) of the device's own clock."""
    start, stop, downloaded = (
        (start_s + later_s) * 10_000_000 + 621_355_968_000_000_000
        for later_s in (0, duration_s + 1, duration_s + 301)
    )
    lines = (
        f"Serial Number: {format_serial(shift.seed)}",
        "Device Type: Link",
        "Firmware: 1.7.2",
        "Battery Voltage: 4.12",
        f"Sample Rate: {PRIMARY_RATE_HZ}",
        f"Start Date: {start}",
        f"Stop Date: {stop}",
        f"Last Sample Time: {stop}",
        "TimeZone: -05:00:00",
        f"Download Date: {downloaded}",
        "Board Revision: 5",
        "Unexpected Resets: 0",
        "Acceleration Scale: 256.0",
        "Acceleration Min: -8.0",
        "Acceleration Max: 8.0",
        f"Subject Name: SIM{shift.seed}",
    )
    return "".join(line + "\r\n" for line in lines).encode()


def format_serial(seed: int) -> str:
    """Return a serial number of the right form: TAS, the prefix of the GT9X Link."""
    return f"TAS1E{seed % 100_000_000:08d}"


# Text, millions of rows at a time: fixed decimals from integers, so nothing is rounded.

COMMA, DOT, MINUS, NEWLINE, ZERO = 44, 46, 45, 10, 48
Bytes = NDArray[np.uint8]


@njit(cache=True, nogil=True)
def _put_digits(out: Bytes, at_byte: int, value: int, width: int) -> int:  # pragma: no cover - compiled
    """Write ``value`` >= 0 with leading zeros to at least ``width`` digits; return the position after it."""
    digits, rest = 1, value // 10
    while rest > 0:
        digits += 1
        rest //= 10
    end = at_byte + max(digits, width)
    for place in range(end - 1, at_byte - 1, -1):
        out[place] = ZERO + value % 10
        value //= 10
    return end


@njit(cache=True, nogil=True)
def _put_fixed(out: Bytes, at_byte: int, value: int, decimals: int) -> int:  # pragma: no cover - compiled
    """Write ``value`` / 10**decimals with all its decimals; return the position after it."""
    if value < 0:
        out[at_byte] = MINUS
        at_byte += 1
        value = -value
    one = 10**decimals
    at_byte = _put_digits(out, at_byte, value // one, 1)
    out[at_byte] = DOT
    return _put_digits(out, at_byte + 1, value % one, decimals)


@njit(cache=True, nogil=True)
def put_rows(
    out: Bytes, stamps: Bytes, counter: IntArray, width: int, values: IntArray, decimals: IntArray
) -> int:  # pragma: no cover - compiled
    """Write rows ``counter,value,...``, each after its timestamp; return the number of bytes written.

    ``stamps`` (s, length): text, each for the same number of the n rows. ``counter`` (n,): to at least
    ``width`` digits. ``values`` (n, columns): in units of 10**-decimals. ``out`` needs 24 bytes for each
    number, plus the timestamps.
    """
    at = 0
    for i in range(values.shape[0]):
        for place in range(stamps.shape[1]):
            out[at + place] = stamps[i * stamps.shape[0] // values.shape[0], place]
        at = _put_digits(out, at + stamps.shape[1], counter[i], width)
        for column in range(values.shape[1]):
            out[at] = COMMA
            at = _put_fixed(out, at + 1, values[i, column], decimals[column])
        out[at] = NEWLINE
        at += 1
    return at


# Output of a logger with an LSM9DS1: a CSV with a microsecond counter, in g and deg/s.
#
# The sensor's registers are left-handed. Loggers that print g and deg/s, like this one, convert them to one
# right-handed frame for acc and gyr, and so does this file.

COUNTER_SIZE = 2**32
"""micros() wraps here: every 71.6 minutes."""
LATENCY_US = 40.0
"""A sample is read up to this long after it was measured."""
LSM9DS1_COLUMNS = "time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
DECIMALS = np.array([6, 6, 6, 3, 3, 3])
NO_STAMPS = np.empty((1, 0), np.uint8)


@contextmanager
def open_lsm9ds1_csv(path: Path, shift: SimulatedShift) -> Iterator[Callable[[SampleBlock], None]]:
    """Yield a function that writes blocks of samples; the values are whole multiples of the resolution."""
    part, chance = shift.part, np.random.default_rng([shift.seed, 4])
    switched_on_us = chance.integers(3_000_000, 600_000_000)
    head = (
        "# device: LSM9DS1",
        f"# start: {shift.start.isoformat()}",
        f"# acc_range_g: {part.acc_range_g:g}",
        f"# gyr_range_dps: {part.gyr_range_dps:g}",
        LSM9DS1_COLUMNS,
    )
    with path.open("wb") as file:
        file.write("".join(line + "\n" for line in head).encode())

        def write_block(block: SampleBlock) -> None:
            acc, gyr = shift.count(block.readings)
            values = np.empty((len(acc), 6), np.int64)
            values[:, :3] = acc.astype(np.int64) * round(part.acc_g_per_lsb * 1e6)
            values[:, 3:] = gyr.astype(np.int64) * round(part.gyr_dps_per_lsb * 1e3)
            late_us = chance.uniform(0.0, LATENCY_US, len(block.time_s))
            counter = (switched_on_us + (block.time_s * 1e6 + late_us).astype(np.int64)) % COUNTER_SIZE
            out = np.empty(values.shape[0] * 7 * 24, np.uint8)
            file.write(out[: put_rows(out, NO_STAMPS, counter, 1, values, DECIMALS)].tobytes())

        yield write_block


# ActiLife's export of the GT9X.

ACTILIFE_COLUMNS = (
    "Timestamp,Accelerometer X,Accelerometer Y,Accelerometer Z,Temperature,"
    "Gyroscope X,Gyroscope Y,Gyroscope Z,Magnetometer X,Magnetometer Y,Magnetometer Z"
)
DIVISORS = np.array([2048.0] * 3 + [333.87] + [16.383999] * 3 + [6.826667] * 3)
"""ActiLife's divisors of the counts; 16.383999 is its own rounding."""
ROWS_PER_SECOND, MILLIONTHS = 100, np.full(len(DIVISORS), 6)


@contextmanager
def open_actilife_csv(path: Path, shift: SimulatedShift) -> Iterator[Callable[[ImuSeconds], None]]:
    """Yield a function that resamples seconds to 100 rows by ActiLife's rule and writes them."""
    with path.open("wb") as file:
        file.write(_write_actilife_head(shift))

        def write_seconds(seconds: ImuSeconds) -> None:
            values = _resample(seconds) / DIVISORS
            values[:, 3] += TEMPERATURE_AT_ZERO
            first = shift.start + timedelta(seconds=seconds.first_s)
            clocks = (first + timedelta(seconds=k) for k in range(len(seconds.counts)))
            text = "".join(f"{clock.isoformat()}." for clock in clocks).encode()
            stamps = np.array(np.frombuffer(text, np.uint8)).reshape(len(seconds.counts), -1)
            counter = np.tile(np.arange(ROWS_PER_SECOND) * (10_000_000 // ROWS_PER_SECOND), len(stamps))
            out = np.empty(values.shape[0] * (32 + 24 * values.shape[1]), np.uint8)
            millionths = round_to_millionths(values)
            file.write(out[: put_rows(out, stamps, counter, 7, millionths, MILLIONTHS)].tobytes())

        yield write_seconds


def round_to_millionths(values: Float64Array) -> IntArray:
    """Round half away from zero, as .NET prints (0.0078125 becomes 0.007813)."""
    return (np.sign(values) * np.floor(np.abs(values) * 1e6 + 0.5)).astype(np.int64)


def _resample(seconds: ImuSeconds) -> Float64Array:
    """Interpolate each second's n rows at k n / 100, k = 0 ... 99, held at the last row."""
    rows, most, starts = seconds.rows, seconds.counts[:, None] - 1, seconds.starts()[:-1, None]
    counts = np.column_stack((rows["acc"], rows["temp"], rows["gyr"], rows["mag"])).astype(np.float64)
    place = np.minimum(np.arange(ROWS_PER_SECOND) * seconds.counts[:, None] / ROWS_PER_SECOND, most)
    low = place.astype(np.int64)
    part = (place - low).reshape(-1, 1)
    high = np.minimum(low + 1, most) + starts
    return np.asarray(counts[(low + starts).ravel()] * (1.0 - part) + counts[high.ravel()] * part)


def _write_actilife_head(shift: SimulatedShift) -> bytes:
    """Return the ten lines above the columns, and the column line."""
    start = shift.start
    end = start + timedelta(seconds=int(shift.sample_count / shift.rate_hz) + 301)
    title = (
        "------------ Data File Created By ActiGraph Link IMU 9DOF Sensor ActiLife v6.13.3 Firmware v1.7.2 "
        "date format M/d/yyyy at 100 Hz  -----------"
    )
    lines = (
        title,
        f"Serial Number: {format_serial(shift.seed)}",
        f"Start Time {start:%H:%M:%S}",
        f"Start Date {start.month}/{start.day}/{start.year}",
        "Epoch Period (hh:mm:ss) 00:00:00",
        f"Download Time {end:%H:%M:%S}",
        f"Download Date {end.month}/{end.day}/{end.year}",
        "Current Memory Address: 0",
        "Current Battery Voltage: 4.12     Mode = 12",
        "-" * 50,
        ACTILIFE_COLUMNS,
    )
    return "".join(line + "\n" for line in lines).encode()


# The truth: the angle, and its exposure summed over all samples without any filter.

EDGES_DEG = (0.0, 20.0, 30.0, 45.0, 60.0, 80.0, 90.0, 120.0, 150.0, 180.0)
THRESHOLDS_DEG = (30.0, 60.0, 90.0)
TRUTH_SCHEMA = pa.schema([("time_s", pa.float64()), ("elevation_deg", pa.float64())])
HALF_HYSTERESIS_DEG = 5.0


@contextmanager
def open_truth(paths: tuple[Path, Path], shift: SimulatedShift) -> Iterator[Callable[[SampleBlock], None]]:
    """Yield a function that writes the angle of a block and sums the true exposure.

    ``truth.parquet`` contains every k-th sample, with k such that the nominal rate is at most 100 Hz.
    """
    every = max(1, int(np.ceil(shift.nominal_rate_hz / 100.0)))
    in_bins = np.zeros(len(EDGES_DEG) - 1, np.int64)
    above, entries = np.zeros((2, len(THRESHOLDS_DEG)), np.int64)
    states = [-1] * len(THRESHOLDS_DEG)
    clipped = 0
    with pq.ParquetWriter(paths[0], TRUTH_SCHEMA) as table:

        def write_block(block: SampleBlock) -> None:
            nonlocal in_bins, clipped
            elevation_deg, readings, part = block.state.elevation_deg, block.readings, shift.part
            kept = slice(-block.first_sample % every, None, every)
            table.write_table(pa.table([block.time_s[kept], elevation_deg[kept]], schema=TRUTH_SCHEMA))
            in_bins += np.histogram(elevation_deg, EDGES_DEG)[0]
            for k, threshold_deg in enumerate(THRESHOLDS_DEG):
                above[k] += np.count_nonzero(elevation_deg >= threshold_deg)
                found, states[k] = count_entries(elevation_deg, threshold_deg, states[k])
                entries[k] += found
            beyond_g = np.abs(readings.acc_g) > part.acc_range_g
            beyond_dps = np.abs(readings.gyr_dps) > part.gyr_range_dps
            clipped += int((beyond_g | beyond_dps).any(axis=1).sum())

        yield write_block
    share = 100.0 / shift.sample_count
    exposure = {
        "bin_edges_deg": EDGES_DEG,
        "bin_percent": (in_bins * share).tolist(),
        "thresholds_deg": THRESHOLDS_DEG,
        "above_percent": (above * share).tolist(),
        "entries": entries.tolist(),
        "clipped_samples": clipped,
    }
    truth = {
        "schema": "acromion.simulation/1",
        "device": shift.device,
        "seed": shift.seed,
        "start": shift.start.isoformat(),
        "nominal_rate_hz": shift.nominal_rate_hz,
        "rate_hz": shift.rate_hz,
        "samples": shift.sample_count,
        "calibration_s": shift.calibration_s,
        "plan": [[activity.name, activity.start_s, activity.end_s] for activity in shift.plan],
        "exposure": exposure,
        "sensor": _describe_errors(shift.errors),
    }
    paths[1].write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def _describe_errors(errors: SensorErrors) -> dict[str, Any]:
    """Return the specimen's values; for drifting values, the first and last knot and the span."""
    values: dict[str, Any] = {
        name: getattr(errors, name).tolist()
        for name in ("mounting", "acc_gain", "gyr_gain", "acc_offset_g", "gyr_offset_dps")
    }
    for name in ("acc_wander_g", "gyr_wander_dps"):
        knots = getattr(errors, name)
        values[name] = {
            "first": knots[0].tolist(),
            "last": knots[-1].tolist(),
            "span": np.ptp(knots, axis=0).tolist(),
        }
    return values | {"acc_noise_g": errors.acc_noise_g, "gyr_noise_dps": errors.gyr_noise_dps}


@njit(cache=True, nogil=True)
def count_entries(
    elevation_deg: Float64Array, threshold_deg: float, state: int
) -> tuple[int, int]:  # pragma: no cover - compiled
    """Count rises above the threshold with 10 deg of hysteresis.

    ``state``: 1 above, 0 below, -1 not known yet (a start above is not counted). Returns the count and the
    new state.
    """
    entries = 0
    for angle in elevation_deg:
        if state != 1 and angle > threshold_deg + HALF_HYSTERESIS_DEG:
            entries += 0 if state == -1 else 1
            state = 1
        elif angle < threshold_deg - HALF_HYSTERESIS_DEG or state == -1:
            state = 0
    return entries, state
