"""What tokens ask for takes turns by token; what a person drops on the page goes first."""

from app.jobs.audit_log import acting
from app.jobs.queue import WayIn
from app.jobs.store import JobFilter, JobStore
from app.jobs.worker import run_next
from app.request import ReportRequest
from app.storage.store import Storage
from tests.app.conftest import OpenBench, on_both_set_ups
from tests.app.stand_ins import write_report


def ask(store: JobStore, storage: Storage, who: str, number: int, way_in: WayIn = "api") -> None:
    upload = storage.open_upload(1_000_000)
    upload.write(f"{who} {number}".encode())
    with acting(who):
        store.add(upload.keep(), ReportRequest(f"{who}-{number}.gt3x"), way_in)


def read_order(store: JobStore, bench: OpenBench, count: int) -> list[str]:
    """Do the jobs one by one; gives whose each was."""
    worker = bench(write_report)
    for _ in range(count):
        assert run_next(worker)
    jobs = sorted(store.find_page(JobFilter(), count), key=lambda job: str(job.ended_at))
    return [job.file_name.partition("-")[0] for job in jobs]


@on_both_set_ups
def test_a_token_that_sends_much_does_not_hold_up_another(
    store: JobStore, storage: Storage, bench: OpenBench
) -> None:
    for number in range(4):
        ask(store, storage, "tok_many", number)
    for number in range(2):
        ask(store, storage, "tok_few", number)

    order = read_order(store, bench, 6)

    assert order == ["tok_many", "tok_few", "tok_many", "tok_few", "tok_many", "tok_many"]


def test_a_drop_on_the_page_goes_before_every_token(
    store: JobStore, storage: Storage, bench: OpenBench
) -> None:
    for number in range(3):
        ask(store, storage, "tok_many", number)
    ask(store, storage, "per_clara", 0, "web")

    assert read_order(store, bench, 4)[0] == "per_clara"
