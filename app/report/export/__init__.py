"""Tables and files that leave: results, columns, CSV, XLSX, FHIR, REDCap, Parquet."""
