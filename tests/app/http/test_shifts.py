"""A week that is cut into its shifts on the page: each has its report, and they are days of one person."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import update

from acromion.app.http.pages.recording.day import START, DayClock
from acromion.app.http.pages.recording.finish import read_shifts
from acromion.app.library.database.tables import analyses
from acromion.app.queue.worker import WorkerContext, open_worker_context, run_next
from acromion.app.settings import Settings
from acromion.fusion.errors import UnusableShift
from tests.app.conftest import serving
from tests.simulated_week import WITHOUT_POSE, write_week

MINUTES = 8
"""At this length no stillness near the start of the day without a pose looks like one."""
DATES = tuple(f"2026-03-0{day}" for day in (2, 3, 4, 5, 6))
WISHES = {"subject": "W1", "side": "right", "pose_held": "start"}


@dataclass(frozen=True, slots=True)
class Cut:
    """The week on a server: the analysis of the whole, those of its shifts, and of the days given singly."""

    client: TestClient
    worker: WorkerContext
    recording: str
    file: Path
    whole: str
    shifts: tuple[str, ...]
    days: tuple[str, ...]


def send(client: TestClient, file: Path, **wishes: str) -> dict[str, Any]:
    answer = client.post(
        "/api/v1/analyze", params={"file_name": file.name} | wishes, content=file.read_bytes()
    )
    assert answer.status_code == 202, answer.text
    view: dict[str, Any] = answer.json()
    return view


def find_shifts(client: TestClient, recording: str) -> list[dict[str, Any]]:
    """Return the analyses of the shifts that count, in their order."""
    listed = client.get("/api/v1/analyses", params={"recording_id": recording}).json()["items"]
    every = (client.get(f"/api/v1/analyses/{one['id']}").json() for one in listed)
    mine = [one for one in every if one["settings"]["shift"] and not one["replaced_by"]]
    return sorted(mine, key=lambda one: str(one["settings"]["shift"]))


def read_results(client: TestClient, analysis: str) -> dict[str, Any]:
    results: dict[str, Any] = client.get(f"/api/v1/analyses/{analysis}/results.json").json()
    return results


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cut]:
    folder = tmp_path_factory.mktemp("week")
    week = write_week(folder, minutes=MINUTES)
    settings = Settings(data_dir=folder / "data", min_free_bytes=0)
    with serving(settings) as client:
        worker = open_worker_context(settings, None)
        whole = send(client, week.path, **WISHES)
        days = [send(client, day, **WISHES | {"subject": "W2"})["id"] for day in week.days]
        while run_next(worker):
            pass
        place, hours = (
            f"/recordings/{whole['recording_id']}/finish",
            {"hours_start": "7h", "hours_end": "07:08"},
        )
        form = {"analysis": whole["id"], "subject": "W1", "side": "right", "cut": "hours", **hours}
        answer = client.post(place, data=form)
        assert answer.status_code == 303, answer.text
        while run_next(worker):
            pass
        shifts = find_shifts(client, whole["recording_id"])
        assert answer.headers["location"] == f"/analyses/{shifts[0]['id']}"
        ids = tuple(one["id"] for one in shifts)
        yield Cut(client, worker, whole["recording_id"], week.path, whole["id"], ids, tuple(days))
        worker.store.close()


def test_the_hours_of_the_card_make_one_analysis_for_each_day(cut: Cut) -> None:
    starts = [read_results(cut.client, shift)["recording"]["start"][:10] for shift in cut.shifts]

    assert tuple(starts) == DATES


@pytest.mark.parametrize("place", range(5))
def test_a_shift_has_the_figures_of_the_day_given_singly(cut: Cut, place: int) -> None:
    shift, day = (read_results(cut.client, ids[place]) for ids in (cut.shifts, cut.days))

    for part in ("exposure", "time", "calibration", "quality"):
        assert shift[part] == day[part]


def test_each_shift_has_its_pose_and_the_day_without_one_is_not_good(cut: Cut) -> None:
    every = [read_results(cut.client, shift) for shift in cut.shifts]

    states = [results["calibration"]["state"] for results in every]
    assert states.pop(WITHOUT_POSE) in {"assumed", "none"}
    assert set(states) == {"held_at_start"}
    assert every[WITHOUT_POSE]["quality"]["verdict"] != "good"


def test_the_list_has_one_row_for_each_shift_instead_of_the_whole(cut: Cut) -> None:
    page = cut.client.get("/rows").text

    shown = re.findall(rf'id="of-{cut.recording}\w*".*?href="/analyses/(an_\w+)', page, re.DOTALL)
    assert shown == list(reversed(cut.shifts))


def test_the_shifts_are_days_of_their_person(cut: Cut) -> None:
    page = cut.client.get("/person", params={"subject": "W1"}).text

    assert [date for date in DATES if f">{date}<" in page or date in page] == list(DATES)
    assert all(shift in page for shift in cut.shifts)
    assert cut.whole not in page


def test_the_report_of_several_days_takes_each_shift(cut: Cut) -> None:
    page = cut.client.get("/days", params={"subject": "W1"}).text

    assert len(re.findall(r'name="analysis"[^>]*checked', page)) == len(DATES)


def test_a_shift_leads_to_the_others_and_to_the_card_that_cut_them(cut: Cut) -> None:
    page = cut.client.get(f"/analyses/{cut.shifts[1]}", params={"lang": "en"}).text

    assert "Shift 2 of 5 of this recording" in page
    assert all(f'href="/analyses/{shift}"' in page for shift in cut.shifts if shift != cut.shifts[1])
    assert f"/recordings/{cut.recording}/finish?analysis={cut.whole}" in page


def test_the_whole_leads_to_the_first_shift(cut: Cut) -> None:
    answer = cut.client.get(f"/analyses/{cut.whole}")

    assert (answer.status_code, answer.headers["location"]) == (303, f"/analyses/{cut.shifts[0]}")


def test_the_same_answer_again_keeps_the_analyses(cut: Cut) -> None:
    hours = {"hours_start": "07:00", "hours_end": "07:08"}
    form = {"analysis": cut.whole, "subject": "W1", "side": "right", "cut": "hours", **hours}

    answer = cut.client.post(f"/recordings/{cut.recording}/finish", data=form)

    assert answer.headers["location"] == f"/analyses/{cut.shifts[0]}"
    assert tuple(one["id"] for one in find_shifts(cut.client, cut.recording)) == cut.shifts


def test_a_batch_keeps_a_finished_analysis_that_the_page_cuts_later(cut: Cut) -> None:
    items = [{"recording_id": cut.recording, "settings": {"axis": "y", "subject": "W1"}}]
    batch = cut.client.post("/api/v1/batches", json={"items": items}).json()
    while run_next(cut.worker):
        pass
    form = {"analysis": cut.whole, "subject": "W1", "side": "right", "cut": "hours"}

    cut.client.post(
        f"/recordings/{cut.recording}/finish", data=form | {"hours_start": "07:00", "hours_end": "07:08"}
    )

    rows = cut.client.get(f"/api/v1/batches/{batch['id']}/summary.csv").text.splitlines()
    assert len(rows) == 2
    assert ",axis," in rows[1]


def test_the_same_hours_by_rest_are_the_same_analyses(cut: Cut) -> None:
    settings = {**WISHES, "shift": "07:00-07:08"}

    answer = cut.client.post(
        "/api/v1/analyses", json={"recording_ids": [cut.recording], "settings": settings}
    )

    assert tuple(item["id"] for item in answer.json()["items"]) == cut.shifts


@pytest.mark.parametrize("shift", ["diary", "22:00-23:00"])
def test_a_cut_without_a_shift_is_refused_by_rest_and_queues_nothing(cut: Cut, shift: str) -> None:
    before = cut.client.get("/api/v1/analyses").json()["items"]

    answer = cut.client.post(
        "/api/v1/analyses", json={"recording_ids": [cut.recording], "settings": {"shift": shift}}
    )

    assert (answer.status_code, answer.json()["code"]) == (422, "E-SHIFT")
    assert cut.client.get("/api/v1/analyses").json()["items"] == before


@pytest.mark.parametrize(
    ("lines", "named"),
    [
        ((("2026-03-02 07:00", "2026-03-02 07:08"), ("2026-03-02 07:07", "2026-03-03 07:08")), "07:07"),
        ((("2026-03-02 07:00", ""),), "?"),
        ((("2026-03-09 07:00", "2026-03-09 07:08"),), "2026-03-09"),
        ((("", ""),), "1 … 100"),
    ],
    ids=["overlap", "no end", "another week", "none"],
)
def test_lines_that_are_no_shifts_are_refused_with_the_time(
    cut: Cut, lines: tuple[tuple[str, str], ...], named: str
) -> None:
    form: dict[str, Any] = {"analysis": cut.whole, "subject": "W1", "side": "right", "cut": "lines"}
    form |= {"shift_start": [start for start, _ in lines], "shift_end": [end for _, end in lines]}

    answer = cut.client.post(f"/recordings/{cut.recording}/finish", data=form)

    assert answer.status_code == 422
    assert named in answer.text
    assert tuple(one["id"] for one in find_shifts(cut.client, cut.recording)) == cut.shifts


def test_hours_of_a_day_on_which_the_device_was_off_make_no_shift() -> None:
    clock = DayClock(datetime(2026, 3, 2, 6), 3 * 86_400_000_000)  # noqa: DTZ001  the device's clock
    form = {"cut": ["hours"], "hours_start": ["07:00"], "hours_end": ["15:00"]}
    covered_us = ((0, 50_000_000_000), (172_800_000_000, 259_200_000_000))

    shifts = read_shifts(form, clock, covered_us)

    assert [window.start.day for window in shifts or ()] == [2, 4]


def test_hours_that_the_clocks_repeat_on_a_day_are_refused(cut: Cut) -> None:
    clock = DayClock(datetime(2026, 10, 24, 12, tzinfo=ZoneInfo("Europe/Paris")), 172_800_000_000)
    form = {"cut": ["hours"], "hours_start": ["02:30"], "hours_end": ["08:00"]}

    with pytest.raises(UnusableShift) as refusal:
        read_shifts(form, clock)

    assert refusal.value.facts["value"] == "2026-10-25 02:30:00"


def test_a_correction_of_one_shift_changes_no_other(cut: Cut) -> None:
    form = {"analysis": cut.shifts[WITHOUT_POSE], "subject": "W1", "side": "left"}

    answer = cut.client.post(f"/recordings/{cut.recording}/finish", data=form)

    assert answer.status_code == 303
    listed = find_shifts(cut.client, cut.recording)
    sides = {one["settings"]["side"] for one in listed if one["id"] not in cut.shifts}
    assert (len(listed), sides) == (len(DATES) + 1, {"left"})


def test_whoever_states_that_the_sensor_stayed_applies_the_first_pose_to_every_shift(cut: Cut) -> None:
    hours = {"hours_start": "07:00", "hours_end": "07:07"}
    form = {"analysis": cut.whole, "subject": "W1", "side": "right", "cut": "hours", **hours}

    cut.client.post(f"/recordings/{cut.recording}/finish", data=form | {"not_removed": "1"})

    while run_next(cut.worker):
        pass

    every = [
        read_results(cut.client, one["id"])["calibration"] for one in find_shifts(cut.client, cut.recording)
    ]
    assert (len(every), every[0]["state"], every[WITHOUT_POSE]["state"]) == (5, "held_at_start", "carried")
    assert every[WITHOUT_POSE]["sigma_deg"] == every[0]["sigma_deg"]


def test_a_recording_that_is_too_long_as_a_whole_can_still_be_cut(cut: Cut) -> None:
    again = send(cut.client, cut.file, again="true", **WISHES | {"subject": "W3"})
    failed = {"state": "failed", "problem_code": "E-MEMORY", "problem_facts": "{}"}
    cut.worker.store.run(update(analyses).where(analyses.c.id == again["id"]).values(failed))
    place = f"/recordings/{again['recording_id']}/finish"

    page = cut.client.get(place, params={"lang": "en", "analysis": again["id"]}).text
    hours = {"hours_start": "07:00", "hours_end": "07:08"}
    answer = cut.client.post(place, data={"analysis": again["id"], "subject": "W3", "cut": "hours", **hours})

    assert "Which shifts does the recording contain?" in page
    assert answer.status_code == 303
    shifts = [one["settings"]["shift"] for one in find_shifts(cut.client, again["recording_id"])]
    assert {shift[:10] for shift in shifts} == set(DATES)


def test_a_pose_that_is_confirmed_after_the_cut_applies_to_later_shifts_and_survives_another_cut(
    cut: Cut,
) -> None:
    whole = send(cut.client, cut.file, again="true", subject="W4", side="right")
    place = f"/recordings/{whole['recording_id']}/finish"
    lines = {"shift_start": ["2026-03-02 07:00", "2026-03-04 07:00"]}
    lines |= {"shift_end": ["2026-03-02 07:08", "2026-03-04 07:08"]}
    form = {"subject": "W4", "side": "right", "cut": "lines", "not_removed": "1", **lines}

    def work() -> list[dict[str, Any]]:
        """Return the newest analysis of each shift."""
        while run_next(cut.worker):
            pass
        every = find_shifts(cut.client, whole["recording_id"])
        newest = {one["settings"]["shift"]: one for one in sorted(every, key=lambda one: one["created_at"])}
        return [newest[shift] for shift in sorted(newest)]

    work()
    cut.client.post(place, data=form | {"analysis": whole["id"]})
    first, later = work()
    cut.client.post(place, data={"analysis": first["id"], "subject": "W4", "side": "right", "choice": START})
    confirmed, carried = work()

    states = [read_results(cut.client, one["id"])["calibration"]["state"] for one in (confirmed, carried)]
    assert states == ["held_at_start", "carried"]
    assert {first["id"], later["id"]}.isdisjoint((confirmed["id"], carried["id"]))
    cut.client.post(place, data=form | {"analysis": whole["id"]})
    assert [one["id"] for one in work()] == [confirmed["id"], carried["id"]]


def test_a_typed_shift_without_samples_is_refused_and_changes_nothing(cut: Cut) -> None:
    before = find_shifts(cut.client, cut.recording)
    form = {"analysis": cut.whole, "subject": "W1", "side": "right", "cut": "lines"}
    form |= {"shift_start": "2026-03-02 12:00", "shift_end": "2026-03-02 13:00"}

    answer = cut.client.post(f"/recordings/{cut.recording}/finish?lang=en", data=form)

    assert answer.status_code == 422
    assert "it has no samples in these hours" in answer.text
    assert find_shifts(cut.client, cut.recording) == before
