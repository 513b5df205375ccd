"""Several days by the API and on the page: the bytes of the command, what is refused, what is asked."""

import re
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from app.api.pairs import ProfileView
from app.jobs.store import JobStore
from app.jobs.worker import run_next
from app.request import ProfileRequest
from app.roads.pair import make_profile
from tests.app.analysis.days_factory import write_day
from tests.app.conftest import OpenBench, find_study
from tests.app.http.test_pairs import send, take_folder

Finished = tuple[str, str]


@pytest.fixture
def days(client: TestClient, bench: OpenBench) -> Finished:
    """Two days of a right arm, 4 and 8 % of the time above 60 deg."""
    ids = send(client, b"0 4.0", "right"), send(client, b"1 8.0", "right")
    at_work = bench(write_day)
    assert run_next(at_work)
    assert run_next(at_work)
    return ids


def plain(text: str) -> str:
    return re.sub(r"[\u202f\u00a0]", " ", text)


def test_the_profile_is_what_the_command_makes_of_the_same_analyses(
    client: TestClient, days: Finished, tmp_path: Path
) -> None:
    made = tmp_path / "made"
    made.mkdir()
    make_profile([take_folder(client, each, tmp_path / each) for each in days], ProfileRequest(), made)

    asked = {"analysis": list(days), "lang": "fr"}
    names = {
        "profile.json": "profile.json",
        "profile.csv": "profile.csv",
        "overlay.csv": "overlay.csv",
        "report.html": "report.fr.html",
        "report.pdf": "report.fr.pdf",
        "answer.txt": "answer.fr.txt",
    }
    answers = {name: client.get(f"/api/v1/profile/{name}", params=asked).content for name in names}

    assert answers == {name: (made / file).read_bytes() for name, file in names.items()}


def test_the_figures_are_as_the_openapi_document_says(client: TestClient, days: Finished) -> None:
    figures = client.get("/api/v1/profile/profile.json", params={"analysis": list(days)})

    view = ProfileView.model_validate_json(figures.content)
    (arm,) = view.arms
    assert (arm.subject, arm.side, arm.figures["time_above_60_percent"].mean) == ("S012", "right", 6.0)


def test_one_analysis_is_no_profile_and_no_place_of_the_server_is_told(
    client: TestClient, days: Finished
) -> None:
    refused = client.get("/api/v1/profile/profile.json", params={"analysis": [days[0], days[0]]})

    assert (refused.status_code, refused.json()["code"]) == (422, "E-DAYS")
    assert "right.gt3x" in refused.json()["detail"]


def test_an_unknown_analysis_is_not_here(client: TestClient, days: Finished) -> None:
    assert (
        client.get("/api/v1/profile/profile.json", params={"analysis": [days[0], "0" * 32]}).status_code
        == 404
    )


def test_the_page_shows_the_answer_and_leads_to_the_report(client: TestClient, days: Finished) -> None:
    page = client.get("/days", params={"analysis": list(days)})

    assert page.status_code == 200
    assert "Right arm, 2 days: time above 60° was 6.0 %" in plain(page.text)
    (pdf,) = re.findall(r'href="([^"]*report\.pdf[^"]*)"', page.text)
    assert client.get(pdf.replace("&amp;", "&")).content.startswith(b"%PDF-")


def test_days_after_a_change_are_compared_with_those_before(client: TestClient, days: Finished) -> None:
    asked = {"analysis": days[0], "after": days[1]}

    (change,) = client.get("/api/v1/profile/profile.json", params=asked).json()["change"]

    above = change["figures"]["time_above_60_percent"]  # least detectable: 1.96 x 2.0 x sqrt(2)
    assert (above["change"], above["detectable"], above["verdict"]) == (4.0, 5.543717, "not larger")


def test_the_page_speaks_french(client: TestClient, days: Finished) -> None:
    page = client.get("/days", params={"analysis": list(days), "lang": "fr"})

    assert "Bras droit, 2 jours : temps au-dessus de 60° de 6,0 %" in plain(page.text)


def test_an_analysis_leads_to_the_days_of_its_person(client: TestClient, days: Finished) -> None:
    page = client.get(f"/analyses/{days[0]}").text

    (address,) = re.findall(r'href="([^"]*/days\?[^"]*)"', page)
    assert all(each in address for each in days)


def test_an_analysis_says_whose_arm_it_is_where_the_recording_does_not(
    client: TestClient, bench: OpenBench, days: Finished
) -> None:
    recording = client.post("/api/v1/recordings", params={"file_name": "c.gt3x"}, content=b"3 5").json()["id"]
    settings = {"subject": "S012", "side": "right"}
    made = client.post("/api/v1/analyses", json={"recording_ids": [recording], "settings": settings})
    assert run_next(bench(write_day))

    assert made.json()["id"] in client.get(f"/analyses/{days[0]}").text
    kept = client.get(f"/api/v1/recordings/{recording}").json()
    assert (kept["subject"], kept["side"]) == ("S012", "right")


def test_what_a_recording_says_of_itself_stays_when_an_analysis_says_otherwise(client: TestClient) -> None:
    about = {"file_name": "c.gt3x", "subject": "S012"}
    recording = client.post("/api/v1/recordings", params=about, content=b"3 5").json()["id"]

    client.post("/api/v1/analyses", json={"recording_ids": [recording], "settings": {"subject": "S013"}})

    assert client.get(f"/api/v1/recordings/{recording}").json()["subject"] == "S012"


def test_a_sensor_on_the_trunk_is_no_day_of_an_arm(
    client: TestClient, bench: OpenBench, days: Finished
) -> None:
    asked = {"file_name": "trunk.gt3x", "subject": "S012"}
    trunk = client.post("/api/v1/analyze", params=asked, content=b"2 1.0").json()["id"]
    assert run_next(bench(write_day))

    (address,) = re.findall(r'href="([^"]*/days\?[^"]*)"', client.get(f"/analyses/{days[0]}").text)

    assert days[1] in address
    assert trunk not in address


def test_the_page_offers_every_recording_of_the_person_to_choose_from(
    client: TestClient, days: Finished
) -> None:
    page = client.get("/days", params={"analysis": [days[0], days[1]]}).text

    chosen = re.findall(r'<input type="checkbox" name="analysis" value="(\w+)" checked', page)
    assert set(chosen) == set(days)


# The days of a study.

STUDY = "Packing line"


@pytest.fixture
def group(client: TestClient, bench: OpenBench, store: JobStore) -> str:
    """Make a study of five people, each with a Monday and a Friday 2.0 to 4.0 points higher."""
    at_work = bench(write_day)
    shares = {"A": (4, 6), "B": (8, 12), "C": (4, 6), "D": (8, 12), "E": (6, 9)}
    days = [(subject, f"{4 * k} {both[k]}") for subject, both in shares.items() for k in (0, 1)]
    for k, (subject, content) in enumerate(days):
        asked = {"side": "right", "file_name": f"{k}.gt3x", "subject": subject, "study": STUDY}
        client.put("/api/v1/analyze", params=asked, content=content.encode())
        assert run_next(at_work)
    return find_study(store, STUDY)


def test_a_study_is_one_group(client: TestClient, group: str) -> None:
    page = plain(client.get("/days", params={"study": group}).text)

    assert "5 people" in page
    assert len(re.findall(r'name="analysis" value="\w+" checked', page)) == 10


def test_a_study_is_compared_before_and_after_a_day(client: TestClient, group: str) -> None:
    page = plain(client.get("/days", params={"study": group, "since": "2026-03-05"}).text)

    assert re.findall(r'name="after" value="\w+" checked', page) != []
    # by hand: +2, +4, +2, +4 and +3 have a standard deviation of 1, and t(4) is 2.776: 3 ± 1.24
    assert "from 6.0 % to 9.0 % (+3.0 points, 95 % range 1.8 to 4.2)." in page
    assert "One day has no spread" not in page  # a group needs no second day of anyone


def test_the_page_of_a_study_leads_to_its_group(client: TestClient, group: str) -> None:
    page = client.get(f"/batches/{group}").text

    assert f'action="/days" class="search"><input type="hidden" name="study" value="{group}">' in page


@pytest.mark.parametrize("since", ["2020-01-01", "2030-01-01"])
def test_a_change_before_or_after_all_days_is_no_change(client: TestClient, group: str, since: str) -> None:
    page = plain(client.get("/days", params={"study": group, "since": since}).text)

    assert "5 people" in page
    assert not re.findall(r'name="after" value="\w+" checked', page)


@pytest.mark.parametrize(("asked", "status"), [({"study": "ba_0"}, 404), ({"since": "2026-03-05"}, 422)])
def test_a_study_that_is_not_there_is_refused(
    client: TestClient, group: str, asked: dict[str, str], status: int
) -> None:
    assert client.get("/days", params=asked).status_code == status


@pytest.mark.parametrize("since", ["spring", "2026-13-45"])
def test_a_day_that_is_none_is_refused(client: TestClient, group: str, since: str) -> None:
    assert client.get("/days", params={"study": group, "since": since}).status_code == 422
