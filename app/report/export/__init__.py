"""Exported tables and files: results, columns, CSV, XLSX, FHIR, REDCap, Parquet."""
