"""What is made of a finished analysis when somebody asks: a comparison, angles as text, its settings."""

import csv
import gzip
import io
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from app.batch.settings_file import read_settings
from app.jobs.children.attempt import load_and_make_report
from app.jobs.worker import run_next
from tests.app.conftest import OpenBench


@pytest.fixture
def analysed(client: TestClient, bench: OpenBench, shift_gt3x: Path) -> list[str]:
    """Analyse one shift twice, as the right arm and as the left."""
    at_work = bench(load_and_make_report)
    found = []
    for side in ("right", "left"):
        content = shift_gt3x.read_bytes()
        made = client.post("/api/v1/analyze", params={"side": side, "file_name": "a.gt3x"}, content=content)
        assert run_next(at_work)
        found.append(made.json()["id"])
    return found


def test_the_angles_are_given_as_text(client: TestClient, analysed: list[str]) -> None:
    body = client.get(f"/api/v1/analyses/{analysed[0]}/elevation.csv.gz").content

    rows = list(csv.DictReader(io.StringIO(gzip.decompress(body).decode())))
    assert list(rows[0]) == ["time_s", "elevation_deg", "valid"]
    assert float(rows[-1]["time_s"]) == pytest.approx(360, abs=0.1)


def test_the_settings_are_given_as_the_command_takes_them(client: TestClient, analysed: list[str]) -> None:
    body = client.get(f"/api/v1/analyses/{analysed[1]}/settings.yaml").content

    assert read_settings(body)["side"] == "left"


def test_the_hours_are_a_table(client: TestClient, analysed: list[str]) -> None:
    body = client.get(f"/api/v1/analyses/{analysed[0]}/periods.csv").text

    assert [row["label"] for row in csv.DictReader(io.StringIO(body))] == ["2026-03-02T07:00"]
