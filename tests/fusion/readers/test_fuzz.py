"""Whatever is done to a recording, it is refused by name, or read with every second accounted for.

The long round is ``python -m benchmarks.fuzz``.
"""

from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.fuzz.outcome import read_checked, read_damaged
from benchmarks.fuzz.seeds import SEEDS, wrap


@pytest.mark.parametrize("name", SEEDS)
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(random=st.randoms(use_true_random=False))
def test_a_damaged_file_is_refused_by_name_or_accounts_for_every_second(name: str, random: Random) -> None:
    outcome = read_damaged(name, random)

    assert outcome == "read" or outcome.startswith("E-")


@pytest.mark.parametrize("name", SEEDS)
def test_a_sound_file_of_each_format_is_read(name: str) -> None:
    assert read_checked(name, wrap(name, SEEDS[name])) == "read"


@pytest.mark.parametrize(
    ("name", "seed"),
    [("shimmer", 447), ("shimmer", 3383), ("shimmer of four lines", 1473), ("Parquet", 2297)],
)
def test_damage_that_once_broke_the_reader_is_refused_or_read(name: str, seed: int) -> None:
    outcome = read_damaged(name, Random(seed))

    assert outcome == "read" or outcome.startswith("E-")
