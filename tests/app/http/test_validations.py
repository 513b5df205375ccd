"""Comparisons through the API and the page: two files in one form, a job, its files."""

import io
from math import sin
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from pypdf import PdfReader
from typer.testing import CliRunner

from acromion.app.analysis.attempt import load_and_make_report
from acromion.app.cli import app
from acromion.app.library.batches import identify_study
from acromion.app.library.jobs import JobStore
from acromion.app.ops.recover import Unknown, find_unknown
from acromion.app.queue.worker import open_worker_context, run_next
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenWorker, serving

TIMES = [k / 20 for k in range(600)]
ANGLES = "time_s,elevation_deg\n" + "".join(
    f"{t},{45 + 30 * sin(1.3 * t + 2 * sin(0.17 * t)):.3f}\n" for t in TIMES
)
FILES = {"recording": ("ours.csv", ANGLES), "reference": ("truth.csv", ANGLES)}


def compare(client: TestClient, settings: Settings, **wishes: str) -> str:
    """Send a pair and let a worker take it; returns the address of the comparison."""
    sent = client.post("/api/v1/validations", files=FILES, data=wishes)
    assert sent.status_code == 202, sent.text
    at_work = open_worker_context(settings, None)  # the worker's own way
    assert run_next(at_work)
    at_work.store.close()
    return sent.headers["location"]


@pytest.fixture(scope="module")
def compared(shared_server: TestClient, shared_settings: Settings) -> str:
    """Return the address of a comparison that nothing was wished for."""
    return compare(shared_server, shared_settings)


def test_a_pair_is_taken_and_its_place_is_told(client: TestClient) -> None:
    sent = client.post("/api/v1/validations", files=FILES)

    assert (sent.status_code, sent.json()["state"]) == (202, "queued")
    assert sent.headers["location"] == sent.json()["links"]["self"]
    assert sent.json()["reference_name"] == "truth.csv"
    assert client.get(f"{sent.headers['location']}/validation.json").status_code == 409


def test_a_comparison_gives_every_file(shared: TestClient, compared: str) -> None:
    expected = {
        "validation.json": "application/json",
        "validation.csv": "text/csv; charset=utf-8",
        "validation.html": "text/html; charset=utf-8",
        "validation.pdf": "application/pdf",
    }
    kinds = {name: shared.get(f"{compared}/{name}").headers["content-type"] for name in expected}

    assert kinds == expected


@pytest.mark.parametrize("address", ["/api/v1/validations", "/validations"])
def test_a_file_above_the_size_of_words_is_taken(settings: Settings, address: str) -> None:
    large = {**FILES, "recording": ("ours.csv", ANGLES + "\n" * (9 << 20))}

    with serving(settings, max_upload_bytes=32 << 20) as client:
        sent = client.post(address, files=large)

    assert sent.status_code in (202, 303), sent.text


def test_clock_and_paper_are_those_asked_for(shared: TestClient, shared_settings: Settings) -> None:
    address = compare(shared, shared_settings, offset_s="0,5", drift_ppm="10", paper="letter")

    alignment = shared.get(f"{address}/validation.json").json()["alignment"]
    page = PdfReader(io.BytesIO(shared.get(f"{address}/validation.pdf").content)).pages[0].mediabox

    assert (alignment["offset_s"], alignment["drift_ppm"]) == (0.5, 10.0)
    assert (round(page.width), round(page.height)) == (612, 792)


def test_a_pair_that_cannot_be_compared_is_a_problem(shared: TestClient, shared_settings: Settings) -> None:
    address = compare(shared, shared_settings, offset_s="100000")

    view = shared.get(address, params={"lang": "fr"}).json()

    assert (view["state"], view["problem"]["code"]) == ("failed", "E-OVERLAP")


@pytest.mark.parametrize(
    ("name", "value"),
    [("side", "both"), ("paper", "a3"), ("offset_s", "soon"), ("drift_ppm", "nan"), ("colour", "red")],
)
def test_a_wish_that_cannot_be_is_refused_by_name(shared: TestClient, name: str, value: str) -> None:
    answer = shared.post("/api/v1/validations", files=FILES, data={name: value})

    assert (answer.status_code, answer.json()["code"]) == (422, "E-PARAMETER")
    assert name in answer.json()["detail"]


@pytest.mark.parametrize(
    ("files", "code", "told"),
    [
        ({"recording": ("ours.csv", ANGLES)}, "E-PARAMETER", "reference"),
        (FILES | {"reference": ("truth.csv", "")}, "E-EMPTY", ""),
        (FILES | {"tasks": ("tasks.csv", "name\n")}, "E-TASKS", ""),
    ],
    ids=["no reference", "empty reference", "unusable tasks"],
)
def test_files_that_cannot_be_used_are_refused_at_once_and_leave_nothing(
    client: TestClient, storage: Storage, files: dict[str, tuple[str, str]], code: str, told: str
) -> None:
    answer = client.post("/api/v1/validations", files=files)

    assert (answer.status_code, answer.json()["code"]) == (422, code)
    assert told in answer.json()["detail"]
    assert list((storage.root / "recordings").iterdir()) == []


def test_the_reference_outlives_a_restart(client: TestClient, storage: Storage, store: JobStore) -> None:
    client.post("/api/v1/validations", files=FILES)

    assert find_unknown(store, storage) == Unknown()


def test_among_the_analyses_a_comparison_leads_to_its_own_place(shared: TestClient, compared: str) -> None:
    listed = shared.get("/api/v1/analyses").json()["items"]

    (links,) = (one["links"] for one in listed if one["id"] == compared.rpartition("/")[2])
    assert links["validation"].startswith("/api/v1/validations/")
    assert "report_pdf" not in links


def test_deleting_the_recording_deletes_its_reference(client: TestClient, storage: Storage) -> None:
    client.post("/api/v1/validations", files=FILES)
    (recording,) = client.get("/api/v1/recordings").json()["items"]

    client.delete(f"/api/v1/recordings/{recording['id']}?purge=now")

    assert list((storage.root / "recordings").iterdir()) == []


def test_an_analysis_is_no_comparison_and_has_no_second_angle(client: TestClient, add_job: AddJob) -> None:
    address = f"/validations/{add_job().id}"

    assert client.get(f"/api/v1{address}").status_code == 404
    assert client.get(f"{address}/curve?of=own&from_s=0&to_s=1").status_code == 404


def test_the_form_needs_no_script_and_may_tell_its_origin(shared: TestClient) -> None:
    page = shared.get("/validations")

    assert 'enctype="multipart/form-data"' in page.text
    assert "<script" not in page.text
    assert page.headers["referrer-policy"] == "same-origin"


def test_a_refused_form_keeps_what_was_typed(shared: TestClient) -> None:
    typed = {"side": "left", "subject": 'S012 "<b>', "offset_s": "soon", "drift_ppm": "1,5"}

    answer = shared.post("/validations", files=FILES, data=typed)

    assert answer.status_code == 422
    assert "E-PARAMETER" in answer.text
    assert "Your entries are kept." in answer.text
    assert 'value="left" checked' in answer.text
    assert 'value="S012 &#34;&lt;b&gt;"' in answer.text
    assert 'value="soon"' in answer.text
    assert 'value="1,5"' in answer.text
    assert "<details open>" in answer.text


def test_a_refused_file_keeps_what_was_typed(shared: TestClient) -> None:
    files = {**FILES, "reference": ("truth.csv", "")}

    answer = shared.post("/validations", files=files, data={"side": "right", "subject": "S7"})

    assert "E-EMPTY" in answer.text
    assert 'value="right" checked' in answer.text
    assert 'value="S7"' in answer.text


def test_the_page_leads_from_the_form_to_the_answer(client: TestClient, open_worker: OpenWorker) -> None:
    sent = client.post("/validations", files=FILES)
    waiting = client.get(sent.headers["location"]).text
    run_next(open_worker(load_and_make_report))

    answer = client.get(sent.headers["location"]).text

    assert (sent.status_code, "http-equiv" in waiting, "http-equiv" in answer) == (303, True, False)
    report = f"{sent.headers['location'].replace('/validations/', '/analyses/')}/report.html?lang=en"
    assert report in answer
    assert client.get(report).status_code == 200


@pytest.mark.parametrize("of", ["own", "reference"])
def test_the_page_draws_both_angles_where_both_were_measured(
    shared: TestClient, compared: str, of: str
) -> None:
    address = compared.removeprefix("/api/v1")

    assert f"{address}/curve?of={of}" in shared.get(address).text
    (stretch,) = shared.get(f"{address}/curve?of={of}&from_s=0&to_s=1&points=2000").json()["stretches"]
    assert stretch["step_s"] == pytest.approx(0.05)
    assert stretch["low"][:20] == pytest.approx(
        [45 + 30 * sin(1.3 * t + 2 * sin(0.17 * t)) for t in TIMES[:20]], abs=0.006
    )  # as sent to 0.001 deg, kept to 0.01


def test_a_comparison_joins_the_study_that_it_names_without_a_line_in_its_table(
    shared: TestClient, shared_settings: Settings
) -> None:
    own = compare(shared, shared_settings, study="Spring").rpartition("/")[2]
    study = f"/studies/{identify_study('Spring')}"
    page = shared.get(study).text

    assert f'src="/validations/{own}/plot.svg"' in page
    assert "RMSE 0.00°, bias 0.00°, 95\u202f% limits 0.0° to 0.0°" in page
    assert '>ours.csv</a> <span class="hint">truth.csv</span>' in page
    assert (
        len(shared.get(f"/api/v1/batches/{identify_study('Spring')}/summary.csv").text.splitlines()) == 1
    )  # the names of the columns
    listed = shared.post(f"{study}/participants", content="file,subject\nours.csv,S1\n")
    assert (listed.json()["changed"], listed.json()["unknown"]) == (0, ["ours.csv"])


def test_the_plot_of_a_comparison_is_a_drawing_of_its_own(shared: TestClient, compared: str) -> None:
    plot = shared.get(f"{compared.removeprefix('/api/v1')}/plot.svg?lang=fr")

    assert plot.headers["content-type"] == "image/svg+xml"
    assert plot.text.startswith("<svg")
    assert "sandbox" in plot.headers["content-security-policy"]


def test_a_comparison_is_no_other_visit_of_a_person(
    client: TestClient, settings: Settings, open_worker: OpenWorker, add_job: AddJob
) -> None:
    compare(client, settings, subject="S1")
    shift = add_job(subject="S1")
    run_next(open_worker(stand_ins.write_report))

    assert "/beside/" not in client.get(f"/analyses/{shift.id}").text


def test_a_failed_comparison_tells_why_on_its_page(client: TestClient, open_worker: OpenWorker) -> None:
    sent = client.post("/validations", files=FILES)
    run_next(open_worker(stand_ins.refuse))

    assert "E-SHORT" in client.get(sent.headers["location"]).text


def test_api_and_command_line_write_the_same_bytes(shared: TestClient, compared: str, tmp_path: Path) -> None:
    for name in ("ours.csv", "truth.csv"):
        (tmp_path / name).write_text(ANGLES)
    command = ["validate", str(tmp_path / "ours.csv"), "--reference", str(tmp_path / "truth.csv"), "-o"]
    CliRunner().invoke(app, [*command, str(tmp_path)])

    sent = shared.get(f"{compared}/validation.json").content

    assert sent == (tmp_path / "validation.json").read_bytes()
