"""Every pattern on foreign text, on a megabyte of its worst text: the work grows with the length."""

import ast
import importlib
import pkgutil
import re
import signal
from collections.abc import Iterator
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

import pytest

from acromion import app, fusion
from acromion.fusion.devices import KNOWN_DEVICES
from acromion.fusion.readers.tables import columns
from acromion.fusion.readers.tables.layout import MAX_LINE_BYTES

kinds, parser = (importlib.import_module(f"re._{name}") for name in ("constants", "parser"))
SIZE = 1 << 20
LIMIT_CPU_S = 30.0
"""A linear pattern takes milliseconds; a quadratic one takes half an hour."""
FOREIGN = (
    "readers",
    "live",
    "angle_files",
    "diary",
    "workbook",
    "documents",
    "devices",
    "conventions",
    "plugins",
)
FORMED = [form % ".," for form in (*columns.DATED_FORMS, columns.COMPACT, columns.BARE, columns.UNDATED)]
CAPPED = {"FIRST_LINE": 400, "PAIR": MAX_LINE_BYTES}
"""Patterns of which the text is shorter: linear, but slow; or cut before."""
MATCHED = {"WITH_COMMA": ["fullmatch"], "WHOLE": ["fullmatch"]}
"""Patterns that ``_holds`` calls."""
REPEATS = (kinds.MAX_REPEAT, kinds.MIN_REPEAT, kinds.POSSESSIVE_REPEAT)
Case = tuple[re.Pattern[Any], str]


def list_modules() -> Iterator[ModuleType]:
    for found in pkgutil.walk_packages(fusion.__path__, "acromion.fusion."):
        if found.name.split(".")[2] in FOREIGN:
            yield importlib.import_module(found.name)
    for found in pkgutil.walk_packages(app.__path__, "acromion.app."):
        if not found.name.endswith("__main__") and ".migrations." not in found.name:
            yield importlib.import_module(found.name)


def list_patterns() -> dict[str, Case]:
    """Return each pattern by its name or place, with the methods by which it is called."""
    cases: dict[str, Case] = {form: (re.compile(form), "search") for form in FORMED}
    for device in KNOWN_DEVICES:
        for text in filter(None, (device.header, device.above)):
            cases[text] = (re.compile(text, re.IGNORECASE), "search")
    for module in list_modules():
        source = Path(str(module.__file__)).read_text()
        for name, value in vars(module).items():
            for one in value.values() if isinstance(value, dict) else [value]:
                if isinstance(one, re.Pattern):
                    called = re.findall(rf"\b{name}\.(\w+)\(", source) or MATCHED.get(name, [])
                    is_anchored = called and set(called) <= {"match", "fullmatch"}
                    method = called[0] if is_anchored else "search"
                    cases.setdefault(f"{name} {one.pattern!r}", (one, method))
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Call) and ast.unparse(node.func).startswith("re.") and node.args:
                given, method = node.args[0], ast.unparse(node.func).removeprefix("re.")
                if isinstance(given, ast.Constant) and isinstance(given.value, str) and method != "compile":
                    method = method if method in ("match", "fullmatch") else "search"
                    cases[f"{module.__name__}:{node.lineno}"] = (re.compile(given.value), method)
    return cases


def holds(items: Any, letter: str) -> bool:
    """Return whether a set of characters contains a letter."""
    is_negated = items[0][0] is kinds.NEGATE
    known = {"DIGIT": letter.isdigit(), "SPACE": letter.isspace(), "WORD": letter.isalnum() or letter == "_"}
    for kind, value in items:
        if kind is kinds.CATEGORY:
            name = str(value).removeprefix("CATEGORY_")
            found = known[name.removeprefix("NOT_")] != name.startswith("NOT_")
        else:
            first, last = value if kind is kinds.RANGE else (value, value)
            found = kind is not kinds.NEGATE and first <= ord(letter) <= last
        if found:
            return not is_negated
    return bool(is_negated)


def write_sample(tree: Any, pieces: list[str]) -> str:
    """Return a short text that a pattern matches; add what its open repetitions repeat, to ``pieces``."""
    text = ""
    for kind, value in tree:
        if kind is kinds.LITERAL:
            text += chr(value)
        elif kind is kinds.IN:
            text += next((chr(code) for code in (*range(32, 127), 9) if holds(value, chr(code))), "")
        elif kind in (kinds.ANY, kinds.NOT_LITERAL):
            text += "a"
        elif kind in REPEATS:
            piece = write_sample(value[2], pieces)
            pieces += [piece, text + piece] if value[1] is kinds.MAXREPEAT else []
            text += piece * value[0]
        elif kind in (kinds.SUBPATTERN, kinds.ATOMIC_GROUP):
            text += write_sample(value[-1] if kind is kinds.SUBPATTERN else value, pieces)
        elif kind is kinds.BRANCH:
            branches = [write_sample(branch, pieces) for branch in value[1]]
            text += branches[0]
    return text


def find_worst(pattern: re.Pattern[Any]) -> set[str]:
    """Return the pieces whose repetition costs the most: those that the pattern itself repeats."""
    pieces: list[str] = []
    write_sample(parser.parse(pattern.pattern, pattern.flags & ~re.UNICODE), pieces)
    return set(filter(None, pieces))


def stop(_number: int, _frame: FrameType | None) -> None:
    raise TimeoutError


def is_linear(pattern: re.Pattern[Any], method: str, size: int) -> bool:
    """Return whether the pattern reads the repetition of each of its pieces within the limit."""
    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, LIMIT_CPU_S)
    try:
        for piece in find_worst(pattern):
            text = piece * (size // len(piece))
            getattr(pattern, method)(text.encode() if isinstance(pattern.pattern, bytes) else text)
    except TimeoutError:
        return False
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)
    return True


def test_every_pattern_is_linear() -> None:
    cases = list_patterns()

    slow = [
        name
        for name, (pattern, method) in cases.items()
        if not is_linear(pattern, method, CAPPED.get(name.split(" ")[0], SIZE))
    ]

    assert len(cases) > 150
    assert slow == []


@pytest.mark.parametrize("text", [r"(\w+)*:", r"\s*\d+$", r"^\W*-{5,}\s*Data", r"<!--.*?-->", r"(a|b)*c:"])
def test_a_quadratic_pattern_is_found(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setattr(f"{__name__}.LIMIT_CPU_S", 0.3)

    assert not is_linear(re.compile(text), "search", SIZE)
