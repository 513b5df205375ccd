"""The list of behaviours names tests that exist, and all thirty-two behaviours."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "behaviours.md").read_text("utf-8")


def test_every_test_that_the_list_names_exists() -> None:
    files = [*(ROOT / "tests" / "pages").glob("test_*.py"), *(ROOT / "tests" / "app").glob("test_*.py")]
    code = "\n".join(path.read_text("utf-8") for path in files)
    written = set(re.findall(r"^def (test_\w+)", code, re.MULTILINE))

    named = set(re.findall(r"`(test_\w+)`", PAGE))

    assert named - written == set()


def test_the_list_has_every_behaviour_once() -> None:
    numbers = [int(number) for number in re.findall(r"^\| (\d+) \|", PAGE, re.MULTILINE)]

    assert numbers == list(range(1, 33))
