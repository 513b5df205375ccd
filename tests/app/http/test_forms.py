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


WHOLE_FORM = part('"f"; filename="a"', b"recording\r\n--cut--\r\n")


@pytest.mark.parametrize(
    ("body", "code", "told"),
    [
        (b"", "E-CUT-UPLOAD", ""),
        (b"no form at all", "E-PARAMETER", ""),
        (part('"f"; filename="a"', b"half"), "E-CUT-UPLOAD", ""),
        (part('"f"; filename="a"', b"\r\n--cut--\r\n"), "E-EMPTY", ""),
        (part('"subject"', b"S1\r\n--cut--\r\n"), "E-PARAMETER", "allowed: file."),
        (part('"sied"', b"left\r\n") + WHOLE_FORM, "E-PARAMETER", "allowed: file_name, subject, side"),
        (part('"note"', b"x" * 5000), "E-PARAMETER", ""),
        (b"".join(part(f'"n{k}"', b"x\r\n") for k in range(30)), "E-PARAMETER", ""),
        (
            b"".join(part(f'"f"; filename="{name}"', b"x\r\n") for name in "ab") + b"--cut--\r\n",
            "E-PARAMETER",
            "",
        ),
    ],
)
def test_a_form_that_cannot_be_is_refused_and_leaves_nothing(
    shared: TestClient, shared_settings: Settings, body: bytes, code: str, told: str
) -> None:
    answer = shared.post(URL, content=body, headers=FORM)

    assert answer.json()["code"] == code
    assert told in answer.json()["detail"]
    assert files_of(shared_settings) == []


@pytest.mark.parametrize("name", DIGESTS)
@pytest.mark.parametrize(
    ("address", "body", "headers"),
    [(URL, b"damaged", {}), ("/api/v1/analyze", b"damaged", {}), (URL, WHOLE_FORM, FORM)],
    ids=["raw", "analyze", "form"],
)
@pytest.mark.parametrize(
    ("digest", "code"), [(tell_digest(b"as it was"), "E-DIGEST"), ("sha-256=:xyz:", "E-CHECKSUM")]
)
def test_what_is_not_what_was_sent_is_refused(
    shared: TestClient, shared_settings: Settings, address: str, body: bytes, headers: dict[str, str],
    name: str, digest: str, code: str,
) -> None:  # fmt: skip
    answer = shared.post(address, content=body, headers=headers | {name: digest})

    assert answer.json()["code"] == code
    assert files_of(shared_settings) == []


@pytest.mark.parametrize(("body", "headers"), [(b"recording", {}), (WHOLE_FORM, FORM)], ids=["raw", "form"])
@pytest.mark.parametrize("name", DIGESTS)
def test_what_is_as_it_was_sent_is_taken(
    client: TestClient, name: str, body: bytes, headers: dict[str, str]
) -> None:
    digest = f"md5=:1B2M2Y8AsgTpgAmY7PhCfg==:, {tell_digest(body)}"

    answer = client.post(URL, content=body, headers=headers | {name: digest})

    assert answer.json()["sha256"] == hashlib.sha256(b"recording").hexdigest()
