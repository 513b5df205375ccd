"""Small tables in the forms that loggers write."""

import io
from collections.abc import Iterable

from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording

HEADER = "time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
PREAMBLE = "# device: LSM9DS1\n# start: 2026-03-03T07:58:00-05:00\n# acc_range_g: 8\n# gyr_range_dps: 2000\n"


def read_text(text: str | bytes, name: str = "shift.csv", rate_hz: float | None = None) -> Recording:
    """Read a table from memory."""
    content = text.encode() if isinstance(text, str) else text
    return read_recording(io.BytesIO(content), file_name=name, rate_hz=rate_hz)


def line(k: int) -> str:
    """A row at rest whose last value numbers it; the other channels twitch now and then, as live ones do."""
    twitch = int(k % 7 == 3)
    return f"{0.001 * (k % 3):.3f},0.00{twitch},1.00{twitch},0.5{twitch},-0.25{twitch},{k % 1000}.5"


def table(stamps_us: Iterable[int], header: str = HEADER) -> str:
    return header + "\n" + "".join(f"{us},{line(k)}\n" for k, us in enumerate(stamps_us))


CANON = table(range(0, 20_000_000, 10_000))
