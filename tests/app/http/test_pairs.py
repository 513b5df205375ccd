"""Reports of two finished analyses by the API: both arms of one shift, one day beside an earlier one."""

import io
import re
import shutil
from pathlib import Path

import pytest
from pypdf import PdfReader
from starlette.requests import Request
from starlette.testclient import TestClient

from app.api.pairs import ChangeView, PairView
from app.jobs.children import pairs
from app.jobs.children.attempt import Attempt, load_and_make_report, make_now
from app.jobs.worker import run_next
from app.main import create_app
from app.request import PairRequest
from app.roads.pair import make_report_of_two
from app.services import Services, find_services
from app.settings import Settings
from tests.app import stand_ins
from tests.app.conftest import OpenBench

Finished = tuple[str, str]


def send(client: TestClient, content: bytes, side: str, subject: str = "S012") -> str:
    asked = {"side": side, "file_name": f"{side}.gt3x", "subject": subject}
    made = client.post("/api/v1/analyze", params=asked, content=content).json()
    return str(made["id"])


@pytest.fixture
def arms(client: TestClient, bench: OpenBench, shift_gt3x: Path, small_gt3x: bytes) -> Finished:
    """Two recordings, analysed as the left arm and as the right."""
    ids = send(client, shift_gt3x.read_bytes(), "left"), send(client, small_gt3x, "right")
    at_work = bench(load_and_make_report)
    assert run_next(at_work)
    assert run_next(at_work)
    return ids


@pytest.fixture
def arms_of_whom(client: TestClient, bench: OpenBench, shift_gt3x: Path, small_gt3x: bytes) -> Finished:
    """A left arm with a subject code and a right one without."""
    ids = send(client, shift_gt3x.read_bytes(), "left"), send(client, small_gt3x, "right", "")
    at_work = bench(load_and_make_report)
    assert run_next(at_work)
    assert run_next(at_work)
    return ids


@pytest.fixture
def two(client: TestClient, bench: OpenBench, monkeypatch: pytest.MonkeyPatch) -> Finished:
    """Two analyses whose report of two is a stand-in."""
    monkeypatch.setattr(pairs, "load_and_make_pair", stand_ins.write_pair)
    ids = send(client, b"one", "left"), send(client, b"two", "right")
    at_work = bench(stand_ins.write_report)
    assert run_next(at_work)
    assert run_next(at_work)
    return ids


def ask_pair(arms: Finished, **more: str) -> dict[str, str]:
    return {"left": arms[0], "right": arms[1], **more}


def services_of(client: TestClient) -> Services:
    return find_services(Request({"type": "http", "app": client.app}))


def take_folder(client: TestClient, analysis_id: str, out: Path) -> Path:
    """Fetch what ``acromion run`` would have left in its folder."""
    services = services_of(client)
    out.mkdir()
    for name in ("results.json", "elevation.parquet"):
        with services.results.borrow(services.store.get(analysis_id), name) as path:
            shutil.copyfile(path, out / name)
    return out


def test_both_arms_are_what_the_command_makes_of_the_same_analyses(
    client: TestClient, arms: Finished, tmp_path: Path
) -> None:
    sources = [take_folder(client, each, tmp_path / each) for each in arms]
    made = tmp_path / "made"
    made.mkdir()
    make_report_of_two(sources, PairRequest("pair", 0.0), made)

    asked = ask_pair(arms, offset_s="0", lang="fr")
    answers = {name: client.get(f"/api/v1/pair/{name}", params=asked) for name in ("pair.json", "report.pdf")}

    assert answers["pair.json"].content == (made / "pair.json").read_bytes()
    assert answers["report.pdf"].content == (made / "report.fr.pdf").read_bytes()
    assert (
        client.get("/api/v1/pair/answer.txt", params=asked).content == (made / "answer.fr.txt").read_bytes()
    )
    page = client.get("/api/v1/pair/report.html", params=asked)
    assert page.content == (made / "report.fr.html").read_bytes()
    assert "sandbox" in page.headers["content-security-policy"]


def test_a_change_is_what_the_command_makes_of_the_same_analyses(
    client: TestClient, arms: Finished, tmp_path: Path
) -> None:
    sources = [take_folder(client, each, tmp_path / each) for each in arms]
    made = tmp_path / "made"
    made.mkdir()
    make_report_of_two(sources, PairRequest("compare"), made)

    asked = {"analysis": list(arms), "lang": "en"}
    figures = client.get("/api/v1/compare/comparison.json", params=asked)
    answer = client.get("/api/v1/compare/answer.txt", params=asked)

    assert figures.content == (made / "comparison.json").read_bytes()
    assert answer.content == (made / "answer.en.txt").read_bytes()


def test_the_figures_are_as_the_openapi_document_says(client: TestClient, arms: Finished) -> None:
    pair = client.get("/api/v1/pair/pair.json", params=ask_pair(arms, trunk=arms[0], offset_s="1"))
    assert pair.json()["code"] == "E-PAIR"  # an arm is no trunk

    pair = client.get("/api/v1/pair/pair.json", params=ask_pair(arms, offset_s="1"))
    change = client.get("/api/v1/compare/comparison.json", params={"analysis": list(arms)})

    assert PairView.model_validate_json(pair.content).clock.stated_by == "person"
    assert ChangeView.model_validate_json(change.content).before.subject == "S012"


@pytest.mark.parametrize(
    ("stated", "told"),
    [("false", ["E-PAIR", "E-COMPARE", "E-DAYS"]), ("true", ["person"] * 3)],
)
def test_a_missing_code_is_refused_until_somebody_says_that_it_is_one_person(
    client: TestClient, arms_of_whom: Finished, stated: str, told: list[str]
) -> None:
    pair = ask_pair(arms_of_whom, offset_s="0", same_subject=stated)
    days = {"analysis": list(arms_of_whom), "same_subject": stated}
    paths = ("compare/comparison.json", "profile/profile.json")

    paired = client.get("/api/v1/pair/pair.json", params=pair).json()
    answers = [paired, *(client.get(f"/api/v1/{path}", params=days).json() for path in paths)]

    assert [answer.get("one_person", answer.get("code")) for answer in answers] == told


@pytest.mark.parametrize("kind", ["pair", "compare"])
@pytest.mark.parametrize(
    ("language", "told"),
    [
        ("en", ("Are these recordings of one person?", "All are of one person")),
        ("fr", ("Ces enregistrements sont-ils d’une même personne\u202f?", "Tous sont d’une même personne")),
    ],
)
def test_the_page_asks_whether_both_are_of_one_person(
    client: TestClient, arms_of_whom: Finished, kind: str, language: str, told: tuple[str, str]
) -> None:
    asked = {"first": arms_of_whom[0], "second": arms_of_whom[1], "offset_s": "0", "lang": language}

    page = client.get(f"/beside/{kind}", params=asked).text

    assert told[0] in page
    assert f'name="same_subject" value="1"> {told[1]}' in page
    assert 'id="answer"' not in page  # no figure is shown before


def test_the_tick_goes_with_the_report_and_can_be_taken_back(
    client: TestClient, arms_of_whom: Finished
) -> None:
    asked = {"first": arms_of_whom[0], "second": arms_of_whom[1], "offset_s": "0", "same_subject": "1"}

    page = client.get("/beside/pair", params=asked).text

    assert 'name="same_subject" value="1" checked>' in page
    assert re.findall(r'/report\.(html|pdf)\?[^"]*same_subject=1', page) == ["html", "pdf"]


def test_where_the_codes_agree_the_page_asks_nothing(client: TestClient, arms: Finished) -> None:
    page = client.get("/beside/pair", params={"first": arms[0], "second": arms[1], "offset_s": "0"}).text

    assert "same_subject" not in page


def test_a_pair_is_for_the_paper_asked(client: TestClient, arms: Finished) -> None:
    answer = client.get("/api/v1/pair/report.pdf", params=ask_pair(arms, offset_s="0", paper="letter"))

    page = PdfReader(io.BytesIO(answer.content)).pages[0].mediabox
    assert (round(page.width), round(page.height)) == (612, 792)


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
        ({"trunk": "a_nobody"}, 404, "E-NOT-FOUND"),
        ({"offset_s": "172801"}, 422, "E-PARAMETER"),
        ({"trunk_offset_s": "5"}, 422, "E-PARAMETER"),
        ({"paper": "a3"}, 422, "E-PARAMETER"),
        ({"wish": "1"}, 422, "E-PARAMETER"),
    ],
    ids=["unknown", "unknown trunk", "far apart", "no trunk", "no such paper", "unknown name"],
)
def test_what_cannot_be_asked_of_a_pair_is_refused(
    client: TestClient, two: Finished, more: dict[str, str], status: int, code: str
) -> None:
    answer = client.get("/api/v1/pair/pair.json", params=ask_pair(two) | more)

    assert (answer.status_code, answer.json()["code"]) == (status, code)


def test_two_that_are_no_pair_are_refused_with_the_reason(client: TestClient, arms: Finished) -> None:
    answer = client.get("/api/v1/pair/report.html", params={"left": arms[1], "right": arms[0]})

    assert (answer.status_code, answer.json()["code"]) == (422, "E-PAIR")


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
        made = make_now(attempt)
        assert client.delete(f"/api/v1/recordings/{recording}?purge=true").status_code == 200
        return made

    monkeypatch.setattr(pairs, "make_now", purge_meanwhile)

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
