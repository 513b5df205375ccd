"""The classes of standards and methods, added up from the stored bins."""

import numpy as np
import pytest

from acromion.fusion.conventions import CONVENTIONS, Convention
from acromion.fusion.exposure.bins import BIN_EDGES_DEG
from acromion.fusion.exposure.summary import summarise_exposure
from tests.factories import elevate

HELD = elevate(np.repeat([10.0, 40.0, 70.0, 70.0, 130.0], 720), rate_hz=1.0)  # an hour in five holds
BY_KEY = pytest.mark.parametrize("convention", CONVENTIONS, ids=lambda convention: convention.key)


@BY_KEY
def test_the_classes_share_their_edges_with_the_bins_and_hold_all_of_the_time(convention: Convention) -> None:
    classes = summarise_exposure(HELD).conventions[convention.key]

    assert set(convention.edges_deg) <= set(BIN_EDGES_DEG)
    assert sum(part.duration_s for part in classes) == 3600.0


def test_the_classes_of_rula_and_reba_are_cut_at_20_45_and_90_deg() -> None:
    classes = summarise_exposure(HELD).conventions["rula_reba"]

    assert [(part.lower_deg, part.upper_deg, part.percent) for part in classes] == [
        (0, 20, 20.0),
        (20, 45, 20.0),
        (45, 90, 40.0),
        (90, 180, 20.0),
    ]


@BY_KEY
def test_the_range_of_a_class_holds_its_share(convention: Convention) -> None:
    classes = summarise_exposure(HELD, bias_sigma_deg=3.0).conventions[convention.key]

    told = [(part.interval.low, part.percent, part.interval.high) for part in classes if part.interval]
    assert len(told) == len(classes)
    assert all(low <= percent <= high for low, percent, high in told)
