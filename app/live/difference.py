"""One line on how the angle that was shown and that of the report differ."""

from pathlib import Path

from app.report.words.numbers import format_duration, format_number, format_percent
from app.report.words.wording import fill, load_wording
from app.request import Language
from fusion.angle_files.elevation_parquet import read_elevation
from fusion.live import LiveDifference, ShownAngles, compare_shown


def measure_difference(shown: ShownAngles, elevation: Path) -> LiveDifference | None:
    """Compare what was shown with ``elevation.parquet`` of the report."""
    return compare_shown(shown, read_elevation(elevation))


def describe_difference(found: LiveDifference | None, language: Language) -> str:
    """Put it into words."""
    words = load_wording(language, "live")["difference"]
    if found is None:
        return str(words["none"])
    names = ("below_30", "from_30", "from_60", "from_90")
    shares = zip(names, found.live_percent, found.report_percent, strict=True)
    facts = {
        "time": format_duration(found.compared_s, language),
        "rmse": format_number(found.rmse_deg, 1, language),
        "bias": format_number(found.bias_deg, 1, language),
        **{
            name: f"{format_percent(live, language)} / {format_percent(report, language)}"
            for name, live, report in shares
        },
    }
    return fill(words["line"], facts)
