"""Everything that is taken out of ``results.json`` for other programs."""

import io
from collections.abc import Callable, Mapping
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from app.report.arrow_columns import lay_some_numbers, lay_some_texts
from app.report.dictionary import encode_dictionary
from app.report.redcap import encode_redcap_dictionary, encode_redcap_import
from app.report.summary import COLUMNS, encode_summary, summarise_results
from app.report.tables import FRENCH_EXCEL
from app.report.workbook import encode_workbook


def export_results(results: Mapping[str, Any]) -> dict[str, bytes]:
    """Write the tables of one recording, by file name; every figure is the one of ``results.json``."""
    row = summarise_results(results)
    return {
        "summary.csv": encode_summary([row]),
        "summary_fr.csv": encode_summary([row], FRENCH_EXCEL),
        "summary.xlsx": encode_workbook([results]),
        "summary.parquet": encode_parquet([results]),
        "dictionary.csv": encode_dictionary(),
        "redcap_import.csv": encode_redcap_import([results]),
        "redcap_dictionary.csv": encode_redcap_dictionary(),
    }


def encode_parquet(every: list[Mapping[str, Any]]) -> bytes:
    """Write one typed row for each recording: text or float64, null where it is not computable."""
    rows = [summarise_results(results) for results in every]
    lay: dict[str, Callable[..., pa.Array]] = {"text": lay_some_texts, "number": lay_some_numbers}
    columns = [lay[column.kind]([row[column.name] for row in rows]) for column in COLUMNS]
    body = io.BytesIO()
    table = pa.Table.from_arrays(columns, [column.name for column in COLUMNS])
    pq.write_table(table, body, compression="zstd")
    return body.getvalue()
