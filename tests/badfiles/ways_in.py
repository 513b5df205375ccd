"""The ways in that a bad file is sent by."""

from dataclasses import dataclass
from functools import cache

from fastapi.testclient import TestClient

from app.jobs.worker import open_bench, run_next
from app.report.wording import Language
from app.settings import Settings
from tests.badfiles.expected import ALWAYS, BadFile


@cache
def content_of(bad: BadFile) -> bytes:
    return bad.make()


@dataclass(frozen=True, slots=True)
class Server:
    """The application and a worker of the same folder, called in turns."""

    client: TestClient
    settings: Settings

    def send(self, bad: BadFile) -> str:
        """Send a file, let a worker do it, and give the address of what became of it."""
        answer = self.client.post("/api/v1/analyze", content=content_of(bad), params={"file_name": bad.name})
        bench = open_bench(self.settings)
        run_next(bench)
        bench.store.close()
        return str(answer.headers["location"])

    def tell_problem(self, address: str, language: Language) -> dict[str, str]:
        """Why there is no report, in a language."""
        seen = self.client.get(address, headers={"Accept-Language": language})
        problem: dict[str, str] = seen.json()["problem"]
        return problem


def codes_in(results: dict[str, dict[str, list[dict[str, str]]]]) -> set[str]:
    return {warning["code"] for warning in results["quality"]["warnings"]} - ALWAYS
