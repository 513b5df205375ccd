"""Measure how soon a new label is in the report: ``python -m benchmarks.labels [recordings] [hours]``.

Starts the real server with two workers. A conclusion is added to a report of a whole shift, quiet and while
both workers analyse; then a list of participants names whose arm is in each recording of a study. Goals: a
report in under 1 s, a list of 100 recordings in under 20 s.
"""

import statistics
import sys
import tempfile
import time
from pathlib import Path

from acromion.app.library.batches import identify_study
from acromion.fusion.simulation import write_recordings
from tests.ways_in.servers import RunningServer

ROUNDS = 10
STUDY = "Labels"


def wait_until_idle(server: RunningServer) -> None:
    """Wait until no analysis waits or runs."""
    while any(
        server.client.get("/api/v1/analyses", params={"state": state, "limit": 1}).json()["items"]
        for state in ("queued", "running")
    ):
        time.sleep(0.5)


def conclude(server: RunningServer, analysis_id: str, text: str) -> tuple[str, float]:
    """Add a conclusion; return the new analysis, and the seconds until its report is there."""
    started_s = time.perf_counter()
    form = {"text": text, "name": "M. Tremblay", "date": "2026-11-23"}
    answer = server.client.post(f"/analyses/{analysis_id}/conclude", data=form)
    made = answer.headers["location"].rpartition("/")[2]
    while server.see(made)["state"] != "succeeded":
        time.sleep(0.1)
    return made, time.perf_counter() - started_s


def measure_conclusions(server: RunningServer, analysis_id: str, how: str) -> str:
    """Print the seconds of several conclusions, one after another; return the last analysis."""
    taken_s = []
    for number in range(ROUNDS):
        analysis_id, one_s = conclude(server, analysis_id, f"{how} {number}")
        taken_s.append(one_s)
    print(f"a conclusion, {how}: median {statistics.median(taken_s):.2f} s, longest {max(taken_s):.2f} s")
    return analysis_id


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    hours = float(sys.argv[2]) if len(sys.argv) > 2 else 8.0
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        shift = write_recordings(place / "shift", "gt9x", hours, 1)[0]
        short = write_recordings(place / "short", "gt9x", 0.05, 2)[0]
        server = RunningServer(place / "data", place / "log", workers=2)
        report_id = server.send(shift)["id"]
        wait_until_idle(server)
        report_id, first_s = conclude(server, report_id, "first")
        print(f"the first conclusion after a start: {first_s:.2f} s")
        report_id = measure_conclusions(server, report_id, "quiet")
        for number in range(2):
            server.send(shift, file_name=f"busy{number}.gt3x")
        measure_conclusions(server, report_id, "while both workers analyse")
        for number in range(count):
            server.send(short, file_name=f"{number:03d}.gt3x", study=STUDY)
        wait_until_idle(server)
        listed = "".join(f"{number:03d}.gt3x,S{number:03d},left\n" for number in range(count))
        started_s = time.perf_counter()
        place_of_list = f"/studies/{identify_study(STUDY)}/participants"
        answer = server.client.post(place_of_list, content=f"file,subject,side\n{listed}")
        answered_s = time.perf_counter() - started_s
        wait_until_idle(server)
        listed_s = time.perf_counter() - started_s
        changed = answer.json()["changed"]
        print(f"a list of {changed}: answered in {answered_s:.2f} s, set in {listed_s:.1f} s")
        server.stop()


if __name__ == "__main__":
    main()
