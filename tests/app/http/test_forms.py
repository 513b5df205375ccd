"""A recording in a form, as browsers and ``curl -F`` send it, and the digest a client may tell."""

import base64
import hashlib
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.settings import Settings

URL = "/api/v1/recordings"
FORM = {"content-type": "multipart/form-data; boundary=cut"}
DIGESTS = ("content-digest", "repr-digest")


def tell_digest(content: bytes) -> str:
    return f"sha-256=:{base64.b64encode(hashlib.sha256(content).digest()).decode()}:"


def files_of(settings: Settings) -> list[Path]:
    folders = ("uploads", "recordings")
    return [path for name in folders for path in (settings.data_dir / name).iterdir()]


def test_a_form_brings_the_file_and_what_is_said_about_it(client: TestClient) -> None:
    words = {"subject": "S7", "side": "left", "note": "", "external_id": "visit 2"}

    kept = client.post(URL, files={"file": ("arm.gt3x", b"recording")}, data=words).json()

    assert kept["sha256"] == hashlib.sha256(b"recording").hexdigest()
    told = [kept[name] for name in ("file_name", "subject", "side", "external_id")]
    assert told == ["arm.gt3x", "S7", "left", "visit 2"]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25, deadline=None)
@given(
    content=st.binary(min_size=1, max_size=300)
    .map(lambda octets: octets + b"\r\n--cu" + octets)
    .filter(lambda octets: b"\r\n--cut" not in octets)  # that is the mark itself, as the sender must see to
)
def test_every_byte_of_the_file_arrives_whatever_it_is(client: TestClient, content: bytes) -> None:
    kept = client.post(URL, files={"file": ("a", content)}, headers=FORM).json()

    assert (kept["size_bytes"], kept["sha256"]) == (len(content), hashlib.sha256(content).hexdigest())


def part(name: str, content: bytes = b"") -> bytes:
    return f"--cut\r\nContent-Disposition: form-data; name={name}\r\n\r\n".encode() + content


@pytest.mark.parametrize(
    ("body", "code"),
    [
        (b"", "E-CUT-UPLOAD"),
        (b"no form at all", "E-PARAMETER"),
        (part('"f"; filename="a"', b"half"), "E-CUT-UPLOAD"),
        (part('"f"; filename="a"', b"\r\n--cut--\r\n"), "E-EMPTY"),
        (part('"subject"', b"S1\r\n--cut--\r\n"), "E-PARAMETER"),
        (part('"note"', b"x" * 5000), "E-PARAMETER"),
        (b"".join(part(f'"n{k}"', b"x\r\n") for k in range(30)), "E-PARAMETER"),
    ],
)
def test_a_form_that_cannot_be_is_refused_and_leaves_nothing(
    client: TestClient, settings: Settings, body: bytes, code: str
) -> None:
    answer = client.post(URL, content=body, headers=FORM)

    assert answer.json()["code"] == code
    assert files_of(settings) == []


def test_a_second_file_in_a_form_is_refused(client: TestClient, settings: Settings) -> None:
    files = [("file", ("a.gt3x", b"one")), ("file", ("b.gt3x", b"two"))]

    assert client.post(URL, files=files).json()["code"] == "E-PARAMETER"
    assert files_of(settings) == []


def test_a_field_that_is_not_known_is_refused_with_those_that_are(
    client: TestClient, settings: Settings
) -> None:
    answer = client.post(URL, files={"file": ("a", b"x")}, data={"sied": "left"})

    assert "allowed: file_name, subject, side" in answer.json()["detail"]
    assert files_of(settings) == []


def test_a_form_without_a_file_says_that_the_file_is_wanting(client: TestClient) -> None:
    answer = client.post(URL, content=part('"subject"', b"S1\r\n--cut--\r\n"), headers=FORM)

    assert answer.json()["detail"].endswith("allowed: file.")


@pytest.mark.parametrize("name", DIGESTS)
def test_a_form_that_is_not_what_was_sent_is_refused(
    client: TestClient, settings: Settings, name: str
) -> None:
    form = part('"f"; filename="a"', b"recording\r\n--cut--\r\n")

    answer = client.post(URL, content=form, headers=FORM | {name: tell_digest(b"as it was")})

    assert answer.json()["code"] == "E-DIGEST"
    assert files_of(settings) == []


def test_a_form_that_is_as_it_was_sent_is_taken(client: TestClient) -> None:
    form = part('"f"; filename="a"', b"recording\r\n--cut--\r\n")

    answer = client.post(URL, content=form, headers=FORM | {"content-digest": tell_digest(form)})

    assert answer.json()["sha256"] == hashlib.sha256(b"recording").hexdigest()


@pytest.mark.parametrize("name", DIGESTS)
@pytest.mark.parametrize("address", [URL, "/api/v1/analyze"])
def test_what_is_not_what_was_sent_is_refused(
    client: TestClient, settings: Settings, address: str, name: str
) -> None:
    answer = client.post(address, content=b"damaged", headers={name: tell_digest(b"as it was")})

    assert answer.json()["code"] == "E-DIGEST"
    assert files_of(settings) == []


@pytest.mark.parametrize("name", DIGESTS)
def test_what_is_as_it_was_sent_is_taken(client: TestClient, name: str) -> None:
    digest = f"md5=:1B2M2Y8AsgTpgAmY7PhCfg==:, {tell_digest(b'recording')}"

    assert client.post(URL, content=b"recording", headers={name: digest}).status_code == 201


def test_a_digest_that_is_none_is_refused(client: TestClient) -> None:
    answer = client.post(URL, content=b"x", headers={"content-digest": "sha-256=:xyz:"})

    assert answer.json()["code"] == "E-CHECKSUM"
