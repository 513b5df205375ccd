"""A caveat with the stretches it is about."""

from collections.abc import Sequence

from fusion.recording import MICROSECONDS, QualityFlag, Span

MOST_TOLD = 100


def flag_spans(code: str, spans: Sequence[Span]) -> tuple[QualityFlag, ...]:
    """Make a caveat of stretches in time order; none where there are none.

    It tells where they lie: all of them, or the hundred longest; its count and seconds are those of all.
    """
    if not spans:
        return ()
    total_us = sum(span.duration_us for span in spans)
    longest = sorted(spans, key=lambda span: -span.duration_us)[:MOST_TOLD]
    told = sorted((s.start_us / MICROSECONDS, s.end_us / MICROSECONDS) for s in longest)
    first_s, last_s = spans[0].start_us / MICROSECONDS, spans[-1].end_us / MICROSECONDS
    return (QualityFlag(code, len(spans), total_us / MICROSECONDS, first_s, last_s, spans_s=tuple(told)),)
