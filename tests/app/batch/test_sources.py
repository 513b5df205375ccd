"""Where the recordings of a run are named, who does which, and where results go."""

import hashlib
import json
from pathlib import Path

import pytest

from acromion.app.batch.folder import (
    MARKER,
    assign_folders,
    find_recordings,
    identify_place,
    plan_tasks,
    read_list,
)
from acromion.app.batch.run import (
    NEED_BYTES,
    Capacity,
    Outcome,
    Shard,
    ShardRecord,
    choose_workers,
    collect_outcomes,
    parse_shard,
)
from acromion.app.errors import UnusableList
from acromion.app.request import ReportRequest


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("b.gt3x", "a.csv", "notes.docx", "deep/c.csv.gz", "out/summary.csv", "diary.csv"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.touch()
    return tmp_path


def test_a_folder_gives_the_recordings_in_and_below_it_but_not_the_results(folder: Path) -> None:
    found = find_recordings([folder], folder / "out", [folder / "diary.csv"])

    assert [path.name for path in found.logs] == ["a.csv", "b.gt3x", "c.csv.gz"]
    assert found.others == 1


def test_files_that_a_computer_puts_beside_recordings_are_left_aside(folder: Path) -> None:
    for name in ("._a.csv", "~$a.csv", "desktop.ini", "deep/.DS_Store"):
        (folder / name).touch()

    found = find_recordings([folder], folder / "out")

    assert [path.name for path in found.logs] == ["a.csv", "b.gt3x", "c.csv.gz", "diary.csv"]
    assert found.others == 5


@pytest.mark.parametrize(
    ("named", "logs"),
    [
        (["notes.docx"], ["notes.docx"]),
        (["b.gt3x", "b.gt3x"], ["b.gt3x"]),
        (["*.gt3x"], ["b.gt3x"]),
        (["*.cwa"], ["*.cwa"]),  # fits nothing and is reported
        (["run[1].csv"], ["run[1].csv"]),  # a file whose name looks like a pattern
    ],
)
def test_what_is_named_is_taken_once_whatever_its_name_and_a_pattern_is_expanded(
    folder: Path, named: list[str], logs: list[str]
) -> None:
    (folder / "run[1].csv").touch()

    found = find_recordings([folder / name for name in named], folder / "out")

    assert found.logs == tuple(folder / name for name in logs)


@pytest.mark.parametrize(
    ("named", "places"),
    [
        ([""], ["a.csv", "b.gt3x", "deep/c.csv.gz", "diary.csv"]),
        (["b.gt3x", "deep"], ["b.gt3x", "deep/c.csv.gz"]),
    ],
)
def test_a_recording_is_told_from_the_folder_that_holds_all_that_was_named(
    folder: Path, named: list[str], places: list[str]
) -> None:
    found = find_recordings([folder / name for name in named], folder / "out")

    assert sorted(found.format_place(log) for log in found.logs) == places


def test_what_is_known_of_a_simulated_recording_is_no_recording(tmp_path: Path) -> None:
    for name in ("shift.gt3x", "truth.parquet", "truth.json"):
        (tmp_path / name).write_bytes(b"x")

    assert find_recordings([tmp_path], tmp_path / "out").logs == (tmp_path / "shift.gt3x",)


def test_a_link_is_told_by_where_it_was_named(folder: Path) -> None:
    (folder / "deep" / "link.gt3x").symlink_to(folder / "b.gt3x")

    found = find_recordings([folder / "deep"], folder / "out")

    assert "link.gt3x" in [found.format_place(log) for log in found.logs]


def test_the_paths_of_a_list_start_from_its_folder(folder: Path) -> None:
    assert read_list('# two\n\nb.gt3x\n"deep/c.csv.gz"\n', folder) == [
        folder / "b.gt3x",
        folder / "deep/c.csv.gz",
    ]


def test_a_line_that_names_nothing_is_refused_with_its_number(folder: Path) -> None:
    with pytest.raises(UnusableList) as caught:
        read_list("b.gt3x\nlost.gt3x\n", folder)

    assert (caught.value.facts["line"], caught.value.facts["value"]) == (2, "lost.gt3x")


@pytest.mark.parametrize(
    ("recordings", "cores", "analyses_in_memory", "expected"),
    [(300, 8, 100, 7), (3, 8, 100, 3), (300, 8, 2, 2), (300, 1, 100, 1), (300, 8, 0, 1)],
)
def test_workers_are_as_many_as_recordings_spare_cores_and_memory_allow(
    recordings: int, cores: int, analyses_in_memory: int, expected: int
) -> None:
    assert choose_workers(recordings, Capacity(cores, analyses_in_memory * NEED_BYTES)) == expected


# Slices of a run: which recordings each does, and what the tables are made of.


ASKED = ReportRequest("", languages=("en",))


def plan(tmp_path: Path, *names: str) -> list:  # type: ignore[type-arg]
    logs = [tmp_path / name for name in names]
    return plan_tasks(logs, tmp_path / "out", ASKED, lambda log: log.name, force=False)


def test_the_slices_hold_every_recording_once_and_differ_by_one_at_most(tmp_path: Path) -> None:
    tasks = plan(tmp_path, "d.csv", "a.csv", "e.csv", "c.csv", "b.csv")

    slices = [[task.name for task in Shard(k, 2).select(tasks)] for k in (1, 2)]

    assert slices == [["a.csv", "c.csv", "e.csv"], ["b.csv", "d.csv"]]
    assert Shard(3, 3).select(tasks[:2]) == []


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "a/b", "1/2/3", "-1/2"])
def test_what_names_no_slice_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r".*"):
        parse_shard(text)


def report_failure(tmp_path: Path, shard: Shard, tasks: list) -> None:  # type: ignore[type-arg]
    """Leave what a slice writes whose first recording failed."""
    record = ShardRecord(tmp_path / "out", shard, tasks, ASKED)
    record.begin()
    record.write([Outcome(tasks[0], code="E-SHORT", facts={"seconds": 4})])


def test_a_failure_is_collected_with_its_facts(tmp_path: Path) -> None:
    report_failure(tmp_path, Shard(1, 1), plan(tmp_path, "a.csv"))

    (outcome,) = collect_outcomes(tmp_path / "out").outcomes

    assert (outcome.code, outcome.facts) == ("E-SHORT", {"seconds": 4})


def test_a_slice_of_another_plan_is_named_even_if_nothing_is_left_to_do(tmp_path: Path) -> None:
    ShardRecord(tmp_path / "out", Shard(2, 2), plan(tmp_path, "a.csv"), ASKED).begin()
    report_failure(tmp_path, Shard(1, 2), plan(tmp_path, "b.csv"))

    collected = collect_outcomes(tmp_path / "out")

    assert (collected.undone, collected.differing) == ((), ("2/2",))


@pytest.mark.parametrize(("before", "planned"), [(Shard(1, 1), 2), (Shard(1, 2), 1)], ids=["number", "plan"])
def test_reports_of_slices_of_another_number_or_plan_do_not_count(
    tmp_path: Path, before: Shard, planned: int
) -> None:
    tasks = plan(tmp_path, "a.csv", "b.csv")
    report_failure(tmp_path, before, tasks[:planned])

    ShardRecord(tmp_path / "out", Shard(2, 2), tasks, ASKED).begin()

    assert [o.code for o in collect_outcomes(tmp_path / "out").outcomes] == ["E-INTERRUPTED"] * 2


# Which folder is whose: told by the marker in it, not by the order in which recordings are found.


@pytest.fixture
def logs(tmp_path: Path) -> tuple[Path, Path]:
    """Two recordings of one name and different bytes."""
    for place in ("p1", "p2"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "arm.gt3x").write_text(place)
    return tmp_path / "p1" / "arm.gt3x", tmp_path / "p2" / "arm.gt3x"


def leave_marker(folder: Path, log: Path, **others: str) -> None:
    """Leave the marker of a finished recording."""
    folder.mkdir(parents=True)
    digest = hashlib.sha256(log.read_bytes()).hexdigest()
    (folder / MARKER).write_text(json.dumps({"place": identify_place(log), "input": digest} | others))


def list_names(logs: tuple[Path, ...], out: Path) -> list[str]:
    return [folder.name for folder in assign_folders(logs, out)]


def test_a_recording_that_changed_in_its_place_keeps_its_folder(
    logs: tuple[Path, Path], tmp_path: Path
) -> None:
    leave_marker(tmp_path / "out" / "arm", logs[0])
    logs[0].write_text("read from the device again")

    assert list_names(logs[:1], tmp_path / "out") == ["arm"]


@pytest.mark.parametrize(
    ("done", "others", "named", "folders"),
    [
        ("", {}, 2, ["arm", "arm-2"]),
        ("arm", {}, 2, ["arm-2", "arm"]),
        ("arm", {"place": "where it lay before"}, 2, ["arm-2", "arm"]),
        ("arm-2", {}, 2, ["arm", "arm-2"]),
        ("arm", {}, 1, ["arm-2"]),
    ],
    ids=["numbered", "kept", "moved", "the one before has none", "of another run"],
)
def test_recordings_of_one_stem_are_numbered_and_the_second_keeps_the_folder_it_has(
    logs: tuple[Path, Path], tmp_path: Path, done: str, others: dict[str, str], named: int, folders: list[str]
) -> None:
    if done:
        leave_marker(tmp_path / "out" / done, logs[1], **others)

    assert list_names(logs[:named], tmp_path / "out") == folders


@pytest.mark.parametrize(
    ("name", "folder"),
    [("Summary.csv", "Summary.csv-2"), ("shards", "shards_"), ("profiles", "profiles_")],
)
def test_no_recording_is_named_as_a_table_or_a_folder_of_ours(tmp_path: Path, name: str, folder: str) -> None:
    assert list_names((tmp_path / f"{name}.gt3x",), tmp_path / "out") == [folder]


def list_places(out: Path, *places: str) -> list[str]:
    """Return the folders of recordings at these paths of the input, relative to the results."""
    logs = [out.parent / "study" / place for place in places]
    return [path.relative_to(out).as_posix() for path in assign_folders(logs, out, places)]


@pytest.mark.parametrize(
    ("places", "folders"),
    [
        (("siteA/p01.gt3x", "siteB/p01.gt3x"), ["siteA/p01", "siteB/p01"]),
        (("a/arm.gt3x", "a/arm.csv"), ["a/arm", "a/arm-2"]),
        (("siteA.gt3x", "siteA/p01.gt3x"), ["siteA-2", "siteA/p01"]),
        (("SiteA/p01.gt3x", "sitea/p01.gt3x"), ["SiteA/p01", "sitea/p01-2"]),
        (
            ("v1/arm.gt3x", "shards/arm.gt3x", "run.json/arm.gt3x"),
            ["v1_/arm", "shards_/arm", "run.json_/arm"],
        ),
        (("../arm.gt3x",), ["_/arm"]),
    ],
    ids=["mirrored", "of one name", "not inside another", "on any disk", "none of ours", "never outside"],
)
def test_the_folders_mirror_the_paths_of_the_input(
    tmp_path: Path, places: tuple[str, ...], folders: list[str]
) -> None:
    assert list_places(tmp_path / "out", *places) == folders


def test_a_folder_of_a_run_before_folders_were_mirrored_is_kept(tmp_path: Path) -> None:
    log = tmp_path / "study" / "siteA" / "p01.gt3x"
    log.parent.mkdir(parents=True)
    log.write_text("bytes")
    leave_marker(tmp_path / "out" / "p01", log)

    assert list_places(tmp_path / "out", "siteA/p01.gt3x", "siteB/p01.gt3x") == ["p01", "siteB/p01"]


def test_a_recording_does_not_go_into_the_folder_of_another_that_is_done(tmp_path: Path) -> None:
    log = tmp_path / "study" / "siteA.gt3x"
    log.parent.mkdir()
    log.write_text("bytes")
    leave_marker(tmp_path / "out" / "siteA", log)

    assert list_places(tmp_path / "out", "siteA.gt3x", "siteA/p01.gt3x") == ["siteA", "siteA_/p01"]
