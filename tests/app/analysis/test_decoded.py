"""The cache of decoded recordings: the same samples again, or nothing."""

from collections.abc import Callable
from dataclasses import fields, replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from app.request import ReportRequest
from app.roads.analyse import make_report
from app.storage.decoded import DecodedCache, hash_entry_key
from app.storage.store import KnownLogs
from fusion.recording import QualityFlag, Recording, Span
from fusion.simulation import write_recordings
from tests.factories import hold

KEY = hash_entry_key("00" * 32, "", "0123")
OWNER = "rec_0123456789abcdef"
MIB = 1 << 20


@pytest.fixture
def cache(tmp_path: Path) -> DecodedCache:
    return DecodedCache(tmp_path / "cache", 100 * MIB, OWNER)


@pytest.fixture
def recording() -> Recording:
    """Ten seconds with everything that a recording can say of itself."""
    made = hold((0, 5), (90, 5)).recording
    return replace(
        made,
        segments=(replace(made.segments[0], bridged=((3, 5),)),),
        start=datetime(2026, 3, 2, 7, tzinfo=timezone(timedelta(hours=-5))),
        excluded=(Span(0, 1_000_000, "docked"),),
        flags=(QualityFlag("W-GAP", 2, 0.5, 1.0, 2.0, {"n": 3}, ((1.0, 2.0),)),),
        understood={"layout": "made"},
        pose_windows_s=((1.0, 6.0),),
        arm_axis="-y",
        pose_held="start",
    )


def list_entries(cache: DecodedCache) -> list[Path]:
    return sorted(cache.folder.iterdir())


def test_what_was_kept_is_found_again(cache: DecodedCache, recording: Recording) -> None:
    cache.keep(KEY, recording)

    found = cache.find(KEY)

    assert found is not None
    assert list_facts(found) == list_facts(recording)
    np.testing.assert_array_equal(found.segments[0].acc_g, recording.segments[0].acc_g)
    np.testing.assert_array_equal(found.segments[0].gyr_dps, recording.segments[0].gyr_dps)
    assert found.segments[0].bridged == ((3, 5),)


def list_facts(recording: Recording) -> list[object]:
    """Everything but the samples: a recording holds arrays and has no equality of its own."""
    return [getattr(recording, field.name) for field in fields(recording) if field.name != "segments"]


def test_what_was_never_kept_is_not_found(cache: DecodedCache) -> None:
    assert cache.find(KEY) is None


@pytest.mark.parametrize(
    "damage",
    [
        lambda body: body[:-9],
        lambda body: body[:2000] + b"\xff" + body[2001:],
        lambda _: b"{}\n",
        lambda _: b"",
    ],
    ids=["cut", "one byte", "other JSON", "empty"],
)
def test_a_damaged_entry_is_removed_and_not_believed(
    cache: DecodedCache, recording: Recording, damage: Callable[[bytes], bytes]
) -> None:
    cache.keep(KEY, recording)
    (entry,) = list_entries(cache)
    entry.write_bytes(damage(entry.read_bytes()))

    assert cache.find(KEY) is None
    assert list_entries(cache) == []


def test_the_cache_stays_within_its_bounds(tmp_path: Path, recording: Recording) -> None:
    size_bytes = recording.segments[0].acc_g.nbytes * 2
    cache = DecodedCache(tmp_path / "cache", 3 * size_bytes, OWNER)

    for number in range(5):
        cache.keep(hash_entry_key(str(number), "", ""), recording)

    assert len(list_entries(cache)) == 2
    assert cache.find(hash_entry_key("4", "", "")) is not None


def test_a_recording_larger_than_the_cache_is_not_kept(tmp_path: Path, recording: Recording) -> None:
    cache = DecodedCache(tmp_path / "cache", 1000, OWNER)

    cache.keep(KEY, recording)

    assert list_entries(cache) == []


def test_another_revision_or_another_reading_has_another_key() -> None:
    keys = {hash_entry_key("a", "", "1"), hash_entry_key("a", "", "2"), hash_entry_key("a", "rate 500", "1")}

    assert len(keys) == 3


def test_the_report_is_the_same_with_and_without_the_cache(tmp_path: Path, cache: DecodedCache) -> None:
    log = write_recordings(tmp_path, "gt9x", 0.02, 1)[0]
    request = ReportRequest(log.name, kinds=())
    bodies: list[bytes] = []

    for kept in (None, cache, cache):
        out = tmp_path / f"out{len(bodies)}"
        out.mkdir()
        make_report(log, request, out, known=KnownLogs(cache=kept))
        bodies.append((out / "results.json").read_bytes())

    assert len(list_entries(cache)) == 1
    assert bodies[0] == bodies[1] == bodies[2]


def test_a_change_of_the_file_is_never_hidden_by_the_cache(tmp_path: Path, cache: DecodedCache) -> None:
    first, second = (write_recordings(tmp_path / str(seed), "gt9x", 0.02, seed)[0] for seed in (1, 2))
    out = tmp_path / "out"
    out.mkdir()
    make_report(first, ReportRequest("a.gt3x", kinds=()), out, known=KnownLogs(cache=cache))
    before = (out / "results.json").read_bytes()

    first.write_bytes(second.read_bytes())
    make_report(first, ReportRequest("a.gt3x", kinds=()), out, known=KnownLogs(cache=cache))

    assert (out / "results.json").read_bytes() != before


def test_a_clock_without_a_zone_stays_without(cache: DecodedCache, recording: Recording) -> None:
    naive = replace(recording, start=datetime(2026, 3, 2, 7, tzinfo=UTC).replace(tzinfo=None))
    cache.keep(KEY, naive)

    found = cache.find(KEY)

    assert found is not None
    assert found.start == naive.start
