"""The answer as plain text."""

from collections.abc import Sequence

from app.report.parts import Pair, Report
from app.report.wording import Language, fill, load_wording


def tell_in_brief(report: Report) -> bytes:
    """Write the answer as a few lines of plain text, to paste into a record."""
    quality = " ".join(filter(None, (report.verdict.label, report.verdict.reason, report.pose_caution)))
    lines = (*report.sentences, quality, report.brief)
    return ("\n".join(lines) + "\n").encode("utf-8")


def sign_off(header: Sequence[Pair], footer: str, language: Language) -> str:
    """Write the last of these lines for a report of two: whose and when, which report, and what it is not."""
    label = load_wording(language)["label"]
    told = ", ".join(fill(label["brief_fact"], {"name": pair.name, "value": pair.value}) for pair in header)
    return fill(label["brief_two"], {"header": told, "footer": footer})
