"""The report as one HTML file that asks for nothing: no script, no request, no font from elsewhere."""

import base64
import hashlib
from functools import cache

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from app.report.parts import AgreementReport, Report
from app.report.template_folder import find_template_folder


def render_html(report: Report | AgreementReport) -> bytes:
    """Render the report; the same report gives the same bytes."""
    style = Markup(read_style())  # noqa: S704 - our own style sheet
    policy = content_security_policy()
    template = load_template("report.html.j2" if isinstance(report, Report) else "agreement.html.j2")
    text: str = template.render(report=report, words=report.words, style=style, policy=policy)
    return text.encode("utf-8")


@cache
def content_security_policy() -> str:
    """Give the policy the file states about itself: nothing may be loaded, only its own style applies.

    A server that sends the file should send this policy in the header, too, for a stricter one of its own
    would block the style.
    """
    digest = base64.b64encode(hashlib.sha256(read_style().encode("utf-8")).digest()).decode("ascii")
    return f"default-src 'none'; style-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"


@cache
def read_style() -> str:
    """Give the style sheet that every page of ours carries inside."""
    return (find_template_folder() / "report.css").read_text(encoding="utf-8")


@cache
def load_template(name: str) -> Template:
    """Give one of the report's templates, compiled once."""
    environment = Environment(
        loader=FileSystemLoader(find_template_folder()),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["drawing"] = _trust_drawing
    return environment.get_template(name)


def _trust_drawing(svg: str) -> Markup:
    """Let a drawing of ``figures`` pass unescaped: every text in it was escaped when it was drawn."""
    return Markup(svg)  # noqa: S704
