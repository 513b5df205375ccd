"""Recordings without a result, as rows of ``problems.csv``."""

from collections.abc import Mapping

from app.report.messages import Fact, describe_problem
from app.report.origin import Origin
from app.report.tables import Row
from app.report.wording import Language

PROBLEM_COLUMNS = ["file", "code", "title", "detail", "fix", "path", "subject", "side"]


def tell_problem(origin: Origin, code: str, facts: Mapping[str, Fact], language: Language) -> Row:
    """Give the row of one recording."""
    problem = describe_problem(code, facts, language)
    words = {"title": problem.title, "detail": problem.detail, "fix": problem.fix}
    who = {"path": origin.path, "subject": origin.subject, "side": origin.side}
    return {"file": origin.file_name, "code": code, **words, **who}
