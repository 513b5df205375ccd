"""Write the guide for clinicians, docs/guide, from its templates, the words and the drawings of the product.

    python -m benchmarks.reference

The templates are docs/site/PAGE.LANGUAGE.md. The drawings become files, because a forge shows no inline SVG.
"""

import re
from pathlib import Path

from jinja2 import ChoiceLoader, Environment, FileSystemLoader

from acromion.app.errors import list_refusals
from acromion.app.http.pages.help import POSES, draw_example
from acromion.app.http.pages.rendering import pages
from acromion.app.report.words.messages import (
    CaveatWords,
    Problem,
    describe_flag,
    describe_problem,
    find_flag_codes,
)
from acromion.app.report.words.wording import Language, load_wording
from acromion.fusion.recording import QualityFlag

DOCS = Path(__file__).resolve().parents[2] / "docs"
TEMPLATES = DOCS / "site"
LANGUAGES: tuple[Language, ...] = ("en", "fr")
_NAMED = re.compile(r' (?:role="img"|aria-label="[^"]*"|class="[^"]*")(?=[^>]*>)')


def build_guide() -> dict[str, str]:
    """Return the text of each page and drawing by its path below ``docs/guide``."""
    made: dict[str, str] = {}
    for language in LANGUAGES:
        environment = _make_environment(made)
        values = _collect_words(language)
        for template in sorted(TEMPLATES.glob(f"*.{language}.md")):
            name = f"{language}/{template.name.removesuffix(f'.{language}.md')}.md"
            text = environment.from_string(template.read_text("utf-8")).render(values)
            text = re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"
            made[name] = _set_french(text) if language == "fr" else text
    return made


def _make_environment(made: dict[str, str]) -> Environment:
    """Return an environment whose ``picture`` adds a drawing to ``made`` and returns its element."""
    style = (TEMPLATES / "drawing.css").read_text("utf-8")

    def picture(name: str, drawing: str, told: str, width_px: int) -> str:
        head, rest = str(drawing).strip().split(">", 1)
        kind = re.search(r'class="([^"]*)"', head)
        label = f' class="{kind[1]}"' if kind else ""
        head = _NAMED.sub("", head + ">").removesuffix(">")
        space = "" if "xmlns=" in head else ' xmlns="http://www.w3.org/2000/svg"'
        rules = style if label else "svg { background: #fff; }\n"
        made[f"figures/{name}.svg"] = f"{head}{space}{label}><style>\n{rules}</style>{rest}\n"
        told = told.replace('"', "&quot;")
        return f'<img src="../figures/{name}.svg" alt="{told}" width="{width_px}">'

    loaders = [FileSystemLoader(TEMPLATES)]
    if pages.loader is not None:
        loaders.append(pages.loader)  # type: ignore[arg-type] # any loader will do
    environment = pages.overlay(loader=ChoiceLoader(loaders), autoescape=False)
    environment.globals = {**pages.globals, "picture": picture}
    return environment


def _collect_words(language: Language) -> dict[str, object]:
    help_words = load_wording(language, "help")
    return {
        "language": language,
        "words": load_wording(language),
        "page": load_wording(language, "page"),
        "day": load_wording(language, "day"),
        "h": help_words,
        "r": help_words["reading"],
        "pictures": draw_example(language),
        "pose_names": POSES,
        "caveats": _describe_caveats(language),
        "refusals": _describe_refusals(language),
    }


def _describe_caveats(language: Language) -> dict[str, CaveatWords]:
    return {code: describe_flag(QualityFlag(code), language) for code in find_flag_codes()}


def _describe_refusals(language: Language) -> dict[str, Problem]:
    codes = sorted({refusal.code for refusal in list_refusals()})
    return {code: describe_problem(code, {}, language) for code in codes}


def _set_french(text: str) -> str:
    """Add the no-break spaces of French before punctuation."""
    text = re.sub(r" (?=[;!?](?:\s|$))", "\u202f", text)
    return re.sub(r" (?=[:%»](?:\s|[.,)]|$))|(?<=«) ", "\u00a0", text)
