"""What is made of a finished analysis when somebody asks: a comparison, angles as text, its settings."""

import csv
import gzip
import io
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from app.batch.settings_file import read_settings
from app.jobs.children.attempt import load_and_make_report
from app.jobs.worker import open_bench, run_next
from app.settings import Settings


@pytest.fixture(scope="module")
def analysed(shared_server: TestClient, shared_settings: Settings, shift_gt3x: Path) -> str:
    """Return the address of the analysis of a left arm."""
    asked = {"side": "left", "file_name": "a.gt3x"}
    made = shared_server.post("/api/v1/analyze", params=asked, content=shift_gt3x.read_bytes())
    bench = open_bench(shared_settings, load_and_make_report)
    assert run_next(bench)
    bench.store.close()
    return str(made.headers["location"])


def test_the_angles_are_given_as_text(shared: TestClient, analysed: str) -> None:
    body = shared.get(f"{analysed}/elevation.csv.gz").content

    rows = list(csv.DictReader(io.StringIO(gzip.decompress(body).decode())))
    assert list(rows[0]) == ["time_s", "elevation_deg", "valid"]
    assert float(rows[-1]["time_s"]) == pytest.approx(360, abs=0.1)


def test_the_settings_are_given_as_the_command_takes_them(shared: TestClient, analysed: str) -> None:
    body = shared.get(f"{analysed}/settings.yaml").content

    assert read_settings(body)["side"] == "left"


def test_the_hours_are_a_table(shared: TestClient, analysed: str) -> None:
    body = shared.get(f"{analysed}/periods.csv").text

    assert [row["label"] for row in csv.DictReader(io.StringIO(body))] == ["2026-03-02T07:00"]
