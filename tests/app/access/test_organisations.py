"""An organisation has a place of its own: nothing of one is seen from another."""

from collections.abc import Iterator

import pytest

from app.jobs.job import Job
from app.jobs.store import JobStore
from app.main import prepare_house
from app.request import ReportRequest
from app.services import Offices, Services, open_services
from app.settings import Settings
from tests.app.conftest import on_both_set_ups


@pytest.fixture
def offices(settings: Settings) -> Iterator[Offices]:
    opened = Offices(open_services(settings), prepare_house)
    yield opened
    opened.close()


def add_job(services: Services, content: bytes = b"recording") -> Job:
    upload = services.storage.open_upload(1_000_000)
    upload.write(content)
    return services.store.add(upload.keep(), ReportRequest("shift.gt3x"))


@on_both_set_ups
def test_the_same_bytes_in_two_organisations_are_no_duplicates(offices: Offices) -> None:
    add_job(offices.own)
    other = offices.find("org_other")

    job = add_job(other)

    assert other.recordings.get(job.recording_id).duplicate_of is None


def test_the_folder_of_an_organisation_lies_apart(offices: Offices, settings: Settings) -> None:
    add_job(offices.find("org_other"))

    assert list((settings.data_dir / "recordings").iterdir()) == []


def test_what_was_there_belongs_to_own(settings: Settings) -> None:
    assert settings.for_organisation("own") == settings


def test_an_organisations_database_is_its_own(offices: Offices, settings: Settings) -> None:
    offices.find("org_other")

    store = JobStore(settings.for_organisation("org_other"))
    assert store.find_recordings() == frozenset()
    store.close()
