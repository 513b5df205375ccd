"""The documentation site: the hook of mkdocs, and the notebook."""
