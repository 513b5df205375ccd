"""The answer as a few lines of plain text."""

from app.report.model import Report


def format_brief(report: Report) -> bytes:
    """Write the answer as a few lines of plain text, to paste into a record.

    The pose comes first if it has to be named before the figures mean much.
    """
    quality = " ".join(filter(None, (report.verdict.label, report.verdict.reason, report.pose_caution)))
    pose = " ".join(filter(None, (report.needs_pose, report.pose_state)))
    first, last = (pose, "") if report.needs_pose else ("", pose)
    lines = (first, *report.sentences, quality, last, report.brief)
    return ("\n".join(filter(None, lines)) + "\n").encode("utf-8")
