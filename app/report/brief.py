"""The answer as plain text."""

from app.report.parts import Report
from app.report.wording import fill


def tell_in_brief(report: Report) -> bytes:
    """Write the answer as five lines of plain text, to paste into a record."""
    facts = {pair.name: pair.value for pair in report.header}
    subject, date, arm, device, _ = facts.values()
    told = {"subject": subject, "date": date, "arm": arm, "device": device, "footer": report.footer}
    quality = " ".join(filter(None, (report.verdict.label, report.verdict.reason, report.pose_caution)))
    lines = (*report.sentences, quality, fill(report.words["brief"], told))
    return ("\n".join(lines) + "\n").encode("utf-8")
