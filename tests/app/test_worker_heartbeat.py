"""When a worker is silent for too long, by the running time of its pool."""

import os

import pytest

from app.jobs.processes.lease import START_TIMES, SilenceCount, read_heartbeat


def hear(count: SilenceCount, beats: str) -> list[bool]:
    """Count a tick for each sign: "1" for a beat, "0" for none."""
    return [count.is_too_long(heard=beat == "1") for beat in beats]


def test_a_worker_that_beats_is_left_alone() -> None:
    assert not any(hear(SilenceCount(2), "1001001"))


def test_a_worker_silent_for_more_ticks_than_the_limit_is_found() -> None:
    assert hear(SilenceCount(2), "1000") == [False, False, False, True]


def test_a_worker_is_given_longer_until_its_first_beat() -> None:
    assert hear(SilenceCount(2), "0" * (2 * START_TIMES + 1)) == [False] * (2 * START_TIMES) + [True]


@pytest.mark.parametrize(("sent", "heard"), [(b"", False), (b"..", True)])
def test_a_beat_is_heard_once(sent: bytes, heard: bool) -> None:
    ours, theirs = os.pipe()
    os.set_blocking(ours, False)
    os.write(theirs, sent)

    assert (read_heartbeat(ours), read_heartbeat(ours)) == (heard, False)
    os.close(ours)
    os.close(theirs)
