"""No line that server and worker write holds a word of a recording, by the real processes."""

from functools import partial
from pathlib import Path

from acromion.fusion.simulation import write_recordings
from tests.ways_in.servers import RunningServer, wait_for

CANARY = "canary-5f2c71d09ab84e36c1f7a2d8e"
WORDS = {"file_name": f"{CANARY}.gt3x", "subject": CANARY}


def test_no_line_of_the_log_holds_a_subject_code_or_a_file_name(tmp_path: Path) -> None:
    (recording,) = (path for path in write_recordings(tmp_path, "gt9x", 0.05, 1) if path.suffix == ".gt3x")
    log = tmp_path / "server.log"
    server = RunningServer(tmp_path / "data", log)
    try:
        good, bad = server.send(recording, **WORDS), server.send(log, **WORDS)
        ended = [wait_for(partial(find_end, server, job["id"]), 900) for job in (good, bad)]
        server.client.post(f"/api/v1/recordings?subject={CANARY}&side=neither", content=b"x")
        for job in (good, bad):
            server.client.delete(f"/api/v1/recordings/{job['recording_id']}", params={"purge": "now"})
    finally:
        server.stop()

    assert ended == ["succeeded", "failed"]
    assert f"{good['id']} attempt 1: finished" in log.read_text()
    assert CANARY not in log.read_text()


def find_end(server: RunningServer, analysis_id: str) -> str | None:
    """Return the state of an analysis that is over."""
    state: str = server.see(analysis_id, wait=60)["state"]
    return state if state in {"succeeded", "failed"} else None
