"""The .gt3x file of an ActiGraph: container, log records, schema, clock."""
