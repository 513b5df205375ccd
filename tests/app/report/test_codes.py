"""Every code is declared once, is given somewhere, and has words; what it tells is declared with it."""

import ast
import re
from collections.abc import Iterator
from functools import cache

import pytest

from acromion.app.errors import CANCELLED, NO_RECORDING, UNREADABLE_PATH, list_refusals
from acromion.app.report.words.wording import LANGUAGES, Language, load_wording
from acromion.fusion.caveats import Caveat
from acromion.fusion.errors import PLACE
from benchmarks.codes import find_own_facts
from tests import ROOT

SOURCES = {path: path.read_text() for folder in ("app", "fusion") for path in (ROOT / folder).rglob("*.py")}
REFUSALS = list_refusals()
NEVER_GIVEN = {Caveat.FEW_DAYS}
"""Its words are on the page of help, and nothing gives it."""


@cache
def list_calls() -> tuple[ast.Call, ...]:
    trees = map(ast.parse, SOURCES.values())
    return tuple(node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Call))


def test_every_caveat_is_given_somewhere() -> None:
    source = " ".join(text for path, text in SOURCES.items() if path.name != "caveats.py")

    given = {Caveat[name] for name in re.findall(r"\bCaveat\.([A-Z_]+)\b", source)}
    assert set(Caveat) - given == NEVER_GIVEN


def test_no_other_file_holds_the_code_of_a_caveat() -> None:
    holding = [path.name for path, text in SOURCES.items() if re.search(r"[\"']W-[A-Z-]+[\"']", text)]

    assert holding == ["caveats.py"]


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_caveats_with_words_are_those_declared(language: Language) -> None:
    assert set(load_wording(language)["flag"]) == set(Caveat)


def test_the_words_of_a_code_name_only_declared_facts() -> None:
    declared: dict[str, set[str]] = {caveat: {*caveat.fact_meanings, "lasted"} for caveat in Caveat}
    declared |= {str(kind.code): {*find_own_facts(kind), *PLACE} for kind in REFUSALS}
    words = load_wording("en")["flag"] | load_wording("en")["problem"]

    named = {code: set(re.findall(r"{(\w+)", " ".join(map(str, words[code].values())))) for code in declared}

    assert [code for code in declared if named[code] - declared[code]] == []


def test_a_caveat_is_given_with_facts_declared() -> None:
    undeclared = [
        (caveat, name)
        for call in list_calls()
        if (caveat := name_caveat(call)) is not None
        for name in list_fact_names(call)
        if name not in caveat.fact_meanings
    ]

    assert undeclared == []


def name_caveat(call: ast.Call) -> Caveat | None:
    """Return the caveat of a call such as ``QualityFlag(Caveat.GAP, ...)``."""
    first = call.args[0] if call.args else None
    is_named = isinstance(first, ast.Attribute) and ast.unparse(first.value) == "Caveat"
    return Caveat[first.attr] if is_named and isinstance(first, ast.Attribute) else None


def list_fact_names(call: ast.Call) -> Iterator[str]:
    """Return the facts written out in the call: the keys of a mapping, or the keywords of ``flag_spans``."""
    for value in (*call.args, *(keyword.value for keyword in call.keywords)):
        if isinstance(value, ast.Dict):
            yield from (str(ast.literal_eval(key)) for key in value.keys if key is not None)
    if ast.unparse(call.func) == "flag_spans":
        yield from (str(keyword.arg) for keyword in call.keywords)


def test_a_caveats_member_is_named_as_its_code() -> None:
    assert [f"W-{caveat.name}".replace("_", "-") for caveat in Caveat] == list(Caveat)


def test_no_two_refusals_share_a_code_and_none_has_that_of_another_outcome() -> None:
    codes = [kind.code for kind in REFUSALS]

    assert len(set(codes)) == len(codes)
    assert {UNREADABLE_PATH, NO_RECORDING, CANCELLED}.isdisjoint(codes)


def test_only_the_declarations_hold_the_code_of_a_refusal() -> None:
    holding = {
        path.relative_to(ROOT).as_posix()
        for path, text in SOURCES.items()
        if re.search(r"[\"']E-[A-Z0-9-]+[\"']", text)
    }

    # one that another module declared would be in no list before that module is imported
    assert holding == {"app/errors.py", "fusion/errors.py"}


def test_a_refusal_is_raised_with_facts_declared() -> None:
    declared = {kind.__name__: {*find_own_facts(kind), *PLACE} for kind in REFUSALS}
    undeclared = [
        (call.func.id, keyword.arg)
        for call in list_calls()
        if isinstance(call.func, ast.Name) and call.func.id in declared
        for keyword in call.keywords
        if keyword.arg and keyword.arg not in declared[call.func.id]
    ]

    assert undeclared == []
