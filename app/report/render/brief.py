"""The answer as a few lines of plain text."""

from collections.abc import Sequence

from app.report.model import Pair, Report
from app.report.words.wording import Language, fill, load_wording


def format_brief(report: Report) -> bytes:
    """Write the answer as a few lines of plain text, to paste into a record.

    The pose comes first if it has to be named before the figures mean much.
    """
    quality = " ".join(filter(None, (report.verdict.label, report.verdict.reason, report.pose_caution)))
    pose = " ".join(filter(None, (report.needs_pose, report.pose_state)))
    first, last = (pose, "") if report.needs_pose else ("", pose)
    lines = (first, *report.sentences, quality, last, report.brief)
    return ("\n".join(filter(None, lines)) + "\n").encode("utf-8")


def format_signature(header: Sequence[Pair], footer: str, language: Language) -> str:
    """Write the last line of the answer for a report of two: subject, date, report, and "not a diagnosis"."""
    label = load_wording(language)["label"]
    told = ", ".join(fill(label["brief_fact"], {"name": pair.name, "value": pair.value}) for pair in header)
    return fill(label["brief_two"], {"header": told, "footer": footer})
