"""From a study to its sheet, in the layout of the source paper's Table 1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from app.report.agreement.study_tables import find_paper_row
from app.report.agreement.tables import tell_r
from app.report.charts.agreement import draw_study
from app.report.model import AgreementReport, Note, Pair, Section, Table
from app.report.words.numbers import NONE, format_angle, format_number
from app.report.words.subject import Software, clean_text, cut_text
from app.report.words.wording import Language, Words, fill, find_device_name, load_wording

if TYPE_CHECKING:
    from fusion.agreement import AgreementCell, AgreementEntry
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
    sentences = []
    for device, name in zip(devices, names, strict=True):  # between what means its error lies
        means = [cell.rmse_deg.mean for cell in cells if cell.device == device]
        known = [mean for mean in means if isfinite(mean)] or [float("nan")]
        low, high = (format_angle(edge, language, 2) for edge in (min(known), max(known)))
        sentences.append(fill(entry["sentence"], {"device": name, "low": low, "high": high}))
    return AgreementReport(
        language=language,
        title=entry["title"],
        subtitle=words["subtitle"],
        header=tuple(Pair(entry["header"][name], counts[name]) for name in entry["header"]),
        sentences=tuple(sentences),
        main=(tabulate_table_1(cells, devices, words, language),),
        figures=tuple(draw_study(entries, cells, device, words, language) for device in devices),
        limits=Note(words["limits"]["title"], tuple(words["limits"]["paragraphs"])),
        sections=_build_sections(entries, cells, problems, words, language),
        report_id=facts.report_id,
        footer=fill(common["heading"]["footer"], told),
        made_of=None,
        words={**common["label"], **words["label"], "attachment": entry["attachment"]},
    )


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
    rows = []
    for cell in cells:
        limits = cell.limits
        edges = (limits.bias_deg, limits.low_deg, limits.high_deg)
        values = (*edges, limits.between_sd_deg, limits.within_sd_deg)
        rows.append(
            (
                cut_text(clean_text(cell.task), LONGEST_TASK),
                entry["short"].get(cell.device, cell.device),
                format_number(cell.people, 0, language),
                *(format_angle(value, language, 2) for value in values),
            )
        )
    columns = tuple(entry["limits_columns"])
    limits_table = Table(entry["limits_caption"], columns, tuple(rows), entry["limits_note"])
    compared = tuple(
        (
            cut_text(clean_text(one.person), LONGEST_TASK),
            entry["short"].get(one.device, one.device),
            cut_text(clean_text(one.task), LONGEST_TASK),
            tell_r(one.agreement.r, language),
            format_angle(one.agreement.rmse_deg, language, 2),
            format_angle(one.agreement.mean_absolute_error_deg, language, 2),
            format_angle(one.agreement.bias_deg, language, 2),
        )
        for one in entries
    )
    people = Table(entry["people_caption"], tuple(entry["people_columns"]), compared)
    failed = Table(entry["problems_caption"], tuple(entry["problems_columns"]), tuple(problems), prose=True)
    sections = (
        Section("limits", entry["limits_section"], tables=(limits_table,)),
        Section("people", entry["people_section"], tables=(people,)),
        Section("problems", entry["problems_section"], tables=(failed,) if problems else ()),
    )
    return tuple(section for section in sections if section.tables)
