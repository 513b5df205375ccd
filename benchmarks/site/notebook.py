"""Run a notebook in a fresh kernel, and write the result as a page.

Notebooks are stored without outputs, because these name machines and become outdated.
"""

import os
import tempfile
from html import escape
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

TIMEOUT_S = 600
ROOT = Path(__file__).resolve().parents[2]


def run_notebook(path: Path) -> Any:
    """Run every cell in an empty folder; a failing cell raises ``nbclient``'s error.

    Returns
    -------
    nbformat.NotebookNode
        The notebook with its outputs.
    """
    notebook = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    with tempfile.TemporaryDirectory() as folder:
        found = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        client = NotebookClient(
            notebook,
            kernel_name="python3",
            timeout=TIMEOUT_S,
            resources={"metadata": {"path": folder}},
        )
        client.execute(env=os.environ | {"PYTHONPATH": found})
    return notebook


def write_markdown(notebook: Any) -> str:
    """Return an executed notebook as Markdown."""
    parts = []
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
        else:
            parts.append(f"```python\n{cell.source}\n```")
            parts += [_write_output(output, cell.metadata.get("alt", "")) for output in cell.outputs]
    return "\n\n".join(part for part in parts if part) + "\n"


def _write_output(output: Any, alt: str) -> str:
    if output.output_type == "stream":
        return f"```text\n{output.text.rstrip()}\n```"
    shown = output.data
    if "image/png" in shown:
        return f'<img alt="{escape(alt)}" src="data:image/png;base64,{shown["image/png"].strip()}">'
    if "text/html" in shown:
        return f'<div class="table">\n{_join_lines(shown["text/html"])}\n</div>'
    return f"```text\n{shown['text/plain']}\n```"


def _join_lines(html: str) -> str:
    """Remove empty lines, which would end the HTML block in Markdown."""
    return "\n".join(line.strip() for line in html.splitlines() if line.strip())
