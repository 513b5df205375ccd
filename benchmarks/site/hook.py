"""Build the site from ``docs/``: pages, words and drawings of the product, an example report, the notebook.

    mkdocs build --strict -f docs/mkdocs.yml

mkdocs loads this module as its hook. It renders the example's report, runs the notebook, and adapts the
pages, which are also readable as files: links that leave ``docs/``, and what only the site has.
"""

import json
import re
import tempfile
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from acromion.app.http.pages.help import find_example
from acromion.app.main import create_app
from acromion.app.report.export.results import decode_results
from acromion.app.report.model import Report
from acromion.app.report.render.html import render_html
from acromion.app.report.render.pdf import render_pdf
from acromion.app.report.single.report import build_report
from acromion.app.report.words.wording import LANGUAGES, Language
from acromion.app.settings import Settings
from benchmarks.site.notebook import run_notebook, write_markdown

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
SHARED_PAGES = ("CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "CODE_OF_CONDUCT.md")
"""Pages of the top folder that the site also shows."""

SHARED_FILES = (
    "CITATION.cff",
    "docker/compose.yaml",
    "docker/compose.many.yaml",
    "docker/env.example",
    "docker/compose.clinic.yaml",
    "docker/bucket-policy.json",
    "docker/make-bucket.sh",
)
EXAMPLE_LINKS = {
    "en": "The whole report: [HTML]({place}.html), [PDF]({place}.pdf).",
    "fr": "Le rapport entier : [HTML]({place}.html), [PDF]({place}.pdf).",
}
"""The text that the site shows in place of ``<!-- example: en -->``."""

_TO_ROOT = re.compile(r"\]\((?:\.\./)+(?=(?:" + "|".join((*SHARED_PAGES, *SHARED_FILES)) + r")[)#])")
_TO_DOCS = re.compile(r"\]\(docs/")
_EXAMPLE = re.compile("<!-- example: (en|fr) -->")
_FENCE_WORDS = re.compile(r"^(```\w+) [\w.]+$", re.MULTILINE)
"""A word after a block's language is for a test; mkdocs does not understand it."""

_ROLE = re.compile(r":(?:func|data|class|mod|meth):(?=<code>)")
"""Roles that docstrings write before a name, for other tools."""

_GENERATED = re.compile(r"\A(Made from the code: [^\n]+)\n\n(# [^\n]+\n)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Set ``docs/`` as the folder of the pages; mkdocs.yml may not name its own folder."""
    config.docs_dir = str(DOCS)
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated files: pages of the top folder, example report, OpenAPI document, notebook."""
    made: dict[str, str | bytes] = {name: (ROOT / name).read_text("utf-8") for name in SHARED_PAGES}
    made |= {name: (ROOT / name).read_bytes() for name in SHARED_FILES}
    for language in LANGUAGES:
        made |= _render_example(language)
    with tempfile.TemporaryDirectory() as folder:
        made["openapi.json"] = json.dumps(create_app(Settings(data_dir=Path(folder))).openapi(), indent=1)
    for name, content in made.items():
        files.append(File.generated(config, name, content=content))
    for notebook in [file for file in files if file.src_uri.endswith(".ipynb")]:
        page = write_markdown(run_notebook(DOCS / notebook.src_uri))
        name = Path(notebook.src_uri).with_suffix(".md").as_posix()
        files.append(File.generated(config, name, content=page))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Correct links that leave ``docs/``; add links to the example's report and to the executed notebook."""
    if page.file.src_uri.endswith("/codes.md") and _find_language(page):
        page.meta["search"] = {"boost": 10}
    up = "../" * page.file.src_uri.count("/")
    markdown = _TO_ROOT.sub(f"]({up}", markdown)
    if page.file.src_uri in SHARED_PAGES:
        markdown = _TO_DOCS.sub("](", markdown)
    markdown = _EXAMPLE.sub(
        lambda found: EXAMPLE_LINKS[found[1]].format(place=f"{up}example/report_{found[1]}"), markdown
    )
    markdown = markdown.replace(".ipynb)", ".md)")
    markdown = _GENERATED.sub(r"\2" if _find_language(page) else r"\2\n\1.\n", markdown)
    return _FENCE_WORDS.sub(r"\1", markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Mark the language of a page for screen readers."""
    html = _ROLE.sub("", html)
    language = _find_language(page)
    return f'<div lang="{language}">{html}</div>' if language else html


def _find_language(page: Page) -> str:
    """Return the language of a page of the guide; "" for any other page."""
    found = re.match(r"guide/(\w+)/", page.file.src_uri)
    return found[1] if found else ""


def _build_example(language: Language) -> Report:
    kept = decode_results(find_example().read_bytes())
    return build_report(kept.findings, kept.subject, language)


def _render_example(language: Language) -> dict[str, str | bytes]:
    """Render the report of the example as HTML and PDF."""
    report, attached = _build_example(language), {"results.json": find_example().read_bytes()}
    return {
        f"example/report_{language}.html": render_html(report),
        f"example/report_{language}.pdf": render_pdf(report, attached),
    }
