"""Logging: every record is one line, even if its text contains line breaks.

A log contains ids, never a file name or a subject code.
"""

import logging
import re
from datetime import UTC, datetime
from types import TracebackType

FORMAT = "%(asctime)s %(levelname)s %(message)s"
AUDIT_LOGGER = "acromion.audit"
"""Its records are JSON, one per line, without a prefix."""
_BREAKS = r"\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
_CONTROLS = re.compile(f"[{_BREAKS}]")
"""Control characters, line ends, marks of text direction, and lone surrogates."""


def escape_controls(text: str) -> str:
    r"""Replace every character that could end, hide or reverse a line by ``\uXXXX``, as JSON does."""
    return _CONTROLS.sub(lambda sign: f"\\u{ord(sign.group()):04x}", text)


def start_logging(level: int = logging.INFO) -> None:
    """Log to standard error in this format, unless logging is already configured."""
    handler = logging.StreamHandler()
    handler.setFormatter(LineFormatter(FORMAT))
    logging.basicConfig(level=level, handlers=[handler])


class LineFormatter(logging.Formatter):
    """Escapes each record; traceback lines start with a bar, so that none looks like a record."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, followed by the lines of a traceback."""
        record.exc_text = None  # another formatter may have cached its own text there
        return super().format(record)

    def formatTime(self, record: logging.LogRecord, datefmt: str | None = None) -> str:  # noqa: N802, ARG002
        """Return the time in UTC, with its zone, regardless of the computer's zone."""
        return datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's own name
        """Return the line without a traceback."""
        return (
            record.message if record.name == AUDIT_LOGGER else escape_controls(super().formatMessage(record))
        )

    def formatException(  # noqa: N802
        self, ei: tuple[type[BaseException], BaseException, TracebackType | None] | tuple[None, None, None]
    ) -> str:
        """Return the lines of a traceback."""
        return _bar_lines(super().formatException(ei))

    def formatStack(self, stack_info: str) -> str:  # noqa: N802
        """Return the lines of a stack."""
        return _bar_lines(super().formatStack(stack_info))


def _bar_lines(text: str) -> str:
    return "\n".join(f"| {escape_controls(line)}" for line in text.split("\n"))
