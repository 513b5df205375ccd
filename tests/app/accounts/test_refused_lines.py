"""How many lines refusals leave: guesses are seen, and the trail does not grow by them without bound."""

import threading

from app.api.middleware.readings import (
    MOST_COUNTED,
    MOST_KNOWN,
    MOST_LINES,
    MOST_OF_STRANGERS,
    WINDOW_S,
    KnownReadings,
    RefusedLines,
)
from tests.app.accounts.conftest import Clock


def take_many(lines: RefusedLines, asker: str, number: int, *, is_stranger: bool = False) -> list[str]:
    return [lines.take(asker, is_stranger=is_stranger) for _ in range(number)]


def test_after_the_most_one_line_says_that_there_were_more() -> None:
    taken = take_many(RefusedLines(), "per_1", MOST_LINES + 3)

    assert taken == ["line"] * MOST_LINES + ["more", "none", "none"]


def test_the_next_window_begins_anew(clock: Clock) -> None:
    lines = RefusedLines(clock)
    take_many(lines, "per_1", MOST_LINES + 3)

    clock.wait(WINDOW_S)

    assert lines.take("per_1", is_stranger=False) == "line"


def test_many_addresses_together_leave_no_more_than_all_strangers_may() -> None:
    lines = RefusedLines()

    taken = [lines.take(f"192.0.2.{number}", is_stranger=True) for number in range(2 * MOST_OF_STRANGERS)]

    assert taken == ["line"] * MOST_OF_STRANGERS + ["more"] + ["none"] * (MOST_OF_STRANGERS - 1)


def test_strangers_use_up_nothing_of_who_is_logged_in() -> None:
    lines = RefusedLines()
    for number in range(2 * MOST_OF_STRANGERS):
        lines.take(f"192.0.2.{number}", is_stranger=True)

    assert lines.take("per_1", is_stranger=False) == "line"


def test_many_addresses_take_no_memory_without_bound_and_free_no_stranger() -> None:
    lines = RefusedLines()

    taken = [lines.take(f"host{number}", is_stranger=True) for number in range(2 * MOST_COUNTED)]

    assert len(lines._counts) <= MOST_COUNTED
    assert taken.count("line") == MOST_OF_STRANGERS


def test_many_at_once_are_counted_one_by_one() -> None:
    lines, taken = RefusedLines(), []

    def ask() -> None:
        taken.extend(take_many(lines, "per_1", MOST_LINES))

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert (taken.count("line"), taken.count("more")) == (MOST_LINES, 1)


def test_many_readings_take_no_memory_without_bound() -> None:
    known = KnownReadings()

    for number in range(MOST_KNOWN + 10):
        known.begin((str(number),))

    assert len(known._at_s) == MOST_KNOWN
    assert not known.is_new((str(MOST_KNOWN),))
