"""Several days by the API and on the page: the bytes of the command, what is refused, what is asked."""

import re
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from acromion.app.analysis.pair import make_profile
from acromion.app.http.api.pairs import ProfileView
from acromion.app.library.batches import identify_study
from acromion.app.queue.worker import open_worker_context, run_next
from acromion.app.request import ProfileRequest
from acromion.app.settings import Settings
from tests.app.analysis.days_factory import write_day
from tests.app.conftest import OpenWorker
from tests.app.http.test_pairs import send, take_folder

Finished = tuple[str, str]


def add_days(client: TestClient, settings: Settings) -> Finished:
    """Analyse two days of a right arm, 4 and 8 % of the time above 60 deg."""
    ids = send(client, b"0 4.0", "right"), send(client, b"1 8.0", "right")
    at_work = open_worker_context(settings, write_day)
    assert run_next(at_work)
    assert run_next(at_work)
    at_work.store.close()
    return ids


@pytest.fixture(scope="module")
def days(shared_server: TestClient, shared_settings: Settings) -> Finished:
    """Two days on the server that no test changes."""
    return add_days(shared_server, shared_settings)


@pytest.fixture
def own_days(client: TestClient, settings: Settings) -> Finished:
    """Two days on a server of the test's own."""
    return add_days(client, settings)


def plain(text: str) -> str:
    return re.sub(r"[\u202f\u00a0]", " ", text)


def test_the_profile_is_what_the_command_makes_of_the_same_analyses(
    shared: TestClient, days: Finished, tmp_path: Path
) -> None:
    made = tmp_path / "made"
    made.mkdir()
    make_profile([take_folder(shared, each, tmp_path / each) for each in days], ProfileRequest(), made)

    asked = {"analysis": list(days), "lang": "fr"}
    names = {
        "profile.json": "profile.json",
        "profile.csv": "profile.csv",
        "overlay.csv": "overlay.csv",
        "report.html": "report.fr.html",
        "report.pdf": "report.fr.pdf",
        "answer.txt": "answer.fr.txt",
    }
    answers = {name: shared.get(f"/api/v1/profile/{name}", params=asked).content for name in names}

    assert answers == {name: (made / file).read_bytes() for name, file in names.items()}


def test_the_figures_are_as_the_openapi_document_says(shared: TestClient, days: Finished) -> None:
    figures = shared.get("/api/v1/profile/profile.json", params={"analysis": list(days)})

    view = ProfileView.model_validate_json(figures.content)
    (arm,) = view.arms
    assert (arm.subject, arm.side, arm.figures["time_above_60_percent"].mean) == ("S012", "right", 6.0)


@pytest.mark.parametrize(("hours", "left_out"), [(0, None), (24, "short")])
def test_the_least_hours_of_a_counted_day_are_a_parameter(
    shared: TestClient, days: Finished, hours: int, left_out: str | None
) -> None:
    asked: dict[str, Any] = {"analysis": list(days), "min_hours": hours}
    figures = shared.get("/api/v1/profile/profile.json", params=asked)

    (arm,) = ProfileView.model_validate_json(figures.content).arms
    assert {day.left_out for day in arm.days} == {left_out}


def test_one_analysis_is_no_profile_and_no_place_of_the_server_is_told(
    shared: TestClient, days: Finished
) -> None:
    address = "/api/v1/profile/profile.json"
    refused = shared.get(address, params={"analysis": [days[0], days[0]]})
    unknown = shared.get(address, params={"analysis": [days[0], "0" * 32]})

    assert (refused.status_code, refused.json()["code"]) == (422, "E-DAYS")
    assert "right.gt3x" in refused.json()["detail"]
    assert unknown.status_code == 404


def test_the_page_shows_the_answer_and_leads_to_the_report(shared: TestClient, days: Finished) -> None:
    page = shared.get("/days", params={"analysis": list(days), "lang": "fr"})

    assert page.status_code == 200
    assert "Bras droit, 2 jours : en moyenne 6,0 % du temps analysé au-dessus de 60°" in plain(page.text)
    (pdf,) = re.findall(r'href="([^"]*report\.pdf[^"]*)"', page.text)
    assert shared.get(pdf.replace("&amp;", "&")).content.startswith(b"%PDF-")


def test_days_after_a_change_are_compared_with_those_before(shared: TestClient, days: Finished) -> None:
    asked = {"analysis": days[0], "after": days[1]}

    (change,) = shared.get("/api/v1/profile/profile.json", params=asked).json()["change"]

    above = change["figures"]["time_above_60_percent"]  # least detectable: 1.96 x 2.0 x sqrt(2)
    assert (above["change"], above["detectable"], above["verdict"]) == (4.0, 5.543717, "not larger")


def test_an_analysis_leads_to_the_days_of_its_person(shared: TestClient, days: Finished) -> None:
    page = shared.get(f"/analyses/{days[0]}").text

    person = shared.get("/person?subject=S012").text
    together = shared.get("/days?subject=S012").text
    assert 'href="/person?subject=S012"' in page
    assert 'href="/days?subject=S012"' in person
    assert all(f'value="{each}" checked' in together for each in days)


def test_an_analysis_says_whose_arm_it_is_where_the_recording_does_not(
    client: TestClient, open_worker: OpenWorker, own_days: Finished
) -> None:
    recording = client.post("/api/v1/recordings", params={"file_name": "c.gt3x"}, content=b"3 5").json()["id"]
    settings = {"subject": "S012", "side": "right"}
    made = client.post("/api/v1/analyses", json={"recording_ids": [recording], "settings": settings})
    assert run_next(open_worker(write_day))

    assert made.json()["id"] in client.get(f"/analyses/{own_days[0]}").text
    kept = client.get(f"/api/v1/recordings/{recording}").json()
    assert (kept["subject"], kept["side"]) == ("S012", "right")


def test_a_sensor_on_the_trunk_is_no_day_of_an_arm(
    client: TestClient, open_worker: OpenWorker, own_days: Finished
) -> None:
    asked = {"file_name": "trunk.gt3x", "subject": "S012"}
    trunk = client.post("/api/v1/analyze", params=asked, content=b"2 1.0").json()["id"]
    assert run_next(open_worker(write_day))

    page = client.get("/days?subject=S012").text

    assert f'name="analysis" value="{own_days[1]}" checked' in page
    assert f'name="analysis" value="{trunk}" checked' not in page


# The days of a study.

STUDY = "Packing line"
STUDY_ID = identify_study(STUDY)


@pytest.fixture(scope="module")
def group(shared_server: TestClient, shared_settings: Settings) -> str:
    """Make a study of five people, each with a Monday and a Friday 2.0 to 4.0 points higher."""
    at_work = open_worker_context(shared_settings, write_day)
    shares = {"A": (4, 6), "B": (8, 12), "C": (4, 6), "D": (8, 12), "E": (6, 9)}
    days = [(subject, f"{4 * k} {both[k]}") for subject, both in shares.items() for k in (0, 1)]
    for k, (subject, content) in enumerate(days):
        asked = {"side": "right", "file_name": f"{k}.gt3x", "subject": subject, "study": STUDY}
        shared_server.put("/api/v1/analyze", params=asked, content=content.encode())
        assert run_next(at_work)
    at_work.store.close()
    return STUDY_ID


def count_chosen(page: str, name: str) -> int:
    return len(re.findall(rf'name="{name}" value="\w+" checked', page))


def test_a_study_is_one_group_to_which_its_page_leads(shared: TestClient, group: str) -> None:
    page = plain(shared.get("/days", params={"study": group}).text)
    study = shared.get(f"/studies/{group}").text

    assert "5 people" in page
    assert count_chosen(page, "analysis") == 10
    assert f'action="/days" class="search"><input type="hidden" name="study" value="{group}">' in study


def test_a_study_is_compared_before_and_after_a_day(shared: TestClient, group: str) -> None:
    page = plain(shared.get("/days", params={"study": group, "since": "2026-03-05"}).text)
    others = [
        plain(shared.get("/days", params={"study": group, "since": f"{year}-01-01"}).text)
        for year in (2020, 2030)
    ]

    assert count_chosen(page, "after") > 0
    # by hand: +2, +4, +2, +4 and +3 have a standard deviation of 1, and t(4) is 2.776: 3 ± 1.24
    assert "from 6.0 % to 9.0 % (+3.0 points, 95 % range 1.8 to 4.2)." in page
    assert "One day shows no spread" not in page  # a group needs no second day of anyone
    # a change before or after all days is none
    assert [("5 people" in other, count_chosen(other, "after")) for other in others] == [(True, 0)] * 2


@pytest.mark.parametrize(
    ("asked", "status"),
    [
        ({"study": "ba_0"}, 404),
        ({"since": "2026-03-05"}, 422),
        ({"study": STUDY_ID, "since": "spring"}, 422),
        ({"study": STUDY_ID, "since": "2026-13-45"}, 422),
    ],
)
def test_a_study_that_is_not_there_and_a_day_that_is_none_are_refused(
    client: TestClient, asked: dict[str, str], status: int
) -> None:
    client.put("/api/v1/analyze", params={"study": STUDY}, content=b"4 4")

    assert client.get("/days", params=asked).status_code == status


def test_what_a_recording_says_of_itself_stays_when_an_analysis_says_otherwise(client: TestClient) -> None:
    about = {"file_name": "c.gt3x", "subject": "S012"}
    recording = client.post("/api/v1/recordings", params=about, content=b"3 5").json()["id"]

    client.post("/api/v1/analyses", json={"recording_ids": [recording], "settings": {"subject": "S013"}})

    assert client.get(f"/api/v1/recordings/{recording}").json()["subject"] == "S012"
