"""Logs: one line for each record, whatever a name holds, and no subject code in any of them."""

import io
import logging
from collections.abc import Iterator

import pytest
from fastapi.testclient import TestClient

from acromion.app.logs import FORMAT, LineFormatter, escape_controls
from acromion.app.queue.worker import run_next
from tests.app import stand_ins
from tests.app.conftest import OpenWorker

HOSTILE = "a\r\nFAKE\x1b[31m\x00\x85\u2028\u2029\u202eb\u2066\ud800"
ESCAPED = r"a\u000d\u000aFAKE\u001b[31m\u0000\u0085\u2028\u2029\u202eb\u2066\ud800"


@pytest.fixture
def lines() -> Iterator[io.StringIO]:
    """What the server writes to its log."""
    written, root = io.StringIO(), logging.getLogger()
    handler, level = logging.StreamHandler(written), root.level
    handler.setFormatter(LineFormatter(FORMAT))
    handler.addFilter(lambda record: not record.name.startswith("httpx"))  # the test's own client
    root.addHandler(handler)
    root.setLevel(logging.DEBUG)
    yield written
    root.removeHandler(handler)
    root.setLevel(level)


@pytest.mark.parametrize("text", ["Élévation à 60° – 😀", r"C:\new\u0041", '{"file": "shift.csv"}'])
def test_other_text_stands_as_it_is(text: str) -> None:
    assert escape_controls(text) == text


def test_a_record_is_one_line(lines: io.StringIO) -> None:
    logging.getLogger("test").warning("taken: %s", HOSTILE)

    (line,) = lines.getvalue().splitlines()
    assert line.endswith(f"WARNING taken: {ESCAPED}")


def test_a_line_begins_with_the_time_in_utc_and_its_zone(lines: io.StringIO) -> None:
    record = logging.LogRecord("test", logging.WARNING, "", 0, "late", (), None)
    record.created = 1_790_000_000.25

    logging.getLogger("test").handle(record)

    assert lines.getvalue() == "2026-09-21T14:13:20.250+00:00 WARNING late\n"


def test_no_line_of_a_traceback_passes_for_a_record(lines: io.StringIO) -> None:
    try:
        raise ValueError(HOSTILE)
    except ValueError:
        logging.getLogger("test").exception("a bug")

    first, *others = lines.getvalue().splitlines()
    assert first.endswith("ERROR a bug")
    assert all(line.startswith("| ") for line in others)
    assert others[-1] == "| FAKE" + ESCAPED.partition("FAKE")[2]


def test_no_name_and_no_subject_of_an_upload_reaches_the_log(
    client: TestClient, open_worker: OpenWorker, lines: io.StringIO
) -> None:
    names = {"subject": "CANARY-1", "file_name": "CANARY-2\u202e\x85.csv"}
    client.post("/api/v1/analyze", content=b"x", params=names, headers={"X-Canary": "CANARY-3"})
    run_next(open_worker(stand_ins.write_report))
    recording = client.post("/api/v1/recordings", content=b"y", params=names).json()["id"]
    client.patch(f"/api/v1/recordings/{recording}", json={"subject": "CANARY-4"})
    items = [{"recording_id": recording, "settings": {"method": "CANARY-5"}}]
    client.post("/api/v1/batches", json={"name": "CANARY-6", "items": items})
    client.post("/api/v1/batches", json={"name": "CANARY-7", "items": items[:0]})
    client.get("/api/v1/recordings", params={"query": "CANARY-8\r\n"})
    run_next(open_worker(stand_ins.refuse))

    assert "CANARY" not in lines.getvalue()


def test_an_error_of_the_database_tells_no_value(client: TestClient) -> None:
    services = client.app.state.services  # type: ignore[attr-defined]

    assert services.store.engine.hide_parameters
    assert services.store.reader.hide_parameters
