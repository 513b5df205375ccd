"""SVG elements of the charts. Text is always escaped; numbers are rounded to a tenth."""

from collections.abc import Iterable
from dataclasses import dataclass
from html import escape as escape_text

INK = "#1c2833"
SOFT = "#4a5763"
PAPER = "#ffffff"
RAMP = ("#deebf7", "#9ecae1", "#2f74aa", "#0b4a8a", "#071f45")
"""Single hue, light to dark: elevation, low to high."""

ORANGE = "#d55e00"
"""Okabe-Ito vermillion, for highlights."""

WIDE = 680.0
NARROW = 330.0
"""Widths of a drawing for paper and wide screens, and for a phone."""

WORDS_PX = 12.2
"""Font size of a drawing: 9 pt if :data:`WIDE` fills the width of an A4 page."""

_WIDE_SIGNS = frozenset("WMmw@%")

FONT = "Inter, 'Segoe UI', 'Helvetica Neue', Arial, sans-serif"


def number(length_px: float) -> str:
    """Format a coordinate."""
    return f"{length_px:.1f}".rstrip("0").rstrip(".") if length_px % 1 else str(int(length_px))


def rect(x_px: float, y_px: float, width_px: float, height_px: float, attributes: str) -> str:
    """Draw a rectangle."""
    place = f'x="{number(x_px)}" y="{number(y_px)}" width="{number(width_px)}" height="{number(height_px)}"'
    return f"<rect {place} {attributes}/>"


def line(x1_px: float, y1_px: float, x2_px: float, y2_px: float, attributes: str) -> str:
    """Draw a line."""
    place = f'x1="{number(x1_px)}" y1="{number(y1_px)}" x2="{number(x2_px)}" y2="{number(y2_px)}"'
    return f"<line {place} {attributes}/>"


def path(commands: str, attributes: str) -> str:
    """Draw a path."""
    return f'<path d="{commands}" {attributes}/>'


def text(x_px: float, y_px: float, words: str, kind: str = "soft", anchor: str = "start") -> str:
    """Draw text; ``kind`` is "soft", "ink", "strong", "accent", or "light", "onlight" on colours."""
    fill = {"soft": SOFT, "light": PAPER, "accent": "#a84a00"}.get(kind, INK)
    weight = ' font-weight="600"' if kind in {"strong", "accent"} else ""
    place = f'x="{number(x_px)}" y="{number(y_px)}" text-anchor="{anchor}"'
    return f'<text class="{kind}" {place} fill="{fill}"{weight}>{escape_text(words)}</text>'


def picture(width_px: float, height_px: float, key: str, words: tuple[str, str], body: list[str]) -> str:
    """Wrap the strokes in one SVG with a title and a description for screen readers."""
    title, description = (escape_text(part) for part in words)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {number(width_px)} {number(height_px)}" '
        f'role="img" aria-labelledby="{key}-t {key}-d" font-family="{FONT}" font-size="{WORDS_PX:g}">'
        f'<title id="{key}-t">{title}</title><desc id="{key}-d">{description}</desc>'
        + "".join(body)
        + "</svg>"
    )


def estimate_width(words: str, size_px: float = WORDS_PX) -> float:
    """Estimate the width of a text generously, so that labels never touch."""
    return size_px * sum(0.95 if c in _WIDE_SIGNS else 0.72 if c.isupper() else 0.58 for c in words)


def shorten(words: str, room_px: float) -> str:
    """Cut a text that is wider than its space; the table behind the chart has more of it."""
    if estimate_width(words) <= room_px:
        return words
    kept = words
    while kept and estimate_width(kept + "…") > room_px:
        kept = kept[:-1]
    return kept.rstrip() + "…"


def break_lines(words: str, room_px: float) -> list[str]:
    """Break a text that is wider than its space at a space; a single word is never broken."""
    lines = [""]
    for word in words.split(" "):
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and estimate_width(longer) > room_px:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def hatch(x_px: float, y_px: float, width_px: float, height_px: float, key: str) -> list[str]:
    """Hatch a framed stretch, with the definition of :func:`define_hatch`."""
    place = (x_px, y_px, width_px, height_px)
    return [rect(*place, f'fill="url(#{key}-h)"'), rect(*place, f'{EDGE} stroke-width="0.6"')]


def define_hatch(key: str) -> str:
    """Define the hatch of a drawing, for ``fill="url(#key-h)"``."""
    stroke = line(0, 0, 0, 5, f'class="hatch" stroke="{SOFT}" stroke-width="1.1"')
    return (
        f'<defs><pattern id="{key}-h" width="5" height="5" patternUnits="userSpaceOnUse" '
        f'patternTransform="rotate(45)">{stroke}</pattern></defs>'
    )


# Shared by several charts.

Span = tuple[float, float]
GUIDES_DEG = (30, 60, 90)

RULE = f'class="rule" stroke="{SOFT}"'
EDGE = f'class="edge" fill="none" stroke="{SOFT}"'
BAND = f'class="band" fill="{RAMP[1]}"'
STRONG_BAND = f'class="mark" fill="{RAMP[2]}"'
PLATE = f'class="paper" fill="{PAPER}"'
MEDIAN = f'class="median" stroke="{RAMP[3]}"'
CURVE = f'class="median" fill="none" stroke="{RAMP[3]}"'
ACCENT = f'class="accent-line" stroke="{ORANGE}"'
ACCENT_CURVE = f'class="accent-line" fill="none" stroke="{ORANGE}"'


@dataclass(frozen=True, slots=True)
class Plot:
    """Mapping of values to the drawing; ``across`` and ``upwards`` are the lowest and highest values."""

    left_px: float
    right_px: float
    top_px: float = 0.0
    bottom_px: float = 0.0
    across: Span = (0.0, 180.0)
    upwards: Span = (0.0, 180.0)

    def x(self, value: float) -> float:
        """Return the x position of a value, clipped to the plot."""
        return self.left_px + (self.right_px - self.left_px) * _share(value, *self.across)

    def y(self, value: float) -> float:
        """Return the y position of a value, clipped to the plot."""
        return self.bottom_px - (self.bottom_px - self.top_px) * _share(value, *self.upwards)

    def follow(self, points: Iterable[Span], attributes: str) -> str:
        """Draw a curve through points (x, y)."""
        places = (f"{number(self.x(x))} {number(self.y(y))}" for x, y in points)
        return path("M" + "L".join(places), attributes)

    def draw_baseline(self) -> str:
        """Draw the base line of the plot."""
        return line(self.left_px, self.bottom_px, self.right_px, self.bottom_px, RULE)


def _share(value: float, low: float, high: float) -> float:
    return min(max((value - low) / (high - low), 0.0), 1.0)


def swatch(x_px: float, y_px: float, rank: int) -> str:
    """Draw a small square in a colour of the ramp, for a legend."""
    return rect(
        x_px, y_px - 9, 10, 10, f'class="edge" fill="{RAMP[rank]}" stroke="{SOFT}" stroke-width="0.8"'
    )


def range_bar(low_px: float, high_px: float, y_px: float, weight: str = "1.6") -> list[str]:
    """Draw a range with a mark at each end."""
    stroke = f'{ACCENT} stroke-width="{weight}"'
    ends = (line(x_px, y_px - 3, x_px, y_px + 3, stroke) for x_px in (low_px, high_px))
    return [line(low_px, y_px, high_px, y_px, stroke), *ends]
