"""What must become of tables out of order and of strange stamps (rows 75 to 77)."""

from datetime import datetime
from functools import partial

from tests.badfiles import order_files as o
from tests.badfiles.gt3x_files import replaced, second
from tests.badfiles.outcomes import read, read_gt3x, refused
from tests.badfiles.table_files import MICROS, NAMES, resaved

EPOCH = datetime(1970, 1, 1)  # noqa: DTZ001 - a clock that lost its date
MARCH = datetime(2026, 3, 3, 23, 59, 30)  # noqa: DTZ001 - a day that is its month, too
HOLED = (60.0, 25.0, 0.0)
"""A piece that stands too early leaves a hole before it that is none."""
BACKWARDS = range(5999, -1, -1)

ORDER = (
    read("75 24 bits of ms", partial(o.short_counter, 24, "ms", 1000, 16_750_000_000), "W-CLOCK-BACK"),
    read("75 16 bits of ms", partial(o.short_counter, 16, "ms", 1000, 30_000_000), "W-CLOCK-BACK"),
    read("78 every second row", partial(o.ordered, o.thinned(2000, 4000, 2)), "W-RATE-CHANGE"),
    read(
        "78 two rows of three",
        partial(o.ordered, o.thinned(2000, 4000, 3)),
        "W-GAP W-RATE-CHANGE W-SHORT",
        (59.99, 0.01, 0.0),
    ),
    read(
        "78 rows lost at random",
        partial(o.ordered, o.thinned_at_random(2000, 5000)),
        "W-GAP W-LOWCOVER W-ROWS-DROPPED W-SHORT",
        (27.59, 32.41, 0.0),
    ),
    read("85 half the rate from half on", partial(o.ordered, o.thinned(3000, 6000, 2)), "W-RATE-CHANGE"),
    read("85 twice the rate at the end", partial(o.ordered, o.thinned(0, 4800, 2)), "W-RATE-CHANGE"),
    *(
        read(
            f"56 {season}, {lost_s} s lost",
            partial(o.lost_at_change, first, step_h, lost_s),
            f"W-DST step_s={3600 * step_h} W-GAP first_s=30.0 {others}",
            (60.0, lost_s, 0.0),
        )
        for season, first, step_h in (
            ("fall", "2026-11-01T01:59:30", -1),
            ("spring", "2027-03-14T01:59:30", 1),
        )
        for lost_s, others in ((10, ""), (300, "W-LOWCOVER W-PUT-BACK"))
    ),
    read("58 another start in the header", partial(o.preambled, "start: 2026-03-14T09:30:00"), "W-START"),
    read("77 pieces", partial(o.ordered, o.PASTED), "W-CLOCK-BACK W-GAP", HOLED),
    read(
        "77 pieces, wall clock",
        partial(o.ordered, o.PASTED, o.wall_clock(), o.CALENDAR),
        "W-CLOCK-BACK W-GAP",
        HOLED,
    ),
    read("77 pieces, ActiLife", partial(o.pasted_actilife, o.PASTED), "W-CLOCK-BACK W-GAP", HOLED),
    read(
        "77 pieces, whole seconds",
        partial(o.ordered, o.PASTED, o.wall_clock(digits=19), o.CALENDAR),
        "W-CLOCK-BACK W-GAP W-JITTER",
        HOLED,
    ),
    read(
        "77 pieces that share rows",
        partial(o.ordered, [*range(2000), *range(2900, 4500), *range(2000, 3000), *range(4500, 6000)]),
        "W-CLOCK-BACK W-GAP",
        (61.0, 24.0, 0.0),
    ),
    read(
        "77 pieces, one lost",
        partial(o.ordered, [*range(1000), *range(4000, 6000), *range(2000, 4000)]),
        "W-CLOCK-BACK W-GAP W-SHORT",
        (50.0, 30.0, 0.0),
    ),
    *(
        refused(f"77 newest first{name}", partial(order, BACKWARDS, *stamps), "E-TIME, why=reversed")
        for name, order, *stamps in (
            ("", o.ordered),
            (", wall clock", o.ordered, o.wall_clock(), o.CALENDAR),
            (", whole seconds", o.ordered, o.wall_clock(digits=19), o.CALENDAR),
            (", ActiLife", o.pasted_actilife),
            (", unit unknown", o.ordered, [k / 100 for k in range(6000)], "time," + NAMES),
        )
    ),
    read_gt3x("27 last second an hour late", replaced(59, second(59, stamp=3659)), "W-CLOCK-FWD"),
    read_gt3x("27 first second an hour early", replaced(0, second(0, stamp=-3600)), "W-CLOCK-FWD"),
    *(
        read(
            f"79 03/03 over midnight, {name}",
            partial(resaved, pattern, MARCH, "03/03/2026", word),
            "W-LOCALE",
        )
        for name, pattern, word in (
            ("d/M", "%d/%m/%Y %H:%M:%S.%f", "dd/MM/yyyy"),
            ("d/M under M/d", "%d/%m/%Y %H:%M:%S.%f", "M/d/yyyy"),
            ("M/d under d/M", "%m/%d/%Y %H:%M:%S.%f", "dd/MM/yyyy"),
        )
    ),
    read(
        "79 no date, 13 h of pause",
        partial(o.paused, 13),
        "W-GAP W-LOWCOVER W-PUT-BACK W-NO-DATE",
        (60.0, 46_800.0, 0.0),
    ),
    *(
        read(f"28 50 rows {name}", make, "W-CLOCK-FWD count=50")
        for name, make in (
            ("at 0", partial(o.stray, [0] * 50)),
            ("from 0", partial(o.stray, range(0, 500_000, 10_000))),
            ("far ahead", partial(o.stray, [9_000_000_000] * 50)),
            ("nearly still", partial(o.stray, range(7, 57))),
            ("at the epoch", partial(o.stray_dates, EPOCH, 0)),
            ("from the epoch", partial(o.stray_dates, EPOCH, 10)),
        )
    ),
    read(
        "28 50 rows at 0, more lost",
        partial(o.stray, [0] * 50, [*range(3050), *range(3150, 6000)]),
        "W-CLOCK-FWD W-GAP W-SHORT",
        (59.0, 1.0, 0.0),
    ),
    read(
        "28 50 rows from 0, more lost",
        partial(o.stray, range(0, 500_000, 10_000), [*range(3050), *range(3150, 6000)]),
        "W-CLOCK-FWD W-GAP W-SHORT",
        (59.0, 1.0, 0.0),
    ),
    read(
        "28 first row an hour early",
        partial(o.ordered, range(6000), [0, *(3_600_000_000 + us for us in MICROS[1:])]),
        "W-ROWS-DROPPED W-SHORT",
        (59.99, 0.0, 0.0),
    ),
    read(
        "28 last row an hour late",
        partial(o.ordered, range(6000), [*MICROS[:-1], MICROS[-1] + 3_600_000_000]),
        "W-ROWS-DROPPED W-SHORT",
        (59.99, 0.0, 0.0),
    ),
)
