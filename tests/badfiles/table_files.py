"""Bad tables (D: ActiLife, LSM9DS1 logger, generic) and the text containers of A."""

import gzip
import io
import zipfile
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from functools import cache

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.recording import STANDARD_GRAVITY
from tests.badfiles.arm import minute
from tests.fusion.readers.tables.table_builder import HEADER

MICROS = range(0, 60_000_000, 10_000)
NAMES = "ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps"
ACTILIFE = (
    "------------ Data File Created By ActiGraph Link IMU 9DOF Sensor ActiLife v6.13.3 Firmware v1.7.2 "
    "date format {order} at 100 Hz  -----------\nSerial Number: TAS1E00000001\nStart Time 08:00:00\n"
    "Start Date {date}\nEpoch Period (hh:mm:ss) {epoch}\nDownload Time 09:00:00\nDownload Date {date}\n"
    "Current Memory Address: 0\nCurrent Battery Voltage: 4.15     Mode = 12\n" + "-" * 50 + "\n"
)
ACTILIFE_COLUMNS = "Accelerometer X,Accelerometer Y,Accelerometer Z,Gyroscope X,Gyroscope Y,Gyroscope Z"


@cache
def values(rate_hz: float = 100.0, times: int = 1) -> tuple[str, ...]:
    """The six readings of each row as a logger prints them."""
    acc_g, gyr_dps = minute(rate_hz, times)
    rows = np.hstack([acc_g, gyr_dps])
    return tuple("{:.4f},{:.4f},{:.4f},{:.3f},{:.3f},{:.3f}".format(*tuple(row)) for row in rows.tolist())


def stamped(stamps: Sequence[object], rows: Sequence[str], header: str = HEADER) -> str:
    return stamped_with(",", stamps, rows, header)


def stamped_with(mark: str, stamps: Sequence[object], rows: Sequence[str], header: str) -> str:
    return header + "\n" + "".join(f"{stamp}{mark}{row}\n" for stamp, row in zip(stamps, rows, strict=True))


@cache
def canon() -> str:
    """The minute in our own form: microseconds, g, deg/s."""
    return stamped(MICROS, values())


def lines_changed(change: Callable[[list[str]], list[str]]) -> Callable[[], bytes]:
    """The minute with its lines (the header is line 0) changed."""
    return lambda: "\n".join(change(canon().split("\n"))).encode()


def line_changed(number: int, change: Callable[[str], str]) -> Callable[[], bytes]:
    return lines_changed(lambda lines: [*lines[:number], change(lines[number]), *lines[number + 1 :]])


def gzipped(content: bytes, keep: float = 1.0) -> Callable[[], bytes]:
    def make() -> bytes:
        packed = gzip.compress(content, 1, mtime=0)
        return packed[: int(len(packed) * keep)]

    return make


def zipped(*names: str) -> Callable[[], bytes]:
    def make() -> bytes:
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in names:
                archive.writestr(name, canon())
        return file.getvalue()

    return make


def french(text: str, delimiter: str = ";") -> str:
    return text.replace(",", delimiter).replace(".", ",")


def wholes_first(count: int) -> str:
    """Whole numbers for ``count`` rows, then French decimals."""
    still = [f"{10 * k};0;0;1;0;{k % 2};-{k % 2}" for k in range(count)]
    moving = [f"{10 * (count + k)};" + french(row) for k, row in enumerate(values())]
    return "t_ms;ax;ay;az;gx;gy;gz\n" + "\n".join([*still, *moving]) + "\n"


def whole_milliseconds() -> str:
    """476 Hz stamped in whole milliseconds."""
    rate_hz = 476.0
    rows = values(rate_hz)
    return stamped([int(1000 * k / rate_hz) for k in range(len(rows))], rows, "t_ms," + NAMES)


def whole_seconds() -> str:
    """Stamps without decimals: a hundred rows share each."""
    start = datetime(2026, 3, 2, 8, 0)  # noqa: DTZ001 - a device's own clock
    stamps = [(start + timedelta(seconds=k // 100)).strftime("%Y-%m-%d %H:%M:%S") for k in range(6000)]
    return stamped(stamps, values(), "timestamp," + NAMES)


def calendar(pattern: str, *, first: datetime = datetime(2026, 3, 14, 8, 0)) -> list[str]:  # noqa: DTZ001
    return [(first + timedelta(milliseconds=10 * k)).strftime(pattern)[:-3] for k in range(6000)]


def calendar_table(pattern: str, first: datetime = datetime(2026, 3, 14, 8, 0)) -> str:  # noqa: DTZ001
    return stamped(calendar(pattern, first=first), values(), "timestamp," + NAMES)


def clock_changed(first: str, step_h: int, offsets: tuple[str, str] = ("", ""), after_s: float = 30) -> str:
    """The minute by a wall clock that is changed once; its offset from UTC may stand behind each stamp."""
    before = calendar("%Y-%m-%dT%H:%M:%S.%f", first=datetime.fromisoformat(first))
    later = datetime.fromisoformat(first) + timedelta(hours=step_h)
    after = calendar("%Y-%m-%dT%H:%M:%S.%f", first=later)
    place = int(100 * after_s)
    stamps = [stamp + offsets[0] for stamp in before[:place]] + [
        stamp + offsets[1] for stamp in after[place:]
    ]
    return stamped(stamps, values(), "timestamp," + NAMES)


def zoned(tail: str, pattern: str = "%Y-%m-%d %H:%M:%S.%f") -> str:
    """Every stamp with the same word behind it: a zone, or the half of the day."""
    return stamped([stamp + tail for stamp in calendar(pattern)], values(), "timestamp," + NAMES)


def misnamed(unit: str, per_s: int) -> str:
    """Times in another unit than their column says."""
    stamps = [f"{k / 100 * per_s:.6f}".rstrip("0").rstrip(".") for k in range(6000)]
    return stamped(stamps, values(), f"time_{unit}," + NAMES)


def every_ten_seconds() -> str:
    """A log of the weather kind: a row of a moving arm now and then, its times in s."""
    chance = np.random.default_rng(5)
    gravity = chance.normal(size=(400, 3))
    acc_g = gravity / np.linalg.norm(gravity, axis=1)[:, None]
    rows = np.hstack([acc_g, chance.normal(0.0, 60.0, (400, 3))]).tolist()
    text = ["{:.4f},{:.4f},{:.4f},{:.3f},{:.3f},{:.3f}".format(*row) for row in rows]
    return stamped([10 * k for k in range(400)], text, "time_s," + NAMES)


def epoch(per_s: int, unit: str) -> str:
    """Time since 1970 from 2026-03-14 08:00 UTC on."""
    first_ms = 1_773_475_200_000
    stamps_ms = range(first_ms, first_ms + 60_000, 10)
    stamps = [f"{ms / 1000:.3f}" if per_s == 1 else str(ms * (per_s // 1000)) for ms in stamps_ms]
    return stamped(stamps, values(), f"timestamp_{unit}," + NAMES)


def french_names() -> str:
    """As a French program exports: accents, `;`, decimal commas, degrees in the unit."""
    header = ";".join(
        ["Horodatage (µs)"]
        + [f"Accéléromètre {axis} (g)" for axis in "XYZ"]
        + [f"Gyroscope {axis} (°/s)" for axis in "XYZ"]
    )
    return header + "\n" + french(canon().split("\n", 1)[1])


def single_spaces(preamble: str = "") -> str:
    """Xsens' export with spaces: nothing stands between two of them where a value is absent."""
    header = "PacketCounter SampleTimeFine Acc_X Acc_Y Acc_Z Gyr_X Gyr_Y Gyr_Z"
    acc_g, gyr_dps = minute(100.0)
    numbers = np.hstack([acc_g * STANDARD_GRAVITY, np.radians(gyr_dps)]).tolist()
    rows = "".join(f"{k:05d}  {' '.join(f'{one:.6f}' for one in row)}\n" for k, row in enumerate(numbers))
    return f"{preamble}{header}\n{rows}"


def date_and_time() -> str:
    stamps = [stamp.replace(" ", ",") for stamp in calendar("%Y-%m-%d %H:%M:%S.%f")]
    return stamped(stamps, values(), "date,time," + NAMES)


def stalls() -> str:
    """The card is busy for 0.2 s every ten seconds, and once for three."""
    steps_us = np.full(6000, 10_000)
    steps_us[[1800, 2800, 3800, 5000]] = [200_000, 200_000, 200_000, 3_000_000]
    return stamped(np.cumsum(steps_us).tolist(), values())


def late_rows() -> str:
    """Ten times two rows have changed places, and once a block of twenty came before the one ahead of it."""
    order = list(range(6000))
    for k in range(1600, 2600, 100):
        order[k], order[k + 1] = order[k + 1], order[k]
    order[5000:5040] = [*range(5020, 5040), *range(5000, 5020)]
    rows = values()
    return stamped([MICROS[k] for k in order], [rows[k] for k in order])


def excel_cut() -> bytes:
    row = ",0.0010,0.0020,1.0000,0.100,0.200,0.300\n"
    return (HEADER + "\n" + "".join(f"{2000 * k}{row}" for k in range(1_048_575))).encode()


def excel_times() -> str:
    """What Excel shows of 08:00:00.010 unless told otherwise: minutes and tenths."""
    stamps = [f"{k // 6000:02d}:{k // 100 % 60:02d}.{k // 10 % 10}" for k in range(6000)]
    return stamped(stamps, values(), "timestamp," + NAMES)


def actilife(
    order: str = "M/d/yyyy", date: str = "3/14/2026", epoch: str = "00:00:00", *, stamps: bool = False
) -> str:
    head = ACTILIFE.format(order=order, date=date, epoch=epoch)
    if not stamps:
        return head + ACTILIFE_COLUMNS + "\n" + "".join(row + "\n" for row in values())
    times = calendar("%Y-%m-%dT%H:%M:%S.%f0")
    return head + stamped([f"{stamp}0000"[:27] for stamp in times], values(), "Timestamp," + ACTILIFE_COLUMNS)


def resaved(pattern: str, first: datetime, header_date: str, order: str = "M/d/yyyy") -> str:
    """An export of ActiLife that a French spreadsheet saved again: other dates, `;`, decimal commas."""
    head = ACTILIFE.format(order=order, date=header_date, epoch="00:00:00")
    names = ";".join(["Timestamp", *ACTILIFE_COLUMNS.split(",")])
    stamps = [stamp.replace(".", ",") for stamp in calendar(pattern, first=first)]
    return head + stamped_with(";", stamps, [french(row) for row in values()], names)


def changed(columns: NDArray[np.float64], header: str = HEADER, rate_hz: float = 100.0) -> str:
    """A table of other readings, shape (n, 6), stamped in microseconds."""
    rows = ["{:.5f},{:.5f},{:.5f},{:.4f},{:.4f},{:.4f}".format(*tuple(row)) for row in columns.tolist()]
    return stamped([round(1e6 * k / rate_hz) for k in range(len(rows))], rows, header)
