"""The site: what mkdocs is told, and the notebook."""
