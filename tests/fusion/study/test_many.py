"""Many recordings in several processes."""

import pickle
from pathlib import Path

import pytest

from acromion.fusion import AnalysedFile, AnalysisSettings, FusionError, analyse, analyse_many
from acromion.fusion.errors import NoPair
from acromion.fusion.simulation import simulate_shift, write_shift


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two recordings, a file that is none, and a path that leads nowhere."""
    folder = tmp_path_factory.mktemp("many")
    made = [write_shift(folder, simulate_shift("lsm9ds1", 0.05, seed=seed))[0] for seed in (1, 2)]
    (folder / "empty.csv").write_bytes(b"")
    return [*made, folder / "empty.csv", folder / "nowhere.csv"]


@pytest.fixture(scope="module")
def in_two_processes(paths: list[Path]) -> dict[str, AnalysedFile]:
    return {one.path.name: one for one in analyse_many(paths, workers=2)}


def test_results_of_two_processes_are_those_of_one_recording_analysed_alone(
    paths: list[Path], in_two_processes: dict[str, AnalysedFile]
) -> None:
    for path in paths[:2]:
        found = in_two_processes[path.name].analysis
        assert found is not None
        assert found.exposure.bins == analyse(path).exposure.bins


def test_an_unusable_recording_comes_with_its_error_and_stops_no_other(
    in_two_processes: dict[str, AnalysedFile],
) -> None:
    empty, nowhere = in_two_processes["empty.csv"], in_two_processes["nowhere.csv"]

    assert isinstance(empty.error, FusionError)
    assert (empty.analysis, empty.error.code) == (None, "E-EMPTY")
    assert isinstance(nowhere.error, FileNotFoundError)
    assert sum(one.error is None for one in in_two_processes.values()) == 2


def test_an_analysis_of_many_has_no_samples(in_two_processes: dict[str, AnalysedFile]) -> None:
    found = in_two_processes["shift_seed1.csv"].analysis

    assert found is not None
    assert found.recording.segments == ()
    assert "0.05 h analysed" in repr(found)


def test_progress_is_called_after_each_recording_with_the_number_done_and_of_all(paths: list[Path]) -> None:
    called: list[tuple[int, int, str]] = []

    found = analyse_many(
        paths[2:],
        workers=1,
        on_progress=lambda done, total, one: called.append((done, total, one.path.name)),
    )

    assert len(list(found)) == 2
    assert called == [(1, 2, "empty.csv"), (2, 2, "nowhere.csv")]


def test_a_function_chooses_the_settings_of_each_recording(paths: list[Path]) -> None:
    chosen = {paths[0]: AnalysisSettings(pose="side-lean"), paths[1]: AnalysisSettings()}

    found = [one.analysis for one in analyse_many(paths[:2], chosen.__getitem__, workers=1)]

    assert [one.settings.pose for one in found if one] == ["side-lean", "n-pose"]


@pytest.mark.parametrize("kind", [str, Path])
def test_a_single_path_is_one_recording(paths: list[Path], kind: type) -> None:
    assert [one.path for one in analyse_many(kind(paths[3]), workers=1)] == [paths[3]]


def test_fewer_than_one_worker_is_refused_before_anything_is_read(paths: list[Path]) -> None:
    with pytest.raises(ValueError, match="workers: 0; allowed: 1 or more"):
        analyse_many(paths, workers=0)


def test_an_error_keeps_its_kind_and_facts_in_another_process() -> None:
    error = NoPair(why="columns", list="a,b")

    copied = pickle.loads(pickle.dumps(error))

    assert type(copied) is NoPair
    assert (copied.code, copied.facts) == (error.code, error.facts)
