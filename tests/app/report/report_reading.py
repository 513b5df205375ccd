"""Parts of a report by their names, for tests."""

import re

from acromion.app.report.findings import Findings
from acromion.app.report.model import Section, Table
from acromion.app.report.single.report import Report, build_report
from acromion.app.report.words.wording import Language
from acromion.fusion.exposure.types import Exposure
from tests.app.analysis_factory import make_analysis, make_subject


def report_of(
    *, analysis: Findings | None = None, exposure: Exposure | None = None, language: Language = "en"
) -> Report:
    return build_report(analysis or make_analysis(exposure=exposure), make_subject(), language)


def plain(text: str) -> str:
    """Make every no-break space a plain one."""
    return re.sub(r"[\u202f\u00a0]", " ", text).replace("’", "'")


def section_of(report: Report, key: str) -> Section:
    return next(section for section in report.sections if section.key == key)


def table_of(report: Report, key: str, caption: str) -> Table:
    return next(table for table in section_of(report, key).tables if caption in table.caption)
