"""Where the report's templates and fonts are: in the installed package, else in the checkout."""

from functools import cache
from pathlib import Path


@cache
def find_template_folder() -> Path:
    """Give the folder with ``report.html.j2``, ``report.css``, ``report.typ`` and ``fonts``."""
    here = Path(__file__).resolve()
    packaged = here.parents[1] / "templates" / "report"
    return packaged if packaged.is_dir() else here.parents[2] / "templates" / "report"
