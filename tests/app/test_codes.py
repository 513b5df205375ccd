"""Every code is declared once, is given somewhere, and has words; what it tells is declared with it."""

import re
from pathlib import Path

import pytest

from app.report.words.wording import LANGUAGES, Language, load_wording
from fusion.caveats import Caveat

ROOT = Path(__file__).resolve().parents[2]
SOURCES = {path: path.read_text() for folder in ("app", "fusion") for path in (ROOT / folder).rglob("*.py")}
NEVER_GIVEN = {Caveat.FEW_DAYS}
"""Its words are on the page of help, and nothing gives it."""


def test_every_caveat_is_given_somewhere() -> None:
    source = " ".join(text for path, text in SOURCES.items() if path.name != "caveats.py")

    assert (
        set(Caveat) - {Caveat[name] for name in re.findall(r"\bCaveat\.([A-Z_]+)\b", source)} == NEVER_GIVEN
    )


def test_no_other_file_holds_the_code_of_a_caveat() -> None:
    holding = [path.name for path, text in SOURCES.items() if re.search(r"[\"']W-[A-Z-]+[\"']", text)]

    assert holding == ["caveats.py"]


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_caveats_with_words_are_those_declared(language: Language) -> None:
    assert set(load_wording(language)["flag"]) == set(Caveat)


@pytest.mark.parametrize("caveat", Caveat)
def test_the_words_of_a_caveat_name_only_facts_declared(caveat: Caveat) -> None:
    words = load_wording("en")["flag"][caveat]

    assert set(re.findall(r"{(\w+)", words["title"] + words["detail"])) <= set(caveat.facts)


def test_a_caveats_member_is_named_as_its_code() -> None:
    assert [f"W-{caveat.name}".replace("_", "-") for caveat in Caveat] == list(Caveat)
