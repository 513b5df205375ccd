"""What an analysis may be set beside: the other arm of the same day, other days of the same person."""

from dataclasses import dataclass

from app.api.services import Services
from app.jobs.job import Job
from app.jobs.library import Entry, Library
from app.report.wording import Language, fill, load_wording

DAY = 10  # characters of an ISO date
MOST_TRUNKS = 50


@dataclass(frozen=True, slots=True)
class Offer:
    """A link to a page of two."""

    address: str
    words: str


def list_offers(services: Services, job: Job, start: str, language: Language) -> tuple[Offer, ...]:
    """Offer a pair where arm and day fit, else a comparison, the earlier first."""
    others = Library(services.store.reader).list_others(job)
    return tuple(_offer(job, start, other, language) for other in others)


def list_trunks(services: Services, first: Job, second: Job, start: str) -> tuple[Job, ...]:
    """Give the recordings that may be of the trunk: same person, same day, neither arm stated."""
    others = Library(services.store.reader).list_others(first, MOST_TRUNKS)
    return tuple(
        other.job
        for other in others
        if other.job.request.side is None
        and other.job.recording_id != second.recording_id
        and ((other.answer.start if other.answer else None) or "")[:DAY] == start[:DAY]
    )


def _offer(job: Job, start: str, other: Entry, language: Language) -> Offer:
    other_start = (other.answer.start if other.answer else None) or ""
    facts = {"name": other.job.file_name, "when": other_start[:16].replace("T", " ")}
    words = load_wording(language, "beside_page")
    if _are_arms(job, start, other.job, other_start):
        first, second = (job, other.job) if job.request.side == "left" else (other.job, job)
        return Offer(f"/beside/pair?first={first.id}&second={second.id}", fill(words["with_pair"], facts))
    first, second = (job, other.job) if start <= other_start else (other.job, job)
    return Offer(f"/beside/compare?first={first.id}&second={second.id}", fill(words["with_compare"], facts))


def _are_arms(job: Job, start: str, other: Job, other_start: str) -> bool:
    sides = {job.request.side, other.request.side}
    return sides == {"left", "right"} and start[:DAY] == other_start[:DAY]
