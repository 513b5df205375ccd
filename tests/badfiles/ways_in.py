"""The ways in that a bad file is sent by."""

import io
from dataclasses import dataclass
from functools import cache

from fastapi.testclient import TestClient

from acromion.app.queue.worker import open_worker_context, run_next
from acromion.app.report.words.wording import Language
from acromion.app.settings import Settings
from acromion.fusion.angle_files import read_angle_file, recognise_layout
from acromion.fusion.pipeline import Analysis, analyse, analyse_angle_file
from acromion.fusion.readers import read_recording
from tests.badfiles.expected import ALWAYS
from tests.badfiles.outcomes import BadFile


@cache
def content_of(bad: BadFile) -> bytes:
    return bad.make()


def analyse_by_fusion(bad: BadFile) -> Analysis:
    """The one road of the app, by `fusion` alone: motion capture needs no fusion of ours."""
    file = io.BytesIO(content_of(bad))
    if recognise_layout(file, bad.name) == "mvnx":
        return analyse_angle_file(read_angle_file(file, bad.name))
    return analyse(read_recording(file, file_name=bad.name))


@dataclass(frozen=True, slots=True)
class Server:
    """The application and a worker of the same folder, called in turns."""

    client: TestClient
    settings: Settings

    def send(self, bad: BadFile) -> str:
        """Send a file, let a worker do it, and give the address of what became of it."""
        answer = self.client.post("/api/v1/analyze", content=content_of(bad), params={"file_name": bad.name})
        worker = open_worker_context(self.settings)
        run_next(worker)
        worker.store.close()
        return str(answer.headers["location"])

    def build_problem_row(self, address: str, language: Language) -> dict[str, str]:
        """Why there is no report, in a language."""
        seen = self.client.get(address, headers={"Accept-Language": language})
        problem: dict[str, str] = seen.json()["problem"]
        return problem


def codes_in(results: dict[str, dict[str, list[dict[str, str]]]]) -> set[str]:
    return {warning["code"] for warning in results["quality"]["warnings"]} - ALWAYS
