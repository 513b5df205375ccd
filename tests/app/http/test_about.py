"""What the server says about itself, and what it does by itself."""

import re
from typing import Any

import pytest
from fastapi.testclient import TestClient
from openapi_spec_validator import validate

from acromion.app.errors import list_refusals
from acromion.app.formats import FORMATS
from acromion.app.http.api.housekeeping import apply_retention
from acromion.app.report.words.messages import find_flag_codes
from acromion.fusion.readers import READERS
from tests.app.conftest import services_of

TUS = {"tus-resumable": "1.0.0", "upload-length": "3"}


@pytest.fixture(scope="module")
def document(shared_server: TestClient) -> dict[str, Any]:
    read: dict[str, Any] = shared_server.get("/api/v1/openapi.json").json()
    return read


def list_operations(document: dict[str, Any]) -> list[dict[str, Any]]:
    return [operation for path in document["paths"].values() for operation in path.values()]


def test_the_openapi_document_is_valid_3_1(document: dict[str, Any]) -> None:
    validate(document)

    assert document["openapi"].startswith("3.1")


def test_every_operation_has_a_readable_name_of_its_own(document: dict[str, Any]) -> None:
    names = [operation["operationId"] for operation in list_operations(document)]

    assert len(set(names)) == len(names)
    assert all(name.replace("_", "").isalpha() and "api" not in name for name in names)


def test_every_refusal_is_declared_as_a_problem_document(document: dict[str, Any]) -> None:
    for operation in list_operations(document):
        for status, answer in operation["responses"].items():
            if status[0] in "45":
                (schema,) = [kind["schema"] for kind in answer["content"].values()]
                assert list(answer["content"]) == ["application/problem+json"], operation["operationId"]
                assert schema == {"$ref": "#/components/schemas/ProblemView"}


def test_the_docs_page_names_every_operation_and_loads_nothing_from_elsewhere(
    shared: TestClient, document: dict[str, Any]
) -> None:
    page = shared.get("/api/v1/docs").text

    assert all(f'id="{operation["operationId"]}"' in page for operation in list_operations(document))
    assert "http://" not in page
    assert "https://" not in page
    assert "<script" not in page


def test_every_reader_has_its_format_in_words(shared: TestClient) -> None:
    named = [item["name"] for item in shared.get("/api/v1/formats").json()["items"]]

    assert sorted(named) == sorted(reader.name for reader in READERS)
    assert len(FORMATS) == len(READERS)


def test_the_dictionary_speaks_the_language_asked_for(shared: TestClient) -> None:
    def explain(language: str) -> str:
        words = shared.get("/api/v1/dictionary", params={"lang": language}).json()["items"]
        return str(next(word["meaning"] for word in words if word["column"] == "analysed_s"))

    assert (explain("en"), explain("fr")) == ("analysed time", "temps analysé")


def test_every_code_can_be_looked_up(shared: TestClient) -> None:
    codes = sorted({refusal.code for refusal in list_refusals()})

    assert [shared.get(f"/api/v1/problems/{code}").json()["code"] for code in codes] == codes


def test_every_warning_can_be_looked_up(shared: TestClient) -> None:
    for code in find_flag_codes():
        told = shared.get(f"/api/v1/problems/{code}").json()
        assert (told["code"], told["status"], told["fix"]) == (code, 200, "")
        assert told["detail"]


@pytest.mark.parametrize("language", ["en", "fr"])
def test_every_code_stands_once_in_the_help(shared: TestClient, language: str) -> None:
    page = shared.get("/help", params={"lang": language}).text

    codes = sorted(re.findall(r'<a [^>]*href="/problems/([^"]+)"', page))
    assert codes == sorted({refusal.code for refusal in list_refusals()} | set(find_flag_codes()))


def test_the_page_of_a_warning_offers_no_cure(shared: TestClient) -> None:
    page = shared.get("/problems/W-DUP-UPLOAD").text

    assert "the same file was sent before" in page
    assert "What to do" not in page


def test_the_metrics_count_what_waits(client: TestClient) -> None:
    client.post("/api/v1/analyze", content=b"x")
    client.post("/api/v1/uploads", headers=TUS)

    text = client.get("/metrics").text

    assert 'acromion_analyses{state="queued"} 1.0' in text
    assert "acromion_uploads_under_way 1.0" in text


def test_an_upload_that_nobody_goes_on_with_expires(client: TestClient) -> None:
    address = client.post("/api/v1/uploads", headers=TUS).headers["location"]
    services = services_of(client)

    apply_retention(services, services.settings.upload_term_s - 1)
    assert client.get(address).status_code == 200
    apply_retention(services, 1)

    assert client.get(address).status_code == 404


def test_what_is_in_the_trash_goes_for_good_after_its_term(client: TestClient) -> None:
    recording = client.post("/api/v1/recordings", content=b"x").json()["id"]
    client.delete(f"/api/v1/recordings/{recording}")
    services = services_of(client)

    apply_retention(services, services.settings.trash_term_s)

    assert client.post(f"/api/v1/recordings/{recording}/restore").status_code == 404
    assert list((services.settings.data_dir / "recordings").iterdir()) == []
