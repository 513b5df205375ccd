"""Who and what was compared, and which software answers."""

from dataclasses import dataclass

from app.report.subject import Software


@dataclass(frozen=True, slots=True)
class ComparisonSubject:
    """All texts come from outside and are only ever text; ``method`` and ``pose`` are "" for ready angles."""

    file_name: str
    reference_name: str
    subject: str
    side: str | None
    method: str
    pose: str
    software: Software
