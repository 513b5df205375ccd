"""What a page says where a stored file is damaged or missing, and what a person can do about it there."""

from collections.abc import Mapping
from dataclasses import dataclass

from app.api.services import Services
from app.errors import NotHere, ResultDamaged, StoreDamaged
from app.jobs.job import Job
from app.jobs.renewing import can_renew
from app.report.messages import Fact, Problem, describe_problem
from app.report.wording import Language
from app.storage import StoredRecording, seems_whole


@dataclass(frozen=True, slots=True)
class Damage:
    """A damaged analysis: ``again`` is the one that replaces it, "" where there is none.

    ``source`` says that the recording is damaged, too: then analysing again cannot help.
    """

    id: str
    name: str
    words: Problem
    code: str
    again: str
    source: Problem | None


def show_damage(services: Services, facts: Mapping[str, Fact], language: Language) -> Damage | None:
    """Show what ResultDamaged tells; None where the analysis is gone by now."""
    try:
        job = services.store.get(str(facts.get("analysis", "")))
    except NotHere:
        return None
    code = ResultDamaged.code
    words = describe_problem(code, {"name": facts["name"]}, language)
    is_source_whole = job.replaced_by is not None or can_renew(services.store, services.storage, job)
    source = None if is_source_whole else describe_problem(StoreDamaged.code, {}, language)
    return Damage(job.id, job.file_name, words, code, job.replaced_by or "", source)


def describe_source(services: Services, job: Job, language: Language) -> Problem | None:
    """Say that the recording of an analysis is damaged or missing; None where it seems whole."""
    if seems_whole(services.storage, StoredRecording(job.recording_id, job.sha256, job.size_bytes)):
        return None
    return describe_problem(StoreDamaged.code, {}, language)
