"""What an analysis gives: its state, its files, and refusals where there are none."""

import csv
import gzip
import hashlib
import io
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from frictionless import validate
from rocrate.rocrate import ROCrate

from acromion.app.analysis.attempt import MakeReport, load_and_make_report
from acromion.app.batch.settings_file import read_settings
from acromion.app.queue.worker import open_worker_context, run_next
from acromion.app.report.export.crate import CRATE
from acromion.app.settings import Settings
from tests.app import stand_ins
from tests.app.conftest import OpenWorker, services_of

NAMES = (
    "results.json", "report.html", "report.pdf", "answer.txt", "elevation.parquet", "bundle.zip",
    *stand_ins.EXPORTS,
)  # fmt: skip


def analyse(client: TestClient, open_worker: OpenWorker, make: MakeReport, **wishes: str) -> str:
    """Send a recording and let a worker take it; return the address of the analysis."""
    sent = client.post("/api/v1/analyze", content=b"<b>recording", params=wishes)
    run_next(open_worker(make))
    return sent.headers["location"]


def test_a_finished_analysis_says_so(shared: TestClient, finished: str) -> None:
    view = shared.get(finished).json()

    assert (view["state"], view["progress"], view["attempts"]) == ("succeeded", 1.0, 1)
    assert "problem" not in view


def test_a_failed_analysis_is_a_200_with_its_problem_and_has_no_file(
    client: TestClient, open_worker: OpenWorker
) -> None:
    address = analyse(client, open_worker, stand_ins.refuse)

    answer = client.get(address, params={"lang": "fr"})

    assert (answer.status_code, answer.json()["state"]) == (200, "failed")
    assert (answer.json()["problem"]["code"], answer.json()["problem"]["status"]) == ("E-SHORT", 422)
    assert client.get(f"{address}/results.json").json()["code"] == "E-NO-FILE"


def test_the_results_are_the_stored_bytes_and_are_sent_once(shared: TestClient, finished: str) -> None:
    answer = shared.get(f"{finished}/results.json")
    etag = answer.headers["etag"]
    again = shared.get(f"{finished}/results.json", headers={"if-none-match": etag})

    assert answer.content == stand_ins.RESULTS
    assert etag == f'"{hashlib.sha256(stand_ins.RESULTS).hexdigest()}"'
    assert (again.status_code, again.content) == (304, b"")


def test_every_link_of_a_finished_analysis_gives_a_file(shared: TestClient, finished: str) -> None:
    links = shared.get(finished).json()["links"]
    read = [link for name, link in links.items() if name not in {"cancel", "retry"}]

    assert {name.replace(".", "_") for name in NAMES} <= links.keys()
    assert [shared.get(links[name.replace(".", "_")]).status_code for name in NAMES] == [200] * len(NAMES)
    assert [link for link in read if "E-NOT-FOUND" in shared.get(link).text] == []
    assert shared.get(f"{finished}/done.json").status_code == 404


def test_the_report_comes_in_the_language_asked_for_else_of_the_request(
    shared: TestClient, finished: str
) -> None:
    contents = [shared.get(f"{finished}/report.pdf{query}").content for query in ("?lang=en", "")]

    assert contents == [b"%PDF-en", b"%PDF-fr"]


def test_the_report_may_do_nothing_in_the_browser(shared: TestClient, finished: str) -> None:
    policy = shared.get(f"{finished}/report.html").headers["content-security-policy"]

    assert policy.startswith("default-src 'none'; style-src 'unsafe-inline'; img-src data:")
    assert policy.endswith("frame-ancestors 'none'; sandbox")
    assert "script-src" not in policy


def test_a_download_is_named_by_file_and_version_where_nothing_else_is_known(
    shared: TestClient, finished: str
) -> None:
    header = shared.get(f"{finished}/report.pdf", params={"lang": "fr"}).headers["content-disposition"]

    plain, exact = "Equipe 1_report_v1.fr.pdf", "%C3%89quipe%201_report_v1.fr.pdf"
    assert header == f"attachment; filename=\"{plain}\"; filename*=UTF-8''{exact}"


@pytest.mark.parametrize("name", ['a";b.gt3x', "a\r\nSet-Cookie: x.gt3x", "../../x.gt3x", "%0d%0a.gt3x"])
def test_no_file_name_escapes_from_the_header(client: TestClient, open_worker: OpenWorker, name: str) -> None:
    address = analyse(client, open_worker, stand_ins.write_report, file_name=name)

    answer = client.get(f"{address}/results.json")

    assert "set-cookie" not in answer.headers
    assert not set('";/\\%') & set(answer.headers["content-disposition"].partition("filename=")[2].strip('"'))


def test_a_file_asked_for_too_early_is_a_409(client: TestClient) -> None:
    address = client.post("/api/v1/analyze", content=b"x").headers["location"]

    problem = client.get(f"{address}/results.json")

    assert (problem.status_code, problem.json()["code"]) == (409, "E-NOT-FINISHED")
    assert problem.headers["retry-after"] == "5"


def test_the_newest_analysis_is_listed_first(client: TestClient) -> None:
    for name in ("one.csv", "two.csv"):
        client.post("/api/v1/analyze", content=b"x", params={"file_name": name})

    names = [view["file_name"] for view in client.get("/api/v1/analyses").json()["items"]]

    assert names == ["two.csv", "one.csv"]


def test_the_bundle_is_a_crate_whose_tables_keep_their_schema(
    client: TestClient, open_worker: OpenWorker, small_gt3x: bytes, tmp_path: Path
) -> None:
    sent = client.post("/api/v1/analyze", content=small_gt3x)
    run_next(open_worker(None))
    bundle = zipfile.ZipFile(io.BytesIO(client.get(f"{sent.headers['location']}/bundle.zip").content))
    bundle.extractall(tmp_path / "crate")

    crate = ROCrate(tmp_path / "crate")

    files = {file.id: int(file["contentSize"]) for file in crate.data_entities}
    assert files == {one.filename: one.file_size for one in bundle.infolist() if one.filename != CRATE}
    assert validate(tmp_path / "crate" / "datapackage.json").valid


def test_a_report_set_again_makes_the_other_language_and_fhir_on_request(
    client: TestClient, open_worker: OpenWorker, small_gt3x: bytes
) -> None:
    worker, store = open_worker(None), services_of(client).store
    sent = client.post("/api/v1/analyze", content=small_gt3x).json()
    run_next(worker)
    first = store.get(sent["id"])
    said = store.add_correction(first, replace(first.request, subject="S013"))
    run_next(worker)
    full = store.add_correction(store.get(said.id), said.request, is_fresh=True)
    run_next(worker)

    made, whole = (read_bundle(client, job.id) for job in (said, full))

    assert made == whole
    assert {"report.en.pdf", "report.fr.pdf", "fhir.json"} < made.keys()
    assert {file.name for file in store.find_files(said.id)}.isdisjoint({"report.fr.pdf", "fhir.json"})
    pdf = client.get(f"/api/v1/analyses/{said.id}/report.pdf?lang=fr").content
    assert pdf == whole["report.fr.pdf"]


def read_bundle(client: TestClient, analysis_id: str) -> dict[str, bytes]:
    body = client.get(f"/api/v1/analyses/{analysis_id}/bundle.zip").content
    bundle = zipfile.ZipFile(io.BytesIO(body))
    return {name: bundle.read(name) for name in bundle.namelist()}


@pytest.mark.parametrize(
    ("asked", "status", "content"),
    [
        ("bytes=0-3", 206, stand_ins.RESULTS[:4]),
        *(
            (asked, 200, stand_ins.RESULTS)
            for asked in (
                *("lines=1-2", "bytes=5-2", "bytes=-", "bytes=one-two", "0-3"),
                *("bytes=" + "9" * 19 + "-", "bytes=" + "9" * 6000 + "-", "bytes=-" + "9" * 6000),
                "bytes=" + "0-1," * 2000 + "0-1",
            )
        ),
    ],
)
def test_a_range_that_cannot_be_understood_gives_the_whole_file(
    shared: TestClient, finished: str, asked: str, status: int, content: bytes
) -> None:
    answer = shared.get(f"{finished}/results.json", headers={"range": asked})

    assert (answer.status_code, answer.content) == (status, content)


@pytest.mark.parametrize("asked", ["bytes=100000-", "bytes=-0", "bytes=0-3,100000-"])
def test_a_range_behind_the_end_is_refused(shared: TestClient, finished: str, asked: str) -> None:
    answer = shared.get(f"{finished}/results.json", headers={"range": asked})

    assert (answer.status_code, answer.json()["code"]) == (416, "E-RANGE")
    assert answer.headers["content-range"] == f"bytes */{len(stand_ins.RESULTS)}"


# What is made of a finished analysis when somebody asks: angles as text, its settings, its hours.


@pytest.fixture(scope="module")
def analysed(shared_server: TestClient, shared_settings: Settings, shift_gt3x: Path) -> str:
    """Return the address of the analysis of a left arm."""
    asked = {"side": "left", "file_name": "a.gt3x"}
    made = shared_server.post("/api/v1/analyze", params=asked, content=shift_gt3x.read_bytes())
    worker = open_worker_context(shared_settings, load_and_make_report)
    assert run_next(worker)
    worker.store.close()
    return str(made.headers["location"])


def test_the_angles_are_given_as_text(shared: TestClient, analysed: str) -> None:
    body = shared.get(f"{analysed}/elevation.csv.gz").content

    rows = list(csv.DictReader(io.StringIO(gzip.decompress(body).decode())))
    assert list(rows[0]) == ["time_s", "elevation_deg", "valid", "analysed"]
    assert float(rows[-1]["time_s"]) == pytest.approx(360, abs=0.1)


def test_the_settings_are_given_as_the_command_takes_them(shared: TestClient, analysed: str) -> None:
    body = shared.get(f"{analysed}/settings.yaml").content

    assert read_settings(body)["side"] == "left"


def test_the_hours_are_a_table(shared: TestClient, analysed: str) -> None:
    body = shared.get(f"{analysed}/hours.csv").text

    assert [row["label"] for row in csv.DictReader(io.StringIO(body))] == ["2026-03-02T07:00"]
