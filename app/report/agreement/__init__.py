"""The report of an agreement with a reference, and of a study of several."""
