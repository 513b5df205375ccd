"""Recordings without a result, as rows of ``problems.csv``."""

from collections.abc import Mapping

from app.report.messages import Fact, describe_problem
from app.report.tables import Row
from app.report.wording import Language

PROBLEM_COLUMNS = ["file", "code", "title", "detail", "fix"]


def tell_problem(file_name: str, code: str, facts: Mapping[str, Fact], language: Language) -> Row:
    """Give the row of one recording."""
    problem = describe_problem(code, facts, language)
    words = {"title": problem.title, "detail": problem.detail, "fix": problem.fix}
    return {"file": file_name, "code": code, **words}
