"""From what an analysis found to what people and programs receive: reports, tables, files."""
