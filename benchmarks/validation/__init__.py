"""Validation as part of the product: `python -m benchmarks.validation` writes docs/validation.md."""
