"""What must become of each bad `.cwa` of an Axivity AX6."""

import gzip
from functools import partial

from tests.badfiles import cwa_files as c
from tests.badfiles import table_files as t
from tests.badfiles.outcomes import read as read_any
from tests.badfiles.outcomes import refused as refuse_any
from tests.fusion.readers.cwa.cwa_builder import AX3, AX6, PACKED, START_US, THREE_AXES

read, refused = partial(read_any, name="shift.cwa"), partial(refuse_any, name="shift.cwa")

AXIVITY = (
    read("X1", c.whole),
    read("X1 gzip", lambda: gzip.compress(c.whole(), 1, mtime=0), name="shift.cwa.gz"),
    read("X1 header lost", lambda: b"\xff" * 1024 + c.whole()[1024:]),
    refused("X2 header only", c.joined, "E-NO-SAMPLES"),
    refused("X2 empty", b"", "E-EMPTY"),
    refused(
        "X3 wrong magic",
        lambda: c.whole().replace(b"MD", b"XX", 1).replace(b"AX\xfc\x01", b"XX\xfc\x01"),
        "E-TYPE",
    ),
    refused("X3 a table", t.canon, "E-EXT"),
    refused("X3 another name", c.whole, "E-EXT", name="shift.csv"),
    refused("X4 gyroscope off", c.plain(AX6, THREE_AXES), "E-NO-GYRO, cure=AX6"),
    refused("X4 AX3", c.plain(AX3, PACKED), "E-NO-GYRO, cure=AX6"),
    read("X5", lambda: c.whole()[:-100], "W-TRUNC-TAIL n=412 W-SHORT", (59.6, 0.0, 0.0)),
    read("X6", c.replaced(range(50, 51), c.spoil), "W-CHECKSUM W-GAP W-SHORT", (59.6, 0.4, 0.0)),
    read("X7", c.replaced(range(50, 53), lambda one: b"\xff" * len(one)), "W-GAP W-SHORT", (58.8, 1.2, 0.0)),
    read("X8", c.replaced(range(50, 55), lambda _: b""), "W-GAP W-SHORT", (58.0, 2.0, 0.0)),
    read("X9", c.replaced(range(50, 51), lambda one: b"the quick brown fox" + one), "W-RESYNC"),
    refused("X10", c.replaced(range(50, 60), c.spoil), "E-CORRUPT, p=6.7, clock=2026-03-02 08:00:19"),
    read("X11", c.other_session, "W-SESSION n=800"),
    read("X12", c.started_again, "W-GAP", (60.0, 30.0, 0.0)),
    read(
        "X13", lambda: c.joined(*(c.parts()[k] for k in (*range(20), 22, 21, 20, *range(23, 150)))), "W-ORDER"
    ),
    read("X14", lambda: c.joined(*c.parts()[:21], *c.parts()[10:]), "W-DUP W-ORDER"),
    read("X15 never set", c.moved(c.NUMBERS, c.YEAR_2000_US - START_US), "W-CLOCK-UNSET"),
    read(
        "X15 no stamps",
        lambda: c.joined(*(c.part(k, stamp=(0, 0, 0)) for k in c.NUMBERS)),
        "W-CLOCK-UNSET W-RATE",
    ),
    read("X16", c.moved(range(50, 51), c.YEAR_US), "W-CLOCK-FWD"),
    read("X17", c.moved(range(75, 150), -3_600_000_000), "W-CLOCK-BACK"),
    read("X18", c.half_the_rate),
)
