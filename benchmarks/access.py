"""Measure the cost of a sign-in, and whether its duration reveals if a name is known.

python -m benchmarks.access
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

from acromion.app.accounts.accounts import AccountStore
from acromion.app.accounts.passwords import hash_password, verify_password
from acromion.app.accounts.sign_in import Caller, SignIn
from acromion.app.errors import LoginRefused
from acromion.app.settings import Settings

PAIRS = 100
PASSWORD, WRONG = "seven green bicycles", "nine blue bicycles"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(data_dir=Path(folder) / "data")
        settings.data_dir.mkdir()
        sign_in = SignIn(AccountStore(settings), settings)
        add_people(sign_in)
        kept = hash_password(PASSWORD)
        one_hash_s = median(time_it(lambda: verify_password(kept, WRONG)) for _ in range(20))
        known_s, unknown_s = measure_names(sign_in)
    difference = abs(known_s - unknown_s) / one_hash_s
    print(f"one hash: {1000 * one_hash_s:.1f} ms")
    print(f"known name, wrong password: {1000 * known_s:.1f} ms (median of {PAIRS})")
    print(f"unknown name: {1000 * unknown_s:.1f} ms (median of {PAIRS})")
    print(f"difference: {100 * difference:.1f} % of one hash (goal: less than 5 %)")


def add_people(sign_in: SignIn) -> None:
    """Add one person per attempt, so that no rate limit applies."""
    kept = hash_password(PASSWORD)
    for number in range(PAIRS + 1):
        person = sign_in.accounts.add_person(f"known{number}", "Somebody", ["clinician"])
        sign_in.credentials.set_password(person.id, kept)


def measure_names(sign_in: SignIn) -> tuple[float, float]:
    """Return the median times for known and unknown names, tried alternately."""
    known_s: list[float] = []
    unknown_s: list[float] = []
    for number in range(PAIRS + 1):
        pair = [(known_s, f"known{number}"), (unknown_s, f"nobody{number}")]
        for place, (times, name) in enumerate(reversed(pair) if number % 2 else pair):
            caller = Caller(f"198.{number}.{place}.1", "")
            times.append(time_it(lambda name=name, caller=caller: fail(sign_in, name, caller)))  # type: ignore[misc]
    return median(known_s[1:]), median(unknown_s[1:])


def fail(sign_in: SignIn, name: str, caller: Caller) -> None:
    try:
        sign_in.submit_password(name, WRONG, caller)
    except LoginRefused:
        return
    raise AssertionError(name)


def time_it(act: Callable[[], object]) -> float:
    began_s = time.perf_counter()
    act()
    return time.perf_counter() - began_s


if __name__ == "__main__":
    main()
