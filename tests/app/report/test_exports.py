"""What other programs take from a report: typed, explained, the same bytes, the same figures."""

import base64
import csv
import io
import json
import re
import zipfile
from dataclasses import replace
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any

import openpyxl
import pyarrow.parquet as pq
import pytest
from fhir.resources.R4B.bundle import Bundle
from hypothesis import assume, given
from hypothesis import strategies as st

from acromion.app.analysis.run import make_report
from acromion.app.report.export.all import DICTIONARY_COLUMNS, export_results
from acromion.app.report.export.fhir import encode_fhir
from acromion.app.report.export.naming import Origin, format_file_name, format_report_name, pack_files
from acromion.app.report.export.results import decode_results, encode_results
from acromion.app.report.export.tables import (
    FRENCH_EXCEL,
    REDCAP_COLUMNS,
    SHEETS_ONLY,
    add_origin,
    describe_tables,
    encode_dictionary,
    encode_rows,
    encode_table,
    find_paths,
    summarise_failure,
    type_further,
)
from acromion.app.report.export.tables import Origin as FailedOrigin
from acromion.app.report.figures import SUMMARY, TABLES, find_unit, load_results
from acromion.app.report.model import format_brief
from acromion.app.report.single.report import build_report
from acromion.app.report.words.wording import LANGUAGES, Language, load_wording
from acromion.app.request import ReportRequest
from acromion.app.store.folder import KnownFiles
from acromion.fusion.diary import DiaryEntry
from acromion.fusion.exposure.types import Interval
from tests import ROOT
from tests.app.analysis_factory import (
    START,
    make_analysis,
    make_exposure,
    make_quality,
    make_subject,
    with_diary,
)


def results_of(subject: str = "S012", file_name: str = "a.gt3x") -> dict[str, Any]:
    results: dict[str, Any] = json.loads(encode_results(make_analysis(), make_subject(subject, file_name)))
    return results


def read_example_results() -> dict[str, Any]:
    return load_results((ROOT / "templates" / "example" / "results.json").read_bytes())


@cache
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


def test_empty_text_in_parquet_is_text_and_the_workbook_states_no_time_of_creation() -> None:
    table = pq.read_table(io.BytesIO(exports_of()["summary.parquet"]))
    book = openpyxl.load_workbook(io.BytesIO(exports_of()["summary.xlsx"]))

    assert {str(table.schema.field(name).type) for name in ("subject", "error_code")} == {"string"}
    assert book.properties.created == datetime(2000, 1, 1)  # noqa: DTZ001


# ------------------------------------------------------------------ the dictionary


def test_every_column_of_every_table_is_explained_in_both_languages() -> None:
    rows = rows_of(encode_dictionary())

    tables: dict[str, list[str]] = {}
    for row in rows:
        tables.setdefault(row["file"], []).append(row["column"])
    files = {name: f"summary.xlsx, {name}" if name in SHEETS_ONLY else f"{name}.csv" for name in TABLES}
    fields = tables.pop("results.json")
    assert fields
    assert tables == {
        **{files[name]: [c.name for c in columns] for name, columns in TABLES.items()},
        "redcap_import.csv": [c.name for c in REDCAP_COLUMNS],
        "elevation.parquet": ["time_us", "elevation_cdeg", "valid", "analysed", "acceleration_cg"],
    }
    assert all(row["unit"] == find_unit(row["column"]) for row in rows)
    assert all(row["english"] and row["french"] for row in rows)


@pytest.mark.parametrize("table", ["hours", "periods", "postures"])
@pytest.mark.parametrize("language", LANGUAGES)
def test_the_records_of_a_part_refer_to_the_table_with_the_same_figures(
    table: str, language: Language
) -> None:
    field = f"exposure.by_{table.removesuffix('s')}[].*"

    assert f" {table}.csv" in load_wording(language, "fields")[field]


def test_a_mark_survives_the_way_through_results_json_and_has_a_row_with_the_rest_of_the_shift() -> None:
    exposure = make_exposure()
    mark = replace(exposure.by_hour[0], kind="mark", label="Pain", intervals={}, start_s=0.0, end_s=900.0)
    rest = replace(exposure.by_hour[1], kind="rest", label="", intervals={})
    content = encode_results(make_analysis(exposure=replace(exposure, by_mark=(mark, rest))), make_subject())

    (row,) = describe_tables([load_results(content)])["marks"]

    assert (row["label"], row["mark_s"]) == ("Pain", 900.0)
    assert (row["at"], row["utc_offset"]) == ("2026-03-03T08:13:12", "UTC-05:00")
    assert (row["time_above_60_percent"], row["rest_time_above_60_percent"]) == pytest.approx(
        (mark.time_above_percent[60], rest.time_above_percent[60])
    )
    assert decode_results(content).findings.exposure.by_mark == (mark, rest)


def test_a_posture_survives_the_way_through_results_json_and_has_a_row_of_its_table() -> None:
    upright = replace(make_exposure().by_hour[0], kind="upright", label="")
    analysis = make_analysis(exposure=replace(make_exposure(), by_posture=(upright,)))
    content = encode_results(analysis, make_subject())

    (row,) = describe_tables([load_results(content)])["postures"]

    assert row["kind"] == "upright"
    assert row["time_above_60_percent"] == pytest.approx(upright.time_above_percent[60])
    assert decode_results(content).findings.exposure.by_posture == (upright,)


def test_tasks_csv_has_the_rest_and_the_difference_of_a_task_with_the_range() -> None:
    exposure = with_diary(make_exposure())
    ranges = {"time_above_60_less_rest_percent": Interval(1.5, 4.0)}
    task = replace(
        exposure.by_task[0],
        episodes_above_60_longest_s=42.0,
        recovery_neutral_slow_percent=12.5,
        time_above_60_less_rest_percent=2.5,
        intervals=ranges,
    )
    results = json.loads(
        encode_results(make_analysis(exposure=replace(exposure, by_task=(task,))), make_subject())
    )

    (row,) = describe_tables([results])["tasks"]
    names = ("episodes_above_60_longest_s", "recovery_neutral_slow_percent")
    assert [row[name] for name in names] == [42.0, 12.5]
    main = "time_above_60_less_rest_percent"
    assert [row[name] for name in (main, f"{main}_low", f"{main}_high")] == [2.5, 1.5, 4.0]


def test_the_day_is_divided_into_tables_of_one_kind_each_and_a_break_is_no_task() -> None:
    tables = describe_tables([read_example_results()])

    assert [row["label"] for row in tables["tasks"]] == ["Transport", "Installation", "Inspection"]
    assert [row["kind"] for row in tables["periods"]].count("break") == 2
    assert [row["label"] for row in tables["hours"][:2]] == ["2026-03-02T07:00", "2026-03-02T08:00"]


def test_a_row_of_the_summary_says_how_its_figures_were_made() -> None:
    origin = FailedOrigin("a.gt3x", path="a.gt3x", folder="a", settings='{"pose_held": "start"}')

    (row,) = describe_tables([add_origin(read_example_results(), origin)])["summary"]

    made = ("method", "method_version", "software_version", "pose", "calibration_state", "settings")
    assert [row[name] for name in made] == [
        *("smoothed", "6", "0.1.0", "side-lean", "given"),
        '{"pose_held": "start"}',
    ]


def test_each_part_has_its_date_and_its_times_by_the_clock() -> None:
    tables = describe_tables([read_example_results()])
    transport = tables["tasks"][0]

    assert [transport[name] for name in ("day", "start", "end")] == [
        "2026-03-02",
        "2026-03-02T07:10:00",  # 600.01 s after the start at 07:00
        "2026-03-02T09:00:00",
    ]


def test_the_days_of_a_person_are_in_order_and_say_whether_they_count() -> None:
    late, early, nobody = read_example_results(), read_example_results(), read_example_results()
    early["recording"]["start"] = "2026-03-01T07:00:00-05:00"
    early["time"]["analysed_s"] = 3600.0
    nobody["recording"]["subject"] = ""

    days = describe_tables([late, early, nobody])["days"]

    assert [(row["day"], row["left_out"]) for row in days] == [("2026-03-01", "short"), ("2026-03-02", None)]


@pytest.mark.parametrize(
    ("name", "unit"),
    [("elevation_p90_deg_low", "deg"), ("entries_above_60_per_h", "1/h"), ("time_us", "us"), ("subject", "")],
)
def test_the_unit_is_read_off_the_name(name: str, unit: str) -> None:
    assert find_unit(name) == unit


def is_explained(path: str, explained: set[str]) -> bool:
    """A star stands for one name or more at its place."""
    parts = path.split(".")
    tries = {path, *(".".join([*parts[:k], "*", *parts[k + 1 :]]) for k in range(len(parts)))}
    return bool(tries & explained) or any(known.startswith(f"{path}.") for known in explained)


@pytest.fixture(scope="module")
def made_results(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The results of a real analysis of a recording whose digest is known already."""
    folder = tmp_path_factory.mktemp("made")
    diary = (DiaryEntry(60.0, 120.0, "task", "shelves"), DiaryEntry(120.0, 180.0, "break"))
    request = ReportRequest("a.gt3x", kinds=(), languages=("en",), diary=diary)
    make_report(shift_gt3x, request, folder, known=KnownFiles(("ab" * 32,)))
    results: dict[str, Any] = json.loads((folder / "results.json").read_text("utf-8"))
    return results


def test_every_field_of_real_results_is_explained(made_results: dict[str, Any]) -> None:
    explained = set(load_wording("en", "fields"))

    assert [path for path in find_paths(made_results) if not is_explained(path, explained)] == []


def test_a_digest_that_is_known_is_not_computed_again(made_results: dict[str, Any]) -> None:
    assert made_results["recording"]["sha256"] == "ab" * 32


# ------------------------------------------------------------------ REDCap


def test_redcap_gets_a_form_of_names_it_takes_for_exactly_the_columns_of_the_import() -> None:
    exports = exports_of()
    form = [row["Variable / Field Name"] for row in rows_of(exports["redcap_dictionary.csv"])]

    assert [*form, "arm_elevation_complete"] == list(rows_of(exports["redcap_import.csv"])[0])
    assert [name for name in form if not re.fullmatch(r"(?!.*__)[a-z_][a-z0-9_]{,99}", name)] == []
    assert len(DICTIONARY_COLUMNS) == len(set(DICTIONARY_COLUMNS)) == 18


def test_the_same_recording_is_the_same_record() -> None:
    one, other = (rows_of(exports_of(file_name=n)["redcap_import.csv"])[0] for n in ("a.gt3x", "b.gt3x"))

    assert one["record_id"] == other["record_id"] == "9f86d081884c7d65"


@pytest.mark.parametrize("text", ["=1+1", "-x", "'-x"])
def test_redcap_gets_text_as_it_was_given(text: str) -> None:
    (row,) = rows_of(exports_of(subject=text)["redcap_import.csv"])

    assert row["subject"] == text


# ------------------------------------------------------------------ the answer to paste


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


def test_the_zip_holds_its_files_in_one_order_and_states_no_time() -> None:
    packed = pack_files({"results.json": b"{}\n", "a": b"1"})
    archive = zipfile.ZipFile(io.BytesIO(packed))

    assert packed == pack_files({"a": b"1", "results.json": b"{}\n"})
    assert (archive.testzip(), archive.read("results.json")) == (None, b"{}\n")
    assert {about.date_time for about in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_the_same_recording_gives_the_same_bytes_in_every_file(shift_gt3x: Path, tmp_path: Path) -> None:
    made = []
    for name in ("one", "other"):
        folder = tmp_path / name
        folder.mkdir()
        make_report(shift_gt3x, ReportRequest("a.gt3x", "S012", "right", languages=("fr",)), folder)
        made.append({path.name: path.read_bytes() for path in folder.iterdir()})

    assert [name for name in made[0] if made[0][name] != made[1][name]] == []
    assert pack_files(made[0]) == pack_files(made[1])


# The name a report is taken away under.


def results_named(subject: str = "S012", start: str | None = "2026-03-03T07:58:12-05:00") -> dict[str, Any]:
    side = "right" if start else None
    return {"recording": {"subject": subject, "start": start, "side": side, "file_name": "shift 3.gt3x"}}


def test_it_tells_whose_when_which_arm_and_which_version() -> None:
    assert format_report_name(results_named(), 2, "pdf") == "S012_2026-03-03_right_report_v2.pdf"


def test_what_is_not_known_is_left_out() -> None:
    assert format_report_name(results_named("", None), 1, "html") == "shift 3_report_v1.html"


@pytest.mark.parametrize(
    ("subject", "stem"),
    [("../../etc/passwd", "etc-passwd"), ("É-012", "É-012"), ('a"b;c', "a-b-c"), ("...", "recording")],
)
def test_only_signs_that_every_file_system_takes_are_kept(subject: str, stem: str) -> None:
    assert format_report_name(results_named(subject, None), 1, "pdf") == f"{stem}_report_v1.pdf"


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("report.fr.pdf", "S012_2026-03-03_left_report_v3.fr.pdf"),
        ("elevation.csv.gz", "S012_2026-03-03_left_elevation_v3.csv.gz"),
        ("bundle.zip", "S012_2026-03-03_left_bundle_v3.zip"),
    ],
)
def test_every_file_is_named_by_the_same_rule(kind: str, name: str) -> None:
    origin = Origin("S012", "shift 3.gt3x", "2026-03-03T07:58:12-05:00", "left", 3)

    assert format_file_name(origin, kind) == name


# summary.csv: one row for each recording, safe to open in a spreadsheet.


FAILED = FailedOrigin("left.gt3x", "S012", "left", "p1/left.gt3x", "left")
NAMES = [column.name for column in SUMMARY]


def read_rows(encoded: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(encoded.decode("utf-8"), newline="")))


def test_a_failed_recording_keeps_its_row_with_its_code_and_empty_figures() -> None:
    (row,) = read_rows(encode_rows("summary", [summarise_failure(FAILED, "E-EMPTY")]))

    assert (row["error_code"], row["time_above_60_percent"]) == ("E-EMPTY", "")


def test_each_column_stands_once_and_the_ends_of_a_range_beside_its_figure() -> None:
    assert len(set(NAMES)) == len(NAMES)
    assert {"time_above_60_percent_low", "elevation_p90_deg_high"} <= set(NAMES)


@given(st.sampled_from("=+-@\t\r"), st.text(max_size=20))
def test_no_text_cell_can_become_a_formula(start: str, rest: str) -> None:
    assume(not re.fullmatch(r"[+-][0-9.,]+", start + rest))  # a number
    encoded = encode_table(["subject"], [{"subject": start + rest}])

    assert encoded.decode("utf-8").splitlines()[1].lstrip('"')[0] == "'"


@pytest.mark.parametrize("text", ["-1.5", "-1,5", "+2", "-0.25"])
def test_a_number_among_texts_gets_no_apostrophe(text: str) -> None:
    (row,) = csv.DictReader(io.StringIO(encode_table(["change"], [{"change": text}]).decode()))

    assert row["change"] == text


@pytest.mark.parametrize(
    ("cells", "kind", "typed"),
    [
        (("34", "", "-1.5"), "number", [34, None, -1.5]),
        (("3,5", "4"), "number", [3.5, 4]),  # a decimal comma
        (("34", "NA", "N/A", "NaN", "null", "none", "-"), "number", [34, *[None] * 6]),
        (("drill", "none"), "text", ["drill", "none"]),  # among words, "none" is an answer
        (("NA", ""), "text", ["NA", None]),
        (("007", "8"), "text", ["007", "8"]),
        (("1,500",), "text", ["1,500"]),  # 1.5, or one thousand five hundred
        (("12345678901234567",), "text", ["12345678901234567"]),  # has more digits than a number holds
        (("",), "text", [None]),
    ],
)
def test_a_further_column_is_a_number_if_all_its_values_are(
    cells: tuple[str, ...], kind: str, typed: list[object]
) -> None:
    (column,), rows = type_further({str(rank): {"x": text} for rank, text in enumerate(cells)})

    assert (column.kind, [row["x"] for row in rows.values()]) == (kind, typed)


def test_a_negative_number_stays_a_number() -> None:
    row: dict[str, Any] = {"bias_deg": -1.5}

    assert encode_table(["bias_deg"], [row]) == b"bias_deg\n-1.5\n"


def test_a_french_excel_gets_semicolons_commas_and_a_mark() -> None:
    encoded = encode_table(["subject", "angle_deg"], [{"subject": "S1", "angle_deg": 12.5}], FRENCH_EXCEL)

    assert encoded == "\ufeffsubject;angle_deg\r\nS1;12,5\r\n".encode()


def test_the_decimal_sign_of_text_is_left_alone() -> None:
    assert b"1.5 m" in encode_table(["label"], [{"label": "1.5 m"}], FRENCH_EXCEL)


@given(st.sampled_from(";,\t\n"), st.sampled_from("=+-@"), st.text(max_size=5))
def test_no_part_of_a_text_becomes_a_formula_for_a_reader_of_another_dialect(
    gap: str, start: str, rest: str
) -> None:
    text = encode_table(["label"], [{"label": f"a{gap}{start}{rest}"}]).decode("utf-8")

    assert f"{gap}{start}" not in text


# The FHIR R4 bundle: valid, with the PDF inside, with the same figures, and without a name.


PDF = b"%PDF-1.7 a report"
ANSWER = "The right arm was raised.\n"


def bundle_of(start: datetime | None = START, subject: str = "S012") -> dict[str, Any]:
    results = json.loads(encode_results(make_analysis(start=start), make_subject(subject)))
    bundle: dict[str, Any] = json.loads(encode_fhir(results, {"en": PDF}, ANSWER))
    return bundle


def report_of(bundle: dict[str, Any]) -> dict[str, Any]:
    report: dict[str, Any] = bundle["entry"][0]["resource"]
    return report


def figure_of(bundle: dict[str, Any], name: str) -> dict[str, Any]:
    resources = (entry["resource"] for entry in bundle["entry"][1:])
    return next(r for r in resources if r["code"]["coding"][0]["code"] == name)


@pytest.mark.parametrize("start", [START, START.replace(tzinfo=None), None])
def test_the_bundle_is_valid_with_any_clock(start: datetime | None) -> None:
    bundle = Bundle.model_validate(bundle_of(start))

    assert bundle.type == "collection"


def test_the_report_holds_the_pdf_and_the_answer() -> None:
    report = report_of(bundle_of())

    assert base64.b64decode(report["presentedForm"][0]["data"]) == PDF
    assert report["presentedForm"][0]["title"] == "S012_2026-03-03_right_report_v1.pdf"
    assert report["conclusion"] == ANSWER


def test_the_report_refers_to_every_figure_which_has_its_value_and_unit() -> None:
    bundle = bundle_of()
    referred = [item["reference"] for item in report_of(bundle)["result"]]
    value = figure_of(bundle, "time_above_60_percent")["valueQuantity"]

    assert referred == [entry["fullUrl"] for entry in bundle["entry"][1:]]
    assert (value["value"], value["code"]) == (7.6, "%")
    assert bundle == bundle_of()  # nothing in it is random or of this moment


def test_every_figure_whose_range_is_known_has_it() -> None:
    exposure = make_exposure(above_60_interval=Interval(6.0, 9.5))
    first, *others = exposure.bins
    bins = (replace(first, interval=Interval(40.0, 50.0)), *others)
    known = {"entries_above_60_per_h": Interval(21.0, 44.0), "elevation_p50_deg": Interval(20.0, 24.0)}
    analysis = make_analysis(exposure=replace(exposure, bins=bins, intervals=known))

    bundle = json.loads(encode_fhir(json.loads(encode_results(analysis, make_subject())), {}, ""))

    ranged = {
        entry["resource"]["code"]["text"]: [
            p["valueQuantity"]["value"] for p in entry["resource"]["component"]
        ]
        for entry in bundle["entry"][1:]
        if "component" in entry["resource"]
    }
    assert sorted(ranged.values()) == [[6.0, 9.5], [20.0, 24.0], [21.0, 44.0], [40.0, 50.0]]


def test_the_subject_is_a_code_and_never_a_name() -> None:
    text = json.dumps(bundle_of())

    assert report_of(bundle_of())["subject"] == {
        "identifier": {"system": "urn:acromion:subject", "value": "S012"}
    }
    assert "subject" not in report_of(bundle_of(subject=""))
    assert re.search(r'"(name|family|given|birthDate)"', text) is None


def test_a_clock_without_a_zone_gives_the_date_only() -> None:
    period = report_of(bundle_of(START.replace(tzinfo=None)))["effectivePeriod"]

    assert period == {"start": "2026-03-03", "end": "2026-03-03"}


def test_every_resource_names_its_profile() -> None:
    bundle = bundle_of()
    resources = [bundle, *(entry["resource"] for entry in bundle["entry"])]

    assert {resource["resourceType"]: resource["meta"]["profile"] for resource in resources} == {
        "Bundle": ["http://hl7.org/fhir/StructureDefinition/Bundle"],
        "DiagnosticReport": ["http://hl7.org/fhir/StructureDefinition/DiagnosticReport"],
        "Observation": ["http://hl7.org/fhir/StructureDefinition/Observation"],
    }


def test_a_figure_has_one_name_in_python_and_in_the_summary() -> None:
    exposure = make_exposure()
    (row,) = describe_tables(
        [load_results(encode_results(make_analysis(exposure=exposure), make_subject()))]
    )["summary"]

    shared = exposure.figures.keys() & row.keys()
    assert shared >= {
        "time_0_20_percent",
        "time_above_60_percent",
        "elevation_p50_deg",
        "entries_above_60_per_h",
    }
    assert {name: exposure.figures[name] for name in shared} == pytest.approx(
        {name: row[name] for name in shared}, abs=1e-3
    )
    assert exposure.figures.keys() - row.keys() == set()
