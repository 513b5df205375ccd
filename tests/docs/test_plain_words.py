"""Plain words: no idiom that a reader has to read twice, and docs that stay short."""

import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

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

DOCS_WORDS = 30_000
"""The most written words in ``docs/``; generated reference is not counted."""


def list_texts() -> list[Path]:
    """Return the files whose words people read: code, docs, the English wording, templates and scripts."""
    code = [path for room in ("app", "fusion", "benchmarks") for path in (ROOT / room).rglob("*.py")]
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    shown = [path for end in ("html", "j2", "js", "css") for path in (ROOT / "templates").rglob(f"*.{end}")]
    scripts = (ROOT / "app").rglob("*.js")
    return sorted([*code, *pages, *shown, *scripts, ROOT / "app" / "report" / "words" / "en.toml"])


def read_prose(path: Path) -> Iterator[tuple[int, str]]:
    """Return the lines with their numbers; Python without code, TOML without keys and placeholders."""
    text = path.read_text("utf-8")
    if path.suffix == ".toml":
        text = re.sub(r"^[\w.\-\"{}]+ = |\{\w+\}", "", text, flags=re.MULTILINE)
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
