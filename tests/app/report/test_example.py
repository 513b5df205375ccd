"""The example that is shown without an analysis: good data, in both languages, as today's engine reads it."""

import io
import re

import pypdf
import pytest
from fastapi.testclient import TestClient

from acromion.app.http.pages.help import find_example
from acromion.app.report.export.results import decode_results
from acromion.app.report.findings import Findings
from benchmarks.example import analyse_example

THRESHOLDS_DEG = (30, 60, 90)


@pytest.fixture(scope="module")
def shipped() -> Findings:
    return decode_results(find_example().read_bytes()).findings


def read_shares(findings: Findings) -> list[float]:
    above = {each.threshold_deg: each.percent for each in findings.exposure.time_above}
    return [above[threshold] for threshold in THRESHOLDS_DEG]


def test_todays_engine_gives_the_figures_that_are_shipped(shipped: Findings) -> None:
    today = analyse_example()

    assert read_shares(today) == pytest.approx(read_shares(shipped), abs=0.005)
    assert [entry.count for entry in today.exposure.entries] == [
        entry.count for entry in shipped.exposure.entries
    ]
    assert today.time == shipped.time
    assert [flag.code for flag in today.quality.flags] == [flag.code for flag in shipped.quality.flags]


def test_the_example_is_a_whole_shift_of_good_data(shipped: Findings) -> None:
    assert shipped.time.recorded_us == 8 * 3600 * 1_000_000
    assert shipped.quality.verdict == "good"


@pytest.mark.parametrize("language", ["en", "fr"])
def test_an_empty_library_leads_to_the_example(client: TestClient, language: str) -> None:
    assert 'href="/example"' in client.get("/", params={"lang": language}).text
    assert client.get("/example", params={"lang": language}).status_code == 200


def test_the_example_says_that_nobody_was_measured(client: TestClient) -> None:
    assert "No person was measured." in client.get("/example?lang=en").text


def test_page_and_pdf_of_the_example_give_the_same_share(client: TestClient, shipped: Findings) -> None:
    told = f"{read_shares(shipped)[1]:.1f} %"
    pdf = client.get("/example/report.pdf?lang=en").content
    first = pypdf.PdfReader(io.BytesIO(pdf)).pages[0].extract_text()

    assert told in re.sub(r"\s", " ", client.get("/example?lang=en").text)
    assert told in re.sub(r"\s", " ", first)
    assert told in re.sub(r"\s", " ", client.get("/example/report.html?lang=en").text)
