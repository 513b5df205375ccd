"""Reports of two finished analyses by the API: both arms of one shift, one day beside an earlier one."""

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from acromion.app.analysis.attempt import Attempt, load_and_make_report, run_and_wait
from acromion.app.analysis.pair import make_report_of_two
from acromion.app.http.api.pairs import ChangeView, PairView
from acromion.app.library import report_cache as pairs
from acromion.app.main import create_app
from acromion.app.queue.worker import open_worker_context, run_next
from acromion.app.request import PairRequest
from acromion.app.settings import Settings
from tests.app import stand_ins
from tests.app.conftest import OpenWorker, services_of

Finished = tuple[str, str]


def send(client: TestClient, content: bytes, side: str, subject: str = "S012") -> str:
    asked = {"side": side, "file_name": f"{side}.gt3x", "subject": subject}
    made = client.post("/api/v1/analyze", params=asked, content=content).json()
    return str(made["id"])


@pytest.fixture(scope="module")
def analysed(
    shared_server: TestClient, shared_settings: Settings, shift_gt3x: Path, small_gt3x: bytes
) -> tuple[str, str, str]:
    """A left arm and a right one of one person, and a right one without a subject code."""
    left = send(shared_server, shift_gt3x.read_bytes(), "left")
    rights = [send(shared_server, small_gt3x, "right", subject) for subject in ("S012", "")]
    at_work = open_worker_context(shared_settings, load_and_make_report)
    assert all(run_next(at_work) for _ in range(3))
    at_work.store.close()
    return left, rights[0], rights[1]


@pytest.fixture
def arms(analysed: tuple[str, str, str]) -> Finished:
    """Two recordings, analysed as the left arm and as the right."""
    return analysed[0], analysed[1]


@pytest.fixture
def arms_of_whom(analysed: tuple[str, str, str]) -> Finished:
    """A left arm with a subject code and a right one without."""
    return analysed[0], analysed[2]


@pytest.fixture
def two(client: TestClient, open_worker: OpenWorker, monkeypatch: pytest.MonkeyPatch) -> Finished:
    """Two analyses whose report of two is a stand-in."""
    monkeypatch.setattr(pairs, "load_and_make_pair", stand_ins.write_pair)
    ids = send(client, b"one", "left"), send(client, b"two", "right")
    at_work = open_worker(stand_ins.write_report)
    assert run_next(at_work)
    assert run_next(at_work)
    return ids


def ask_pair(arms: Finished, **more: str) -> dict[str, str]:
    return {"left": arms[0], "right": arms[1], **more}


def take_folder(client: TestClient, analysis_id: str, out: Path) -> Path:
    """Fetch what ``acromion run`` would have left in its folder."""
    services = services_of(client)
    out.mkdir()
    for name in ("results.json", "elevation.parquet"):
        with services.results.borrow(services.store.get(analysis_id), name) as path:
            shutil.copyfile(path, out / name)
    return out


@pytest.mark.parametrize(
    ("kind", "asked", "names"),
    [
        (
            PairRequest("pair", 0.0, paper="letter"),
            {"offset_s": "0", "lang": "fr", "paper": "letter"},
            {"pair.json": "pair.json", "report.pdf": "report.fr.pdf", "report.html": "report.fr.html"}
            | {"answer.txt": "answer.fr.txt"},
        ),
        (
            PairRequest("compare"),
            {"lang": "en"},
            {"comparison.json": "comparison.json", "report.pdf": "report.en.pdf"}
            | {"report.html": "report.en.html", "answer.txt": "answer.en.txt"},
        ),
    ],
    ids=["pair", "compare"],
)
def test_a_report_of_two_is_what_the_command_makes_of_the_same_analyses(
    shared: TestClient, arms: Finished, tmp_path: Path,
    kind: PairRequest, asked: dict[str, Any], names: dict[str, str],
) -> None:  # fmt: skip
    sources = [take_folder(shared, each, tmp_path / each) for each in arms]
    made = tmp_path / "made"
    made.mkdir()
    make_report_of_two(sources, kind, made)

    of_two = ask_pair(arms) if kind.kind == "pair" else {"analysis": list(arms)}
    answers = {
        name: shared.get(f"/api/v1/{kind.kind}/{name}", params=of_two | asked).content for name in names
    }

    assert answers == {name: (made / file).read_bytes() for name, file in names.items()}


def test_the_figures_are_as_the_openapi_document_says(shared: TestClient, arms: Finished) -> None:
    pair = shared.get("/api/v1/pair/pair.json", params=ask_pair(arms, trunk=arms[0], offset_s="1"))
    assert pair.json()["code"] == "E-PAIR"  # an arm is no trunk

    pair = shared.get("/api/v1/pair/pair.json", params=ask_pair(arms, offset_s="1"))
    change = shared.get("/api/v1/compare/comparison.json", params={"analysis": list(arms)})

    assert PairView.model_validate_json(pair.content).clock.stated_by == "person"
    assert ChangeView.model_validate_json(change.content).before.subject == "S012"


@pytest.mark.parametrize(
    ("stated", "told"), [("false", ["E-PAIR", "E-COMPARE", "E-DAYS"]), ("true", ["person"] * 3)]
)
def test_a_missing_code_is_refused_until_somebody_says_that_it_is_one_person(
    shared: TestClient, arms_of_whom: Finished, stated: str, told: list[str]
) -> None:
    pair = ask_pair(arms_of_whom, offset_s="0", same_subject=stated)
    days = {"analysis": list(arms_of_whom), "same_subject": stated}
    paths = ("compare/comparison.json", "profile/profile.json")

    paired = shared.get("/api/v1/pair/pair.json", params=pair).json()
    answers = [paired, *(shared.get(f"/api/v1/{path}", params=days).json() for path in paths)]

    assert [answer.get("one_person", answer.get("code")) for answer in answers] == told


@pytest.mark.parametrize("kind", ["pair", "compare"])
def test_the_page_asks_whether_both_are_of_one_person(
    shared: TestClient, arms_of_whom: Finished, kind: str
) -> None:
    asked = {"first": arms_of_whom[0], "second": arms_of_whom[1], "offset_s": "0", "lang": "en"}

    page = shared.get(f"/beside/{kind}", params=asked).text

    assert 'name="same_subject" value="1"> All are of the same person' in page
    assert 'id="answer"' not in page  # no figure is shown before


def test_the_tick_goes_with_the_report_and_can_be_taken_back(
    shared: TestClient, arms_of_whom: Finished
) -> None:
    asked = {"first": arms_of_whom[0], "second": arms_of_whom[1], "offset_s": "0", "same_subject": "1"}

    page = shared.get("/beside/pair", params=asked).text

    assert 'name="same_subject" value="1" checked>' in page
    assert re.findall(r'/report\.(html|pdf)\?[^"]*same_subject=1', page) == ["html", "pdf"]


def test_where_the_codes_agree_the_page_asks_nothing(shared: TestClient, arms: Finished) -> None:
    page = shared.get("/beside/pair", params={"first": arms[0], "second": arms[1], "offset_s": "0"}).text

    assert "same_subject" not in page


def test_a_download_is_named_by_subject_and_is_not_sent_twice(client: TestClient, two: Finished) -> None:
    first = client.get("/api/v1/pair/report.pdf", params=ask_pair(two, lang="en"))

    seen = {"If-None-Match": first.headers["etag"]}
    again = client.get("/api/v1/pair/report.pdf", params=ask_pair(two, lang="en"), headers=seen)

    assert first.headers["content-disposition"] == 'attachment; filename="S012_pair.en.pdf"'
    assert first.headers["cache-control"] == "no-store"
    assert again.status_code == 304


@pytest.mark.parametrize(
    ("more", "status", "code"),
    [
        ({"left": "a_nobody"}, 404, "E-NOT-FOUND"),
        ({"left": ""}, 404, "E-NOT-FOUND"),
        ({"trunk": "a_nobody"}, 404, "E-NOT-FOUND"),
        ({"offset_s": "172801"}, 422, "E-PARAMETER"),
        ({"trunk_offset_s": "5"}, 422, "E-PARAMETER"),
        ({"paper": "a3"}, 422, "E-PARAMETER"),
        ({"wish": "1"}, 422, "E-PARAMETER"),
    ],
    ids=["unknown", "no left", "unknown trunk", "far apart", "no trunk", "no such paper", "unknown name"],
)
def test_what_cannot_be_asked_of_a_pair_is_refused(
    client: TestClient, two: Finished, more: dict[str, str], status: int, code: str
) -> None:
    answer = client.get("/api/v1/pair/pair.json", params=ask_pair(two) | more)

    assert (answer.status_code, answer.json()["code"]) == (status, code)


def test_the_page_of_a_report_of_two_runs_nothing(shared: TestClient, arms: Finished) -> None:
    page = shared.get("/api/v1/pair/report.html", params=ask_pair(arms, offset_s="0"))

    assert "sandbox" in page.headers["content-security-policy"]


def test_an_analysis_that_has_not_ended_is_waited_for(client: TestClient) -> None:
    ids = [send(client, content, "left") for content in (b"one", b"two")]

    answer = client.get("/api/v1/compare/report.pdf", params={"analysis": ids})

    assert (answer.status_code, answer.json()["code"]) == (409, "E-NOT-FINISHED")


def test_a_report_of_two_is_made_once(
    client: TestClient, two: Finished, monkeypatch: pytest.MonkeyPatch
) -> None:
    client.get("/api/v1/pair/report.pdf", params=ask_pair(two, lang="en"))
    monkeypatch.setattr(pairs, "load_and_make_pair", stand_ins.fail_by_bug)

    by_page = client.get("/beside/pair/report.pdf", params={"first": two[0], "second": two[1], "lang": "en"})

    assert by_page.content == b"%PDF-two"


def test_the_oldest_reports_of_two_make_room(
    client: TestClient, two: Finished, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pairs, "MOST_KEPT", 2)

    for offset_s in ("1", "2", "3"):
        client.get("/api/v1/pair/report.pdf", params=ask_pair(two, offset_s=offset_s, lang="en"))

    assert len(list((settings.data_dir / "cache" / "pairs").iterdir())) == 2


def test_what_a_purge_overtakes_is_not_kept(
    client: TestClient, two: Finished, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = client.get(f"/api/v1/analyses/{two[0]}").json()["recording_id"]

    def purge_meanwhile(attempt: Attempt) -> object:
        made = run_and_wait(attempt)
        assert client.delete(f"/api/v1/recordings/{recording}?purge=now").status_code == 200
        return made

    monkeypatch.setattr(pairs, "run_and_wait", purge_meanwhile)

    answer = client.get("/api/v1/pair/report.pdf", params=ask_pair(two, lang="en"))

    kept = settings.data_dir / "cache" / "pairs"
    assert answer.status_code == 404
    assert not kept.exists() or not list(kept.iterdir())


def test_a_start_removes_what_a_crash_left(settings: Settings) -> None:
    folder = settings.data_dir / "cache" / "pairs" / "0123.45.part" / "0"
    folder.mkdir(parents=True)
    (folder / "answer.en.txt").write_text("S012")

    with TestClient(create_app(settings)):
        pass

    assert not folder.exists()


def test_a_start_keeps_reports_of_two(client: TestClient, two: Finished, settings: Settings) -> None:
    client.get("/api/v1/pair/report.pdf", params=ask_pair(two, lang="en"))
    services = services_of(client)

    services.pairs.sweep()

    assert len(list((settings.data_dir / "cache" / "pairs").glob("*/report.en.pdf"))) == 1


def test_a_movement_that_is_not_shared_is_refused(shared: TestClient, arms: Finished) -> None:
    refused = shared.get("/api/v1/pair/pair.json", params=ask_pair(arms, clock="signals"))

    assert (refused.status_code, refused.json()["code"]) == (422, "E-PAIR")


def test_the_page_gives_the_reason_and_asks_for_the_clocks_again(shared: TestClient, arms: Finished) -> None:
    shown = shared.get("/beside/pair", params={"first": arms[0], "second": arms[1], "clock": "signals"}).text

    assert "The two recordings cannot be paired" in shown
    assert '<option value="signals" selected>' in shown
    assert 'name="offset_s"' in shown
