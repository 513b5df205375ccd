"""What other programs take from a report: typed, explained, the same bytes, the same figures."""

import csv
import io
import json
import zipfile
from datetime import datetime
from pathlib import Path
from typing import Any

import openpyxl
import pyarrow.parquet as pq
import pytest

from app.report.analysis.report import build_report
from app.report.export.all import DICTIONARY_COLUMNS, export_results
from app.report.export.columns import PERIOD_COLUMNS, encode_dictionary, find_paths
from app.report.export.naming import pack_files
from app.report.export.results import encode_results
from app.report.figures import SUMMARY, find_unit
from app.report.model import format_brief
from app.report.words.wording import LANGUAGES, Language, load_wording
from app.request import ReportRequest
from app.roads.analyse import make_report
from app.storage.store import KnownLogs
from fusion.diary import DiaryEntry
from tests.app.analysis_factory import make_analysis, make_quality, make_subject


def results_of(subject: str = "S012", file_name: str = "a.gt3x") -> dict[str, Any]:
    results: dict[str, Any] = json.loads(encode_results(make_analysis(), make_subject(subject, file_name)))
    return results


def exports_of(subject: str = "S012", file_name: str = "a.gt3x") -> dict[str, bytes]:
    return export_results(results_of(subject, file_name))


def rows_of(table: bytes, delimiter: str = ",") -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(table.decode("utf-8-sig"), newline=""), delimiter=delimiter))


def sheet_of(workbook: bytes, name: str) -> list[dict[str, Any]]:
    sheet = openpyxl.load_workbook(io.BytesIO(workbook))[name]
    names, *rows = sheet.iter_rows(values_only=True)
    return [dict(zip(map(str, names), row, strict=True)) for row in rows]


def brief_of(language: Language) -> list[str]:
    return format_brief(build_report(make_analysis(), make_subject(), language)).decode().splitlines()


# ------------------------------------------------------------------ one computation


def test_every_table_holds_the_figure_of_the_results() -> None:
    exports, above = exports_of(), results_of()["exposure"]["time_above"][1]["percent"]

    told = [
        float(rows_of(exports["summary.csv"])[0]["time_above_60_percent"]),
        float(rows_of(exports["summary_fr.csv"], ";")[0]["time_above_60_percent"].replace(",", ".")),
        sheet_of(exports["summary.xlsx"], "summary")[0]["time_above_60_percent"],
        pq.read_table(io.BytesIO(exports["summary.parquet"]))["time_above_60_percent"][0].as_py(),
        float(rows_of(exports["redcap_import.csv"])[0]["time_above_60_percent"]),
    ]

    assert told == [above] * 5


# ------------------------------------------------------------------ types


def test_a_subject_code_of_digits_stays_text_in_the_workbook() -> None:
    row = sheet_of(exports_of(subject="00123")["summary.xlsx"], "summary")[0]

    assert (row["subject"], type(row["analysed_s"])) == ("00123", int)


def test_a_text_column_of_the_parquet_file_is_text_even_where_it_is_empty() -> None:
    table = pq.read_table(io.BytesIO(exports_of()["summary.parquet"]))

    assert {str(table.schema.field(name).type) for name in ("subject", "error_code")} == {"string"}


def test_the_workbook_names_no_time_of_its_making() -> None:
    book = openpyxl.load_workbook(io.BytesIO(exports_of()["summary.xlsx"]))

    assert book.properties.created == datetime(2000, 1, 1)  # noqa: DTZ001


# ------------------------------------------------------------------ the dictionary


def test_every_column_of_every_table_is_explained_in_both_languages() -> None:
    rows = rows_of(encode_dictionary())

    explained = {file: [row["column"] for row in rows if row["file"] == file] for file in FILES}
    assert explained == {
        "summary.csv": [c.name for c in SUMMARY],
        "periods.csv": PERIOD_COLUMNS,
        "elevation.parquet": ["time_us", "elevation_cdeg", "valid"],
    }
    assert all(row["english"] and row["french"] for row in rows)


FILES = ("summary.csv", "periods.csv", "elevation.parquet")


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("analysed_s", "s"),
        ("elevation_p90_deg_low", "deg"),
        ("entries_above_60_per_h", "1/h"),
        ("rate_hz", "Hz"),
        ("time_us", "us"),
        ("elevation_cdeg", "0.01 deg"),
        ("subject", ""),
    ],
)
def test_the_unit_is_read_off_the_name(name: str, unit: str) -> None:
    assert find_unit(name) == unit


def is_explained(path: str, explained: set[str]) -> bool:
    """A star stands for one name or more at its place."""
    parts = path.split(".")
    tries = {path, *(".".join([*parts[:k], "*", *parts[k + 1 :]]) for k in range(len(parts)))}
    return bool(tries & explained) or any(known.startswith(f"{path}.") for known in explained)


def test_every_field_of_real_results_is_explained(shift_gt3x: Path, tmp_path: Path) -> None:
    diary = (DiaryEntry(60.0, 120.0, "task", "shelves"), DiaryEntry(120.0, 180.0, "break"))
    make_report(shift_gt3x, ReportRequest("a.gt3x", kinds=(), languages=("en",), diary=diary), tmp_path)
    results = json.loads((tmp_path / "results.json").read_text("utf-8"))
    explained = set(load_wording("en", "fields"))

    assert [path for path in find_paths(results) if not is_explained(path, explained)] == []


# ------------------------------------------------------------------ REDCap


def test_redcap_gets_a_form_for_exactly_the_columns_of_the_import() -> None:
    exports = exports_of()
    form = [row["Variable / Field Name"] for row in rows_of(exports["redcap_dictionary.csv"])]

    assert [*form, "arm_elevation_complete"] == list(rows_of(exports["redcap_import.csv"])[0])


def test_redcap_takes_the_names_of_our_fields() -> None:
    names = [row["Variable / Field Name"] for row in rows_of(exports_of()["redcap_dictionary.csv"])]

    assert [name for name in names if not (name.isascii() and name.islower() and len(name) <= 100)] == []
    assert not any(name[0].isdigit() or "__" in name for name in names)


def test_the_redcap_dictionary_has_its_eighteen_columns() -> None:
    assert len(DICTIONARY_COLUMNS) == len(set(DICTIONARY_COLUMNS)) == 18


def test_the_same_recording_is_the_same_record() -> None:
    one, other = (rows_of(exports_of(file_name=n)["redcap_import.csv"])[0] for n in ("a.gt3x", "b.gt3x"))

    assert one["record_id"] == other["record_id"] == "9f86d081884c7d65"


# ------------------------------------------------------------------ the answer to paste


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_answer_to_paste_has_six_lines(language: Language) -> None:
    assert len(brief_of(language)) == 6


def test_the_answer_to_paste_carries_what_limits_it_and_where_it_comes_from() -> None:
    *_, quality, pose, origin = brief_of("en")

    assert quality.startswith("Data quality: use with care.")
    assert pose.startswith("Calibration pose: held at the start, as stated")
    assert "15° low" in quality
    assert "S012, arm: right" in origin
    assert origin.endswith("Not a diagnosis.")


def test_a_good_verdict_is_pasted_with_the_caution_of_the_pose() -> None:
    report = build_report(make_analysis(quality=make_quality("good")), make_subject(), "en")

    assert "underestimated" in format_brief(report).decode().splitlines()[3]


# ------------------------------------------------------------------ the ZIP


def test_the_order_of_the_files_does_not_change_the_zip() -> None:
    assert pack_files({"a": b"1", "b": b"2"}) == pack_files({"b": b"2", "a": b"1"})


def test_the_zip_gives_back_what_went_in() -> None:
    archive = zipfile.ZipFile(io.BytesIO(pack_files({"results.json": b"{}\n"})))

    assert (archive.testzip(), archive.read("results.json")) == (None, b"{}\n")


def test_the_zip_names_no_time() -> None:
    archive = zipfile.ZipFile(io.BytesIO(pack_files({"a": b"1"})))

    assert archive.infolist()[0].date_time == (1980, 1, 1, 0, 0, 0)


def test_the_same_recording_gives_the_same_bytes_in_every_file(shift_gt3x: Path, tmp_path: Path) -> None:
    made = []
    for name in ("one", "other"):
        folder = tmp_path / name
        folder.mkdir()
        make_report(shift_gt3x, ReportRequest("a.gt3x", "S012", "right", languages=("fr",)), folder)
        made.append({path.name: path.read_bytes() for path in folder.iterdir()})

    assert [name for name in made[0] if made[0][name] != made[1][name]] == []
    assert pack_files(made[0]) == pack_files(made[1])


def test_a_digest_that_is_known_is_not_taken_again(shift_gt3x: Path, tmp_path: Path) -> None:
    known = "ab" * 32

    request = ReportRequest("a.gt3x", kinds=(), languages=("en",))
    make_report(shift_gt3x, request, tmp_path, known=KnownLogs((known,)))

    assert json.loads((tmp_path / "results.json").read_text())["recording"]["sha256"] == known
