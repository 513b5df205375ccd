"""What must become of files by their clocks: UTC, epochs, daylight saving, names of zones (rows 55 to 57)."""

from functools import partial

from tests.badfiles import gt3x_files as g
from tests.badfiles import table_files as t
from tests.badfiles.outcomes import read, read_gt3x, refused

CLOCKS = (
    read("55 Z", partial(t.zoned, "Z"), "W-UTC"),
    read("55 epoch s", partial(t.epoch, 1, "s"), "W-UTC"),
    read("55 epoch ms", partial(t.epoch, 1000, "ms"), "W-UTC"),
    read("55 epoch us", partial(t.epoch, 1_000_000, "us"), "W-UTC"),
    read("55 epoch ns", partial(t.epoch, 1_000_000_000, "ns"), "W-UTC"),
    read_gt3x("56 fall, .gt3x in UTC", partial(g.over_a_change, 1_793_512_800), "W-DST"),
    read_gt3x("56 spring, .gt3x in UTC", partial(g.over_a_change, 1_805_007_600), "W-DST"),
    *(
        read(
            f"56 {name}",
            partial(t.clock_changed, first, step_h, offsets, after_s),
            f"W-DST step_s={3600 * step_h} first_s={after_s}",
        )
        for name, first, step_h, offsets, after_s in (
            ("fall, wall clock", "2026-11-01T01:59:30", -1, ("", ""), 30.0),
            ("spring, wall clock", "2027-03-14T01:59:30", 1, ("", ""), 30.0),
            ("fall, Paris", "2026-10-25T02:59:01", -1, ("", ""), 59.0),
            ("spring, Paris", "2026-03-29T01:59:59", 1, ("", ""), 1.0),
            ("fall, offsets", "2026-11-01T01:59:30", -1, ("-04:00", "-05:00"), 30.0),
            ("spring, offsets", "2027-03-14T01:59:30", 1, ("-05:00", "-04:00"), 30.0),
            ("fall, offsets, Paris", "2026-10-25T02:59:30", -1, ("+02:00", "+01:00"), 59.5),
            ("spring, offsets, Paris", "2026-03-29T01:59:30", 1, ("+01:00", "+02:00"), 0.5),
            ("fall, offsets, late", "2026-11-01T01:20:00", -1, ("-04:00", "-05:00"), 47.0),
            ("spring, offsets, early", "2027-03-14T01:20:00", 1, ("-05:00", "-04:00"), 3.0),
        )
    ),
    read(
        "56 offset changed in June",
        partial(t.clock_changed, "2026-06-10T10:50:00", -1, ("-04:00", "-05:00")),
        "W-OFFSET",
    ),
    read("56 hour back in June", partial(t.clock_changed, "2026-06-07T01:59:30", -1), "W-CLOCK-BACK"),
    read("57 EDT", partial(t.zoned, " EDT")),
    read("57 HAE", partial(t.zoned, " HAE")),
    refused("57 name of several zones", partial(t.zoned, " AST"), "E-TIME, why=zone name, line=2"),
    refused("57 name of no zone", partial(t.zoned, " XYZ"), "E-TIME, why=zone name, line=2"),
    refused("57 offset of no zone", partial(t.zoned, "+15:00"), "E-TIME, why=zone name, line=2"),
)
