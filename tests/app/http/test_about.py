"""What the server says about itself, and what it does by itself."""

import json
from typing import Any

import pytest
from fastapi.testclient import TestClient
from openapi_spec_validator import validate
from starlette.requests import Request

from app.api.housekeeping import grow_older
from app.api.middleware import guard
from app.errors import list_refusals
from app.formats import FORMATS
from app.report.words.messages import find_flag_codes
from app.services import Services, find_services
from fusion.readers import READERS

TUS = {"tus-resumable": "1.0.0", "upload-length": "3"}


def services_of(client: TestClient) -> Services:
    return find_services(Request({"type": "http", "app": client.app}))


@pytest.fixture
def document(client: TestClient) -> dict[str, Any]:
    read: dict[str, Any] = client.get("/api/v1/openapi.json").json()
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
    client: TestClient, document: dict[str, Any]
) -> None:
    page = client.get("/api/v1/docs").text

    assert all(f'id="{operation["operationId"]}"' in page for operation in list_operations(document))
    assert "http://" not in page
    assert "https://" not in page
    assert "<script" not in page


def test_every_reader_has_its_format_in_words(client: TestClient) -> None:
    named = [item["name"] for item in client.get("/api/v1/formats").json()["items"]]

    assert sorted(named) == sorted(reader.name for reader in READERS)
    assert len(FORMATS) == len(READERS)


def test_the_dictionary_speaks_the_language_asked_for(client: TestClient) -> None:
    def explain(language: str) -> str:
        words = client.get("/api/v1/dictionary", params={"lang": language}).json()["items"]
        return str(next(word["meaning"] for word in words if word["column"] == "analysed_s"))

    assert (explain("en"), explain("fr")) == ("analysed time", "temps analysé")


@pytest.mark.parametrize("code", sorted({refusal.code for refusal in list_refusals()}))
def test_every_code_can_be_looked_up(client: TestClient, code: str) -> None:
    assert client.get(f"/api/v1/problems/{code}").json()["code"] == code


@pytest.mark.parametrize("code", find_flag_codes())
def test_every_warning_can_be_looked_up(client: TestClient, code: str) -> None:
    told = client.get(f"/api/v1/problems/{code}").json()

    assert (told["code"], told["status"], told["fix"]) == (code, 200, "")
    assert told["detail"]


def test_the_help_page_leads_to_every_warning(client: TestClient) -> None:
    page = client.get("/help").text

    assert all(f'href="/problems/{code}"' in page for code in find_flag_codes())
    assert "it refuses nothing" in page


def test_the_page_of_a_warning_offers_no_cure(client: TestClient) -> None:
    page = client.get("/problems/W-DUP-UPLOAD").text

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

    grow_older(services, services.settings.upload_term_s - 1)
    assert client.get(address).status_code == 200
    grow_older(services, 1)

    assert client.get(address).status_code == 404


def test_what_is_in_the_trash_goes_for_good_after_its_term(client: TestClient) -> None:
    recording = client.post("/api/v1/recordings", content=b"x").json()["id"]
    client.delete(f"/api/v1/recordings/{recording}")
    services = services_of(client)

    grow_older(services, services.settings.trash_term_s)

    assert client.post(f"/api/v1/recordings/{recording}/restore").status_code == 404
    assert list((services.settings.data_dir / "recordings").iterdir()) == []


def test_a_body_of_json_is_bounded(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "DRAIN_LIMIT_S", 0.1)  # the test client sends no more, and does not hang up
    body = json.dumps({"recording_ids": ["x" * 40_000_000]})

    assert client.post("/api/v1/analyses", content=body).status_code == 413
