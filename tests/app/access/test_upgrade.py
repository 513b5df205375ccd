"""A data folder of the release before there were organisations and a trail."""

import hashlib
import json

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import text

from app.jobs.database.connect import bring_up_to_date, connect
from app.jobs.database.migrate import upgrade
from app.jobs.recordings import RecordingFilter
from app.jobs.trail import TrailQuestion, check_chain, find_lines
from app.main import create_app, find_own_services
from app.request import ReportRequest
from app.settings import Settings
from app.upkeep.verify import find_faults, find_kept

RECORDING = (
    "INSERT INTO recordings (id, sha256, size_bytes, file_name, state, created_at)"
    " VALUES (:id, :sha256, :size, 'shift.gt3x', 'stored', '2026-03-02T07:00:00+00:00')"
)
ANALYSIS = (
    "INSERT INTO analyses (id, recording_id, request, way_in, state, progress, attempts, beats, created_at)"
    " VALUES (:id, :recording, :asked, 'api', 'queued', 0, 0, 0, '2026-03-02T07:00:00+00:00')"
)


def make_earlier_folder(settings: Settings, number: int) -> None:
    """Make a folder of revision 0007 with recordings that wait for their analysis."""
    folder = settings.data_dir / "recordings"
    folder.mkdir(parents=True)
    engine = connect(settings.database_url)
    asked = ReportRequest("shift.gt3x").to_json()
    with engine.begin() as connection:
        upgrade(connection, "0007")
        for one in range(number):
            content, name = b"bytes %d" % one, f"rec_{one:016x}"
            (folder / name).write_bytes(content)
            row = {"id": name, "sha256": hashlib.sha256(content).hexdigest(), "size": len(content)}
            connection.execute(text(RECORDING), row)
            connection.execute(text(ANALYSIS), {"id": f"an_{one:016x}", "recording": name, "asked": asked})
    engine.dispose()


def check_upgrade(settings: Settings, number: int) -> None:
    """Upgrade a folder; check that nothing is lost, all is in "own", and the trail begins by saying so."""
    make_earlier_folder(settings, number)

    bring_up_to_date(settings)

    application = create_app(settings)
    with TestClient(application):
        services = find_own_services(application)
        rows = services.recordings.find_page(RecordingFilter(), number + 1)
        lines = list(find_lines(services.store.reader, TrailQuestion()))
        assert len(rows) == number
        assert check_chain(services.store.reader)[1] == ()
    first = lines[-1]
    assert (first.seq, first.who, first.act) == (1, "machine", "trail.began")
    assert json.loads(first.other) == {"organisation": "own", "recordings": number, "revision": "0007"}
    assert [fault for fault in find_faults(settings, find_kept(settings)) if fault.finding == "missing"] == []


@pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)
def test_a_folder_of_the_release_before_is_whole_and_own(settings: Settings) -> None:
    check_upgrade(settings, 20)


@pytest.mark.slow
def test_a_thousand_recordings_of_the_release_before_are_whole_and_own(
    settings: Settings,
) -> None:
    check_upgrade(settings, 1000)
