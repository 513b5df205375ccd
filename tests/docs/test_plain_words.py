"""Plain words: no idiom that a reader has to read twice, and docs that stay short."""

import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import ROOT

IDIOMS = {
    "a docstring starts with Return, Raise, Parse ...": r'"""(?:Give|Tell|Say|Let)s?\b',
    "no noun clause as subject": r'(?:^|[.:;] |""")(?:What|Whose|Whoever|Whatever) (?![^.?]*\?)',
    "name the thing: those that, one whose": r"\b(?:those|ones?) (?:that|which|who|whose)\b|\bthat which\b",
    "again": r"\banew\b|\bafresh\b",
    "a separate X": r"\bof (?:its|their|his|her|your|our|my|one's) own\b",
    "also": r", too\b(?! (?:many|much|long|short|few|large|small|little))",
    "is not a": r"(?<!there )(?<!There )\b(?:is|are|was|were) no (?!longer\b|more\b|less\b|other\b)\w+",
    "if, not where": (
        r"\b(?:where|wherever) (?:nobody|somebody|none|nothing|no|not|there (?:is|are|was)|"
        r"it (?:is|was|has|can|does)|they (?:are|were|have)|one is|neither|both|only)\b|"
        r"\b(?:even|only|also|except|save|but) where\b"
    ),
    "because, not for": r"[,;:] for (?:it|they|he|she|there|nothing|nobody|what|whoever)\b",
    "contain, have": r"\b(?:bears?|bore|borne)\b",
    "is, not stands": (
        r"\b(?:stands?|stood) "
        r"(?:in|on|beside|behind|under|above|below|there|before|for|at|as|alone|with)\b"
    ),
    "is, not lies": r"\b(?:lies|lie|lay) (?:in|on|beside|behind|there|before|at|between|under)\b",
    "a person, anyone": r"\b(?:somebody|whoever|whosoever|whatever|wherever)\b|\bwhose (?=is |was |it )",
    "see, show, ask": (
        r"\b(?:is|are|was|were|be|been) (?:told|said|called so|held to)\b "
        r"(?:of|about|again|whose|who|so|that|what|how|for)"
    ),
    "correct, reset": r"\b(?:put|set|sets|puts) (?:right|aside|anew|forth|straight)\b",
    "import, remove": r"\b(?:take|takes|took|taken|taking) (?:in|out|away|apart)\b",
    "restored, available": r"\b(?:be|is|are|was) had\b|\bhad back\b",
    "old words": (
        r"\b(?:hence|thus|herein|thereof|therein|thereby|whence|whereby|nought|naught|shall|oneself|lest|ere|"
        r"forthwith|thereafter|yonder|amid|upon|unto|for ever|in vain|at large|so to speak|as it were)\b"
    ),
    "no dangling which": r"\bof (?:which|whom) (?:so|it|the|a|no|only|each)\b|\bin which (?:nothing|no|it)\b",
    "nothing in, no": r"\b(?:nothing|none|something|anything) of (?:its|it|them|that|this|what|the)\b",
    "your own": r"\bof (?:theirs|ours|yours|hers|mine)\b",
    "sign in, audit log": (
        r"\b(?:audit trail|the trail|log in|logs in|logged in|logging in)\b|"
        r"(?<![/\"'`_.#-])\blogins?\b(?![\"'`_])"
    ),
    "name the thing: what it, what stands": (
        r"\bwhat (?:it|they|he|she|one|somebody|nobody|stands|lies|holds|belongs|remains|comes|goes)\b"
    ),
    "contain, not hold": r"\b(?:holds?|held) (?:its|no|nothing|what|true|so|good)\b",
    "know": r"\b(?:knows?|knew) (?:of|no|nothing)\b",
    "if, as long as": r"\b(?:so far as|so long as|insofar|inasmuch|but for|save for|nothing but|none but)\b",
    "say the verb again": r"\b(?:does|do|did|done|says|said|is|are) so\b",
}
"""What to write, and the pattern of what not to write."""

ALLOWED: dict[str, int] = {}
"""Files with idioms that are right there, and how many: quotations, an option's name."""

WORDS = {"README.md": 700, "CHANGELOG.md": 600, "CONTRIBUTING.md": 300}
"""The most words a page of the top folder may have."""

DECISIONS, DECISION_WORDS = 12, 250
"""The most decisions, and the most words of each."""

DOCS_WORDS = 30_000
"""The most written words in ``docs/``; generated reference is not counted."""

GENERATED = "Made from the code: `"
"""How the first line of a generated page begins."""


def list_texts() -> list[Path]:
    """Return the files whose words people read: code, docs, the English wording, templates and scripts."""
    code = [path for room in ("app", "fusion", "benchmarks") for path in (ROOT / room).rglob("*.py")]
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    shown = [path for end in ("html", "j2", "js", "css") for path in (ROOT / "templates").rglob(f"*.{end}")]
    scripts = (ROOT / "app").rglob("*.js")
    return sorted([*code, *pages, *shown, *scripts, ROOT / "app" / "report" / "words" / "en.toml"])


def read_prose(path: Path) -> Iterator[tuple[int, str]]:
    """Return the lines with their numbers; of Python only comments and strings."""
    text = path.read_text("utf-8")
    if path.suffix != ".py":
        yield from enumerate(text.split("\n"), 1)
        return
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (tokenize.COMMENT, tokenize.STRING):
            yield from enumerate(token.string.split("\n"), token.start[0])


def find_idioms(path: Path) -> list[str]:
    """Return ``line: what to write: the line`` for each idiom of a file."""
    return [
        f"{number}: {cure}: {line.strip()}"
        for number, line in read_prose(path)
        for cure, pattern in IDIOMS.items()
        for _ in re.finditer(pattern, line)
    ]


def count_idioms() -> int:
    """Return how many idioms code, docs and wording have."""
    return sum(len(find_idioms(path)) for path in list_texts())


def list_written() -> list[Path]:
    """Return the pages of ``docs/`` that people write."""
    pages = sorted((ROOT / "docs").rglob("*.md"))
    return [path for path in pages if not path.read_text("utf-8").startswith(GENERATED)]


def count_words(*pages: Path) -> int:
    """Return how many words pages have, in tables and code too; without a page, all that are written."""
    texts = (path.read_text("utf-8") for path in pages or list_written())
    return sum(bool(re.search(r"[^\W_]", word)) for text in texts for word in text.split())


@pytest.mark.parametrize("path", list_texts(), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_text_has_no_idiom(path: Path) -> None:
    found = find_idioms(path)
    allowed = ALLOWED.get(path.relative_to(ROOT).as_posix(), 0)

    assert (len(found), found) == (allowed, found)


def test_a_file_with_idioms_that_are_allowed_has_them() -> None:
    assert [name for name in ALLOWED if not (ROOT / name).is_file()] == []


def test_the_docs_are_short() -> None:
    assert count_words() <= DOCS_WORDS


@pytest.mark.parametrize(("name", "most"), WORDS.items())
def test_a_page_of_the_top_folder_is_short(name: str, most: int) -> None:
    assert count_words(ROOT / name) <= most


def test_the_decisions_are_few_and_one_page_each() -> None:
    decisions = sorted((ROOT / "docs" / "decisions").glob("0*.md"))

    assert len(decisions) <= DECISIONS
    assert [path.name for path in decisions if count_words(path) > DECISION_WORDS] == []


def test_a_table_of_words_counts_and_its_bars_do_not(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Two words\n\n| a | 1.5 |\n|---|---:|\n", "utf-8")

    assert count_words(page) == 4


def test_an_idiom_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("It is tried anew.\nRetry the job.\n", "utf-8")

    assert find_idioms(page) == ["1: again: It is tried anew."]
