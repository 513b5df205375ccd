"""Ten wrong diaries: a dry run, the API and the page name the same lines and store nothing."""

import html
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from acromion.app.cli import app
from acromion.app.queue.worker import open_worker_context, run_next
from acromion.app.settings import Settings
from tests.app.conftest import serving

HEAD = "start,end,kind,label\n"
WRONG = {
    "an unknown kind": (HEAD + "08:00,08:01,brake,\n", [2]),
    "a time in words": (HEAD + "08:00,08:01,task,A\nsoon,08:02,task,B\n", [3]),
    "a fraction of a day": (HEAD + "0.43,08:01,task,\n", [2]),
    "seconds as a clock time": (HEAD + "600,700,task,\n", [2]),
    "an overlap": (HEAD + "07:00,07:02,task,A\n07:01,07:03,task,B\n", [3]),
    "an end before its start": ("start_s,end_s,kind\n60,30,task\n", [2]),
    "a date that does not exist": ("date,start,end,kind\n2026-02-30,08:00,08:01,task\n", [2]),
    "neither yes nor no": ("start,end,kind,left_out\n08:00,08:01,task,maybe\n", [2]),
    "no heading": ("08:00,08:01,task,A\n", [1]),
    "two wrong lines": (HEAD + "08:00,08:01,brake,\nsoon,08:01,task,\n", [2, 3]),
}


@pytest.fixture(scope="module")
def server(
    tmp_path_factory: pytest.TempPathFactory, shift_gt3x: Path
) -> Iterator[tuple[TestClient, str, str]]:
    """Return a client, the periods of a recording in the API, and the import of a diary on its page."""
    data = tmp_path_factory.mktemp("diaries") / "data"
    settings = Settings(data_dir=data, min_free_bytes=0)
    with serving(settings) as client:
        wishes = {"file_name": "a.gt3x", "subject": "A", "side": "left"}
        job = client.post("/api/v1/analyze", content=shift_gt3x.read_bytes(), params=wishes).json()
        worker = open_worker_context(settings, None)
        while run_next(worker):
            pass
        yield client, f"/api/v1/recordings/{job['recording_id']}/periods", f"/analyses/{job['id']}/diary"
        worker.store.close()


def find_lines(text: str) -> list[int]:
    return [int(number) for number in re.findall(r"Line (\d+):", html.unescape(text))]


@pytest.mark.parametrize(("diary", "lines"), WRONG.values(), ids=WRONG)
def test_a_wrong_diary_is_refused_with_its_lines_by_a_dry_run(
    shift_gt3x: Path, tmp_path: Path, diary: str, lines: list[int]
) -> None:
    (tmp_path / "diary.csv").write_text(diary)
    arguments = ["run", shift_gt3x, "-o", tmp_path / "out", "--diary", tmp_path / "diary.csv", "--dry-run"]

    told = CliRunner().invoke(app, [str(argument) for argument in arguments])

    assert told.exit_code == 2
    assert "E-DIARY" in told.output
    assert find_lines(told.output) == lines
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("diary", "lines"), WRONG.values(), ids=WRONG)
def test_a_wrong_diary_is_refused_with_its_lines_by_the_api_and_stores_nothing(
    server: tuple[TestClient, str, str], diary: str, lines: list[int]
) -> None:
    client, periods, _ = server

    answer = client.put(periods, content=diary.encode(), headers={"content-type": "text/csv"})

    assert (answer.status_code, answer.json()["code"]) == (422, "E-DIARY")
    assert find_lines(answer.json()["detail"]) == lines
    assert client.get(periods).json() == []


@pytest.mark.parametrize(("diary", "lines"), WRONG.values(), ids=WRONG)
def test_a_wrong_diary_is_refused_with_its_lines_on_the_page(
    server: tuple[TestClient, str, str], diary: str, lines: list[int]
) -> None:
    client, _, page = server

    answer = client.post(page, content=diary.encode())

    assert answer.status_code == 422
    assert find_lines(answer.text) == lines
