"""What `acromion inspect` says to people: in their language, with every axis and scale that was put right."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from acromion.app.cli import app
from tests.badfiles import signal_files as s
from tests.badfiles.table_files import changed, misnamed, resaved
from tests.badfiles.table_files import stamped as write_stamped
from tests.factories import START


def inspect(folder: Path, content: bytes | str, language: str = "en", *options: str) -> dict[str, str]:
    """Return the lines by their names."""
    path = folder / "shift.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    ended = CliRunner().invoke(app, ["inspect", str(path), "--lang", language, *options])
    assert ended.exit_code == 0, ended.output
    rows = [re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in ended.stdout.splitlines()]
    return {row[0]: row[1] for row in rows}


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (s.tumbled(s.negate_gyro), "left-handed axes: x reversed (from the motion)"),
        (s.tumbled(s.multiply_gyro(1000.0)), "unit of the angular rate, × 0.001 (from the motion)"),
        (s.tumbled(s.leave), "none"),
        (
            lambda: misnamed("us", 1000),
            "unit of the time, us read as ms (from the rate of the rows)",
        ),
    ],
    ids=["left-handed", "unit", "right", "time"],
)
def test_what_was_wrong_in_the_file_is_named(
    make: Callable[[], bytes | str], told: str, tmp_path: Path
) -> None:
    assert inspect(tmp_path, make())["Wrong or not stated"].replace("’", "'") == told


def test_french_has_no_english_names_and_values(tmp_path: Path) -> None:
    text = resaved("%d/%m/%Y %H:%M:%S.%f", START.replace(day=14), "3/14/2026")

    lines = inspect(tmp_path, text, "fr")

    assert lines["Format"].replace("’", "'") == "export IMU d'ActiLife (CSV)"
    assert lines["Horloge"] == "locale"
    assert lines["Irrégularité des temps"] == "non observé"
    assert not {"layout", "columns", "clock", "samples", "software", "nominal_rate_hz"} & set(lines)


def test_french_numbers_have_a_decimal_comma(tmp_path: Path) -> None:
    columns = s.readings()
    rows = [",".join(f"{value:.4f}" for value in row) for row in columns.tolist()]
    stamps = [round(2100.84 * k) for k in range(len(rows))]

    lines = inspect(tmp_path, write_stamped(stamps, rows), "fr")

    assert lines["Fréquence mesurée"].startswith("476,00")
    assert not re.search(r"\d\.\d", " ".join(lines.values()))


def test_a_rate_that_a_person_told_is_not_called_corrected(tmp_path: Path) -> None:
    rows = [",".join(f"{value:.4f}" for value in row) for row in s.readings().tolist()]
    text = "ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n" + "\n".join(rows) + "\n"

    lines = inspect(tmp_path, text, "en", "--rate-hz", "100")

    assert "as stated" in lines["Warnings"]


def test_the_count_of_holes_filled_with_zeros_is_that_of_the_gaps(tmp_path: Path) -> None:
    columns = s.readings().copy()
    for first in (1500, 2500, 3500):
        columns[first : first + 40] = 0.0

    lines = inspect(tmp_path, changed(columns))

    assert "W-STUCK-PART Sensor stuck for a time (3)" in lines["Warnings"]
    assert lines["Gaps"].count("0.4\u00a0s from") == 3
    assert np.count_nonzero(columns[:, 0] == 0.0) == 120
