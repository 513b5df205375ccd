"""The pages: what they say, in both languages, and that a person's text is only ever text."""

import re
import tomllib
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

import acromion.app.http.pages
import acromion.app.report.words.wording
from acromion.app.http.pages.views import format_size
from acromion.app.library.jobs import JobStore
from tests.app.conftest import AddJob
from tests.app.library.test_report_versions import fail_next, finish_next

HOSTILE = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "{{7*7}}",
    "'; DROP TABLE analyses; --",
    "javascript:alert(1)",
    "&lt;b&gt;",
    "=cmd|'/c calc'!A1",
)


class Elements(HTMLParser):
    """Collects the elements and attributes of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def count(self, tag: str) -> int:
        return sum(found == tag for found, _ in self.found)


def test_a_choice_of_language_is_remembered(shared: TestClient) -> None:
    asked = shared.get("/?lang=fr-CA").text

    assert 'href="?lang=en"' in asked
    assert '<html lang="fr-CA"' in asked
    assert '<html lang="fr-CA"' in shared.get("/", headers={"accept-language": "en"}).text


@pytest.mark.parametrize(
    ("page", "title"),
    [("", "Recordings"), ("persons", "People"), ("studies", "Studies"), ("help/poses", "Help")],
)
def test_the_tab_of_the_shown_page_is_marked(shared: TestClient, page: str, title: str) -> None:
    top = shared.get(f"/{page}?lang=en").text.partition("</header>")[0]

    assert re.findall('aria-current="true">([^<]+)<', top) == [title]


@pytest.mark.parametrize(
    ("asked", "given"),
    [
        ("fr-CA,fr;q=0.9,en;q=0.8", "fr-CA"),
        ("fr-BE", "fr"),
        ("fr;q=0.9,fr-CA;q=0.5", "fr"),
        ("en-CA,fr-CA;q=0.5", "en"),
        ("de", "en"),
    ],
)
def test_without_a_choice_the_browsers_language_is_taken(shared: TestClient, asked: str, given: str) -> None:
    assert f'<html lang="{given}"' in shared.get("/", headers={"accept-language": asked}).text


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("/api/v1/analyses/{id}/report.html?lang=en", ""),
        ("/beside/compare?first={id}&second=an_0&lang=en", ""),
        ("/analyses/{id}?lang=en", "is in the trash"),
        ("/analyses/{id}?lang=fr", "est dans la corbeille"),
    ],
)
def test_a_person_who_opens_a_report_in_the_trash_is_offered_to_take_it_back(
    client: TestClient, add_job: AddJob, address: str, told: str
) -> None:
    job = add_job(file_name="shift.gt3x")
    client.post(f"/recordings/{job.recording_id}/delete")

    page = client.get(address.format(id=job.id), headers={"Accept": "text/html"})
    by_program = client.get(f"/api/v1/analyses/{job.id}/report.html")

    assert page.status_code == 404
    assert f"/recordings/{job.recording_id}/restore" in page.text
    assert told in page.text
    assert not told or "shift.gt3x" in page.text
    assert by_program.json()["code"] == "E-NOT-FOUND"


def test_the_address_of_an_analysis_that_was_never_there_says_so_and_leads_back(shared: TestClient) -> None:
    answer = shared.get("/analyses/an_0000000000000000?lang=en")

    assert (answer.status_code, "trash" in answer.text) == (404, False)
    assert "E-NOT-FOUND" in answer.text
    assert 'href="/"' in answer.text


def test_a_plain_form_cancels_without_a_script(client: TestClient, add_job: AddJob) -> None:
    job = add_job()

    answer = client.post(f"/analyses/{job.id}/cancel")

    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    assert "Cancelled" in client.get("/rows?lang=en").text


def test_the_analysis_page_shows_the_figures_as_the_report_writes_them_and_gives_every_file(
    shared: TestClient, finished: str
) -> None:
    page = shared.get(f"{finished.removeprefix('/api/v1')}?lang=fr").text

    assert "12,3\u00a0%" in page
    assert "7\u202fh\u00a042\u202fmin" in page
    for name in ("results.json", "summary.csv", "elevation.parquet", "report.pdf?lang=en"):
        assert f"{finished}/{name}" in page


def test_an_attempt_that_failed_is_withdrawn_by_a_click_and_its_report_stays(
    client: TestClient, store: JobStore, add_job: AddJob
) -> None:
    report = add_job()
    finish_next(store)
    failed = store.add_analysis((report.recording_id, report.sha256), replace(report.request, side="left"))
    fail_next(store)

    answer = client.post(f"/analyses/{failed.id}/withdraw")

    assert (answer.status_code, answer.headers["location"]) == (303, f"/analyses/{report.id}")
    assert "Correct and try again" not in client.get("/").text


def test_a_problem_that_a_retry_meets_again_is_shown_once(
    client: TestClient, store: JobStore, add_job: AddJob
) -> None:
    first = add_job()
    fail_next(store)
    store.add_analysis((first.recording_id, first.sha256), first.request)
    fail_next(store)

    assert client.get(f"/analyses/{first.id}?lang=en").text.count("data-problem>") == 1


def test_the_script_of_uploads_gets_the_colon_of_the_language(client: TestClient) -> None:
    assert 'data-colon="\u00a0:"' in client.get("/?lang=fr").text


@pytest.mark.parametrize("text", HOSTILE)
def test_a_persons_text_is_only_ever_text(shared: TestClient, text: str) -> None:
    page = send(shared, text)
    tame = leave_neighbours(Elements(send(shared, "tame")).found)
    hostile = leave_neighbours(Elements(page).found)[: len(tame)]

    assert text != "{{7*7}}" or text in page  # a template is not filled in
    assert [tag for tag, _ in hostile] == [tag for tag, _ in tame]
    assert [set(attributes) for _, attributes in hostile] == [set(attributes) for _, attributes in tame]


def leave_neighbours(
    found: list[tuple[str, dict[str, str | None]]],
) -> list[tuple[str, dict[str, str | None]]]:
    """Leave out the links to the recordings before and after."""
    return [(tag, attributes) for tag, attributes in found if attributes.get("rel") not in ("prev", "next")]


def send(client: TestClient, text: str) -> str:
    """Send a recording with a hostile name and subject, and give its page."""
    wishes = {"file_name": text.replace("/", "_"), "subject": text}
    job = client.post("/api/v1/analyze", content=b"x", params=wishes).json()
    return client.get(f"/analyses/{job['id']}").text


@pytest.mark.parametrize("path", ["/", "/rows"])
def test_no_page_holds_a_script_or_a_style_of_its_own(client: TestClient, add_job: AddJob, path: str) -> None:
    add_job()

    for tag, attributes in Elements(client.get(path).text).found:
        assert tag != "style"
        assert "style" not in attributes
        assert not [name for name in attributes if name.startswith("on")]
        assert tag != "script" or attributes["src"]


def test_no_page_names_another_host(shared: TestClient) -> None:
    static = Path(acromion.app.http.pages.__path__[0]).resolve() / "static"
    texts = [shared.get("/").text, *(path.read_text() for path in static.rglob("*.js"))]

    addresses = {found for text in texts for found in re.findall(r"https?://[^\s\"'<)]+", text)}

    assert all(address.startswith("http://localhost:8080") for address in addresses)


def test_every_word_of_the_page_is_used() -> None:
    folder = Path(acromion.app.http.pages.__path__[0]).resolve()
    sources = [*folder.rglob("*.py"), *(folder.parents[2] / "templates" / "web").rglob("*.html")]
    code = "".join(path.read_text() for path in sources)
    wording = Path(acromion.app.report.words.wording.__file__).resolve().parent / "en.toml"
    built = (
        "state",
        "stage",
        "verdict",
        "verdict_short",
        "group",
        "figure",
        "definition",
        "method_name",
        "pose_name",
    )

    for table, words in tomllib.loads(wording.read_text())["page"].items():
        if table not in built and isinstance(words, dict):
            unused = [key for key in words if key not in code and key not in built]
            assert unused in ([], ["open_en", "open_fr", "pdf_en", "pdf_fr"], ["side_left", "side_right"])


@pytest.mark.parametrize(
    ("size_bytes", "english", "french"),
    [
        (0, "0\u00a0bytes", "0\u00a0octets"),
        (999, "999\u00a0bytes", "999\u00a0octets"),
        (479_263, "479\u00a0kB", "479\u00a0ko"),
        (349_000_000, "349.0\u00a0MB", "349,0\u00a0Mo"),
        (4 << 30, "4.3\u00a0GB", "4,3\u00a0Go"),
    ],
)
def test_a_size_is_written_as_people_read_it(size_bytes: int, english: str, french: str) -> None:
    assert (format_size(size_bytes, "en"), format_size(size_bytes, "fr")) == (english, french)
