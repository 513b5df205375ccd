"""What is done to stamped rows before they are cut into segments: order, wraps, strange stamps, repeats."""

from fusion.readers.counter_wraps import unwrap_counter
from fusion.readers.repeated_rows import leave_out_repeats
from fusion.readers.row_order import order_pieces, turn_round
from fusion.readers.samples import SampleColumns
from fusion.readers.stamp_repair import count_backward, undo_daylight_saving
from fusion.readers.strange_stamps import has_strange_ends, mend_stopped, mend_stuck, place_strangers
from fusion.recording import QualityFlag


def settle_rows(
    columns: SampleColumns, *, tick_us: int = 0, is_wall_clock: bool = False
) -> tuple[QualityFlag, ...]:
    """Bring rows into the order of time and mend their stamps, in place; say what was done.

    ``tick_us``: microseconds in a count, where the stamps are those of a counter that may start over;
    ``is_wall_clock``: the stamps are a clock's that may follow daylight saving. A table whose stamps only
    advance is looked through once and left as it is.
    """
    flags = turn_round(columns)
    if is_wall_clock:
        flags += undo_daylight_saving(columns.stamps)
    flags += unwrap_counter(columns.stamps, tick_us)
    flags += mend_stopped(columns)
    if count_backward(columns.stamps) == 0 and not has_strange_ends(columns.stamps):
        return flags
    flags += mend_stuck(columns) + leave_out_repeats(columns)
    if count_backward(columns.stamps):
        flags += order_pieces(columns)
    if count_backward(columns.stamps):
        flags += place_strangers(columns)
    return flags
