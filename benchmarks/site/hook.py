"""Build the site from ``docs/``: pages, words and drawings of the product, an example report, the notebook.

    mkdocs build --strict -f docs/mkdocs.yml

mkdocs loads this module as its hook. A page with ``words: en`` (or ``fr``) in its head is a Jinja template,
which is filled with the words and drawings of the product. The hook also renders the example's report and
runs the notebook.
"""

import json
import re
import tempfile
from functools import cache
from pathlib import Path

from jinja2 import ChoiceLoader, Environment, FileSystemLoader
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from app.errors import list_refusals
from app.http.pages.help import POSES, draw_example, find_example
from app.http.pages.rendering import pages
from app.main import create_app
from app.report.export.results import decode_results
from app.report.model import Report
from app.report.render.html import render_html
from app.report.render.pdf import render_first_page, render_pdf
from app.report.single.report import build_report
from app.report.words.messages import CaveatWords, Problem, describe_flag, describe_problem, find_flag_codes
from app.report.words.wording import LANGUAGES, Language, load_wording
from app.settings import Settings
from benchmarks.site.bibliography import cite
from benchmarks.site.notebook import run_notebook, write_markdown
from fusion.recording import QualityFlag

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
PAGE_DOTS_PER_INCH = 110

_TO_ROOT = re.compile(r"\]\((?:\.\./)+(?=(?:" + "|".join((*SHARED_PAGES, *SHARED_FILES)) + r")[)#])")
_TO_DOCS = re.compile(r"\]\(docs/")
_FENCE_WORDS = re.compile(r"^(```\w+) [\w.]+$", re.MULTILINE)
"""A word after a block's language is for a test; mkdocs does not understand it."""

_ROLE = re.compile(r":(?:func|data|class|mod|meth):(?=<code>)")
"""Roles that docstrings write before a name, for other tools."""

_GENERATED = re.compile(r"\A(Made from the code: [^\n]+)\n\n(# [^\n]+\n)")

_TEXT = re.compile(r"(?<=>)[^<>]+(?=<)")


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
    """Fill in the product's words, and correct links that leave ``docs/``."""
    language = page.meta.get("words")
    if language:
        markdown = _fill_words(markdown, language)
    if "bibliography" in page.meta:
        markdown = cite(markdown, DOCS / str(page.meta["bibliography"]))
    up = "../" * page.file.src_uri.count("/")
    markdown = _TO_ROOT.sub(f"]({up}", markdown)
    if page.file.src_uri in SHARED_PAGES:
        markdown = _TO_DOCS.sub("](", markdown)
    markdown = _GENERATED.sub(r"\2\n\1.\n", markdown)
    return _FENCE_WORDS.sub(r"\1", markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Mark the language of a page for screen readers; add the French spaces before punctuation."""
    html = _ROLE.sub("", html)
    language = page.meta.get("words")
    if language == "fr":
        html = _TEXT.sub(lambda found: _set_french(found[0]), html)
    return f'<div lang="{language}">{html}</div>' if language else html


def _set_french(text: str) -> str:
    text = re.sub(r" (?=[;!?](?:\s|$))", "\u202f", text)
    return re.sub(r" (?=[:%»](?:\s|[.,)]|$))|(?<=«) ", "\u00a0", text)


def _fill_words(markdown: str, language: Language) -> str:
    help_words = load_wording(language, "help")
    return (
        _make_environment()
        .from_string(markdown)
        .render(
            words=load_wording(language),
            page=load_wording(language, "page"),
            day=load_wording(language, "day"),
            h=help_words,
            r=help_words["reading"],
            pictures=draw_example(language),
            pose_names=POSES,
            caveats=_describe_caveats(language),
            refusals=_describe_refusals(language),
        )
    )


def _describe_caveats(language: Language) -> dict[str, CaveatWords]:
    return {code: describe_flag(QualityFlag(code), language) for code in find_flag_codes()}


def _describe_refusals(language: Language) -> dict[str, Problem]:
    codes = sorted({refusal.code for refusal in list_refusals()})
    return {code: describe_problem(code, {}, language) for code in codes}


@cache
def _make_environment() -> Environment:
    loaders = [FileSystemLoader(DOCS / "site")]
    if pages.loader is not None:
        loaders.append(pages.loader)  # type: ignore[arg-type] # any loader will do
    return pages.overlay(loader=ChoiceLoader(loaders))


def _build_example(language: Language) -> Report:
    kept = decode_results(find_example().read_bytes())
    return build_report(kept.findings, kept.subject, language)


def _render_example(language: Language) -> dict[str, str | bytes]:
    """Render the report of the example as HTML and PDF, and its page 1 as a picture."""
    report, attached = _build_example(language), {"results.json": find_example().read_bytes()}
    return {
        f"example/report_{language}.html": render_html(report),
        f"example/report_{language}.pdf": render_pdf(report, attached),
        f"example/page1_{language}.png": render_first_page(report, "a4", PAGE_DOTS_PER_INCH),
    }
