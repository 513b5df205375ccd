"""The job of a recording on the forms of its page."""

import pytest

from acromion.app.errors import BadParameter
from acromion.app.http.pages.recording.day import read_whose
from acromion.app.request import ReportRequest

STATED = ReportRequest("a.csv", job_title="Carpenter", isco_code="7115")


def test_the_form_states_the_job() -> None:
    asked = read_whose(ReportRequest("a.csv"), {"job_title": [" Carpenter "], "isco_code": ["7115"]})

    assert (asked.job_title, asked.isco_code) == ("Carpenter", "7115")


def test_an_empty_field_clears_the_job() -> None:
    asked = read_whose(STATED, {"job_title": [""], "isco_code": [""]})

    assert (asked.job_title, asked.isco_code) == ("", "")


def test_a_form_without_the_fields_keeps_the_job() -> None:
    assert read_whose(STATED, {}) == STATED


@pytest.mark.parametrize("code", ["71150", "71a", "7.1", "٧١١٥"])
def test_a_code_of_isco_has_at_most_four_digits(code: str) -> None:
    with pytest.raises(BadParameter):
        read_whose(STATED, {"isco_code": [code]})
