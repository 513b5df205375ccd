"""Every published value beside the measured one, with what it is and whom it is of."""

from __future__ import annotations

from app.report.findings import Findings
from app.report.numbers import NARROW, NONE, format_number
from app.report.parts import Section, Table
from app.report.wording import Language, Words, fill
from fusion.references import STATEMENTS, Compared, Reference, compare_with_references


def build_published(findings: Findings, words: Words, language: Language) -> Section:
    """Give all references as a table, and what studies of groups found in words."""
    entry = words["published"]
    compared = compare_with_references(findings.exposure, findings.quality.verdict)
    rows = tuple(_tell_row(item, words, language) for item in compared)
    table = Table(
        entry["caption"], tuple(entry["columns"]), rows, prose=True, note=_tell_why(compared, words)
    )
    paragraphs = (*(entry["statement"][key] for key in STATEMENTS), entry["groups"])
    return Section("published", entry["title"], (" ".join(paragraphs),), tables=(table,))


def _tell_row(item: Compared, words: Words, language: Language) -> tuple[str, ...]:
    said, reference = words["reference"][item.reference.key], item.reference
    measured = NONE if item.reason else _tell(item.measured or 0.0, reference, language, 1)
    return said["name"], said["source"], _tell_published(reference, language), measured


def _tell_published(reference: Reference, language: Language) -> str:
    decimals = 0 if reference.high >= 10 else 1
    high = _tell(reference.high, reference, language, decimals)
    if reference.low is None:
        return f"≤\u00a0{high}"
    return f"{format_number(reference.low, decimals, language)}–{high}"


def _tell(value: float, reference: Reference, language: Language, decimals: int) -> str:
    sign = {"percent": f"{NARROW}%", "deg": "°", "dps": "°/s", "h": f"{NARROW}h"}[reference.unit]
    return f"{format_number(value, 0 if reference.unit == 'deg' else decimals, language)}{sign}"


def _tell_why(compared: tuple[Compared, ...], words: Words) -> str:
    """Say why nothing is set beside them, where all lack it for one reason."""
    reasons = {item.reason for item in compared} - {"not computed"}
    if not reasons or "" in reasons:
        return ""
    why = words["comparison"]["reason"][sorted(reasons)[0]]
    return fill(words["comparison"]["does_not_apply"], {"reason": why})
