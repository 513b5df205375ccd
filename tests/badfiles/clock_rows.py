"""What must become of files by their clocks: UTC, epochs, daylight saving, names of zones (rows 55 to 57)."""

from tests.badfiles import gt3x_files as g
from tests.badfiles import table_files as t
from tests.badfiles.outcomes import given, read, refused

CLOCKS = (
    read("55 Z", "shift.csv", given(t.zoned("Z")), "W-UTC"),
    read("55 epoch s", "shift.csv", given(t.epoch(1, "s")), "W-UTC"),
    read("55 epoch ms", "shift.csv", given(t.epoch(1000, "ms")), "W-UTC"),
    read("55 epoch us", "shift.csv", given(t.epoch(1_000_000, "us")), "W-UTC"),
    read("55 epoch ns", "shift.csv", given(t.epoch(1_000_000_000, "ns")), "W-UTC"),
    read("56 fall, .gt3x in UTC", "shift.gt3x", lambda: g.over_a_change(1_793_512_800), "W-DST"),
    read("56 spring, .gt3x in UTC", "shift.gt3x", lambda: g.over_a_change(1_805_007_600), "W-DST"),
    read("56 fall, wall clock", "shift.csv", given(t.clock_changed("2026-11-01T01:59:30", -1)), "W-DST"),
    read("56 spring, wall clock", "shift.csv", given(t.clock_changed("2027-03-14T01:59:30", 1)), "W-DST"),
    read("56 fall, Paris", "shift.csv", given(t.clock_changed("2026-10-25T02:59:30", -1)), "W-DST"),
    read("56 spring, Paris", "shift.csv", given(t.clock_changed("2026-03-29T01:59:30", 1)), "W-DST"),
    *(
        read(f"56 {name}", "shift.csv", given(t.clock_changed(first, step_h, offsets, after_s)), "W-DST")
        for name, first, step_h, offsets, after_s in (
            ("fall, offsets", "2026-11-01T01:59:30", -1, ("-04:00", "-05:00"), 30),
            ("spring, offsets", "2027-03-14T01:59:30", 1, ("-05:00", "-04:00"), 30),
            ("fall, offsets, Paris", "2026-10-25T02:59:30", -1, ("+02:00", "+01:00"), 30),
            ("spring, offsets, Paris", "2026-03-29T01:59:30", 1, ("+01:00", "+02:00"), 30),
            ("fall, offsets, late", "2026-11-01T01:20:00", -1, ("-04:00", "-05:00"), 47),
            ("spring, offsets, early", "2027-03-14T01:20:00", 1, ("-05:00", "-04:00"), 3),
        )
    ),
    read(
        "56 offset changed in June",
        "shift.csv",
        given(t.clock_changed("2026-06-10T10:50:00", -1, ("-04:00", "-05:00"))),
        "W-OFFSET",
    ),
    read(
        "56 hour back in June", "shift.csv", given(t.clock_changed("2026-06-07T01:59:30", -1)), "W-CLOCK-BACK"
    ),
    read("57 EDT", "shift.csv", given(t.zoned(" EDT"))),
    read("57 HAE", "shift.csv", given(t.zoned(" HAE"))),
    refused("57 name of several zones", "shift.csv", given(t.zoned(" AST")), "E-TIME"),
)
