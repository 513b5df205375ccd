"""Upload slots: one person's uploads never take the last quarter."""

from contextlib import ExitStack

import pytest

from acromion.app.errors import TooMany
from acromion.app.store.incoming import UploadSlots


def test_one_person_holds_at_most_three_quarters_of_the_slots() -> None:
    slots = UploadSlots(32)

    with ExitStack() as held:
        for _ in range(24):
            held.enter_context(slots.take("clara"))

        with pytest.raises(TooMany):
            held.enter_context(slots.take("clara"))
        for number in range(8):
            held.enter_context(slots.take(f"person {number}"))
        with pytest.raises(TooMany):
            held.enter_context(slots.take("dora"))


def test_a_slot_is_free_again_after_an_upload_that_failed() -> None:
    slots = UploadSlots(1)

    with pytest.raises(ZeroDivisionError), slots.take("clara"):
        _ = 1 / 0

    with slots.take("clara"):
        assert slots.taken.total() == 1
