"""The validation of the product: `python -m benchmarks.validation` writes docs/reference/validation.md."""
