"""From a study to its sheet, in the layout of the source paper's Table 1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from app.report.agreement.study_tables import find_paper_row
from app.report.charts.agreement import draw_study
from app.report.model import AgreementReport, Note, Pair, Section, Table
from app.report.words.numbers import NONE, format_angle, format_number
from app.report.words.subject import Software, clean_text, cut_text
from app.report.words.wording import Language, Words, fill, find_device_name, load_wording

if TYPE_CHECKING:
    from fusion.agreement import AgreementCell, AgreementEntry, Limits
    from fusion.agreement.agreement_study import Spread

STATISTICS = ("r", "rmse_deg", "mean_absolute_error_deg")
DECIMALS = {"r": 3, "rmse_deg": 2, "mean_absolute_error_deg": 2}
LONGEST_TASK = 32


@dataclass(frozen=True, slots=True)
class StudyFacts:
    """What the sheet says beside the figures."""

    method: str
    pose: str
    software: Software
    report_id: str


def build_study(
    entries: Sequence[AgreementEntry],
    cells: Sequence[AgreementCell],
    problems: Sequence[tuple[str, str, str]],
    facts: StudyFacts,
    language: Language,
) -> AgreementReport:
    """Turn a study into all that a template may use; ``problems`` are (file, what was wrong, code)."""
    words, common = load_wording(language, "agreement"), load_wording(language)
    entry, devices = words["study"], list(dict.fromkeys(cell.device for cell in cells))
    told = {"version": facts.software.version, "id": facts.report_id}
    people = len(dict.fromkeys(e.person for e in entries))
    names = [find_device_name(common, device) for device in devices]
    tasks = len(dict.fromkeys(cell.task for cell in cells))
    counts = {
        "people": str(people),
        "tasks": str(tasks),
        "devices": ", ".join(names),
        "problems": str(len(problems)),
    }
    return AgreementReport(
        language=language,
        title=entry["title"],
        subtitle=words["subtitle"],
        header=tuple(Pair(entry["header"][name], counts[name]) for name in entry["header"]),
        sentences=_tell_study(cells, devices, words, language),
        main=(tabulate_table_1(cells, devices, words, language),),
        figures=tuple(draw_study(entries, cells, device, words, language) for device in devices),
        limits=Note(words["limits"]["title"], tuple(words["limits"]["paragraphs"])),
        sections=_build_sections(entries, cells, problems, words, language),
        report_id=facts.report_id,
        footer=fill(common["heading"]["footer"], told),
        made_of=None,
        words={**common["label"], **words["label"], "attachment": entry["attachment"]},
    )


def _tell_study(
    cells: Sequence[AgreementCell], devices: Sequence[str], words: Words, language: Language
) -> tuple[str, ...]:
    """Say for each device between what means the error lies."""
    sentences = []
    for device in devices:
        means = [cell.rmse_deg.mean for cell in cells if cell.device == device]
        known = [mean for mean in means if isfinite(mean)] or [float("nan")]
        facts = {
            "device": find_device_name(load_wording(language), device),
            "low": format_angle(min(known), language, 2),
            "high": format_angle(max(known), language, 2),
        }
        sentences.append(fill(words["study"]["sentence"], facts))
    return tuple(sentences)


def tabulate_table_1(
    cells: Sequence[AgreementCell], devices: Sequence[str], words: Words, language: Language
) -> Table:
    """Lay the tasks in rows and each statistic of each device in columns: mean [SD] (paper)."""
    entry = words["study"]
    columns = [
        fill(
            entry["column"],
            {"statistic": entry["statistic"][name], "device": entry["short"].get(device, device)},
        )
        for name in STATISTICS
        for device in devices
    ]
    rows = []
    for task in dict.fromkeys(cell.task for cell in cells):
        of = {cell.device: cell for cell in cells if cell.task == task}
        told = [_tell_cell(of.get(device), name, language) for name in STATISTICS for device in devices]
        rows.append((cut_text(clean_text(task), LONGEST_TASK), *told))
    return Table(entry["caption"], (entry["task"], *columns), tuple(rows), entry["note"], even=True)


def _tell_cell(cell: AgreementCell | None, name: str, language: Language) -> str:
    if cell is None:
        return NONE
    decimals, ours = DECIMALS[name], getattr(cell, name)
    told = tell_spread(ours, decimals, language)
    paper = find_paper_row(cell)
    if paper is None:
        return told
    value = paper[name]
    return f"{told} ({'NA' if value is None else format_number(value, decimals, language)})"


def tell_spread(spread: Spread, decimals: int, language: Language) -> str:
    """Write mean [standard deviation over people]; NA where nobody has the figure."""
    if not isfinite(spread.mean):
        return "NA"
    mean = format_number(spread.mean, decimals, language)
    return f"{mean}\u00a0[{format_number(spread.sd, decimals, language)}]" if isfinite(spread.sd) else mean


def _build_sections(
    entries: Sequence[AgreementEntry],
    cells: Sequence[AgreementCell],
    problems: Sequence[tuple[str, str, str]],
    words: Words,
    language: Language,
) -> tuple[Section, ...]:
    entry = words["study"]
    limits = Table(
        entry["limits_caption"],
        tuple(entry["limits_columns"]),
        tuple(_tell_limits(cell, cell.limits, words, language) for cell in cells),
        entry["limits_note"],
    )
    people = Table(
        entry["people_caption"],
        tuple(entry["people_columns"]),
        tuple(_tell_entry(e, words, language) for e in entries),
    )
    failed = Table(entry["problems_caption"], tuple(entry["problems_columns"]), tuple(problems), prose=True)
    sections = (
        Section("limits", entry["limits_section"], tables=(limits,)),
        Section("people", entry["people_section"], tables=(people,)),
        Section("problems", entry["problems_section"], tables=(failed,) if problems else ()),
    )
    return tuple(section for section in sections if section.tables)


def _tell_limits(cell: AgreementCell, limits: Limits, words: Words, language: Language) -> tuple[str, ...]:
    values = (limits.bias_deg, limits.low_deg, limits.high_deg, limits.between_sd_deg, limits.within_sd_deg)
    short = words["study"]["short"].get(cell.device, cell.device)
    return (
        cut_text(clean_text(cell.task), LONGEST_TASK),
        short,
        format_number(cell.people, 0, language),
        *(format_angle(value, language, 2) for value in values),
    )


def _tell_entry(entry: AgreementEntry, words: Words, language: Language) -> tuple[str, ...]:
    agreement = entry.agreement
    r = format_number(agreement.r, 3, language)
    return (
        cut_text(clean_text(entry.person), LONGEST_TASK),
        words["study"]["short"].get(entry.device, entry.device),
        cut_text(clean_text(entry.task), LONGEST_TASK),
        "NA" if r == NONE else r,
        format_angle(agreement.rmse_deg, language, 2),
        format_angle(agreement.mean_absolute_error_deg, language, 2),
        format_angle(agreement.bias_deg, language, 2),
    )
