"""The cache of decoded recordings: the same samples again, or nothing."""

from collections.abc import Callable
from dataclasses import fields, replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from acromion.app.analysis.run import make_report
from acromion.app.request import ReportRequest
from acromion.app.store.decoded import DecodedCache, hash_entry_key
from acromion.app.store.folder import KnownFiles
from acromion.fusion.recording import QualityFlag, Recording, Span
from acromion.fusion.simulation import write_recordings
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
        excluded=(Span(0, 1_000_000, "docked"),),
        flags=(QualityFlag("W-GAP", 2, 0.5, 1.0, 2.0, {"n": 3}, ((1.0, 2.0),)),),
        understood={"layout": "made"},
        pose_windows_s=((1.0, 6.0),),
        arm_axis="-y",
        pose_held="start",
    )


def list_entries(cache: DecodedCache) -> list[Path]:
    return sorted(cache.folder.iterdir())


@pytest.mark.parametrize("zone", [timezone(timedelta(hours=-5)), None], ids=["zone", "no zone"])
def test_what_was_kept_is_found_again(
    cache: DecodedCache, recording: Recording, zone: timezone | None
) -> None:
    recording = replace(recording, start=datetime(2026, 3, 2, 7, tzinfo=zone))
    assert cache.find(KEY) is None

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
    small = DecodedCache(tmp_path / "small", 1000, OWNER)
    small.keep(KEY, recording)
    assert list_entries(small) == []


def test_another_revision_or_another_reading_has_another_key() -> None:
    keys = {hash_entry_key("a", "", "1"), hash_entry_key("a", "", "2"), hash_entry_key("a", "rate 500", "1")}

    assert len(keys) == 3


def test_the_report_is_the_same_with_and_without_the_cache_until_the_file_changes(
    tmp_path: Path, cache: DecodedCache
) -> None:
    log, other = (write_recordings(tmp_path / str(seed), "gt9x", 0.02, seed)[0] for seed in (1, 2))
    bodies: list[bytes] = []

    for kept in (None, cache, cache, cache):
        if len(bodies) == 3:
            log.write_bytes(other.read_bytes())
        make_report(log, ReportRequest("a.gt3x", kinds=()), tmp_path, known=KnownFiles(cache=kept))
        bodies.append((tmp_path / "results.json").read_bytes())

    assert bodies[0] == bodies[1] == bodies[2] != bodies[3]
