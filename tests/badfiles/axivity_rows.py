"""What must become of each bad `.cwa` of an Axivity AX6."""

from tests.badfiles import cwa_files as c
from tests.badfiles import table_files as t
from tests.badfiles.outcomes import given, read, refused

AXIVITY = (
    read("X1", "shift.cwa", c.whole),
    read("X1 gzip", "shift.cwa.gz", c.packed),
    read("X1 header lost", "shift.cwa", c.without_header),
    refused("X2 header only", "shift.cwa", given(c.joined()), "E-NO-SAMPLES"),
    refused("X2 empty", "shift.cwa", given(b""), "E-EMPTY"),
    refused("X3 wrong magic", "shift.cwa", c.wrong_magic, "E-TYPE"),
    refused("X3 a table", "shift.cwa", given(t.canon()), "E-EXT"),
    refused("X3 another name", "shift.csv", c.whole, "E-EXT"),
    refused("X4 gyroscope off", "shift.cwa", c.ax6_without_gyroscope, "E-NO-GYRO"),
    refused("X4 AX3", "shift.cwa", c.ax3_packed, "E-NO-GYRO"),
    read("X5", "shift.cwa", c.cut_in_a_block, "W-TRUNC-TAIL W-SHORT", (59.6, 0.0, 0.0)),
    read(
        "X6",
        "shift.cwa",
        c.replaced(range(50, 51), c.spoil),
        "W-CHECKSUM W-GAP W-SHORT",
        (59.6, 0.4, 0.0),
    ),
    read("X7", "shift.cwa", c.replaced(range(50, 53), c.wipe), "W-GAP W-SHORT", (58.8, 1.2, 0.0)),
    read("X8", "shift.cwa", c.replaced(range(50, 55), c.leave_out), "W-GAP W-SHORT", (58.0, 2.0, 0.0)),
    read("X9", "shift.cwa", c.replaced(range(50, 51), c.put_garbage), "W-RESYNC"),
    refused("X10", "shift.cwa", c.replaced(range(50, 60), c.spoil), "E-CORRUPT"),
    read("X11", "shift.cwa", c.other_session, "W-SESSION"),
    read("X12", "shift.cwa", c.started_again, "W-GAP", (60.0, 30.0, 0.0)),
    read("X13", "shift.cwa", c.late, "W-ORDER"),
    read("X14", "shift.cwa", c.doubled, "W-DUP W-ORDER"),
    read("X15 never set", "shift.cwa", c.never_set, "W-CLOCK-UNSET"),
    read("X15 no stamps", "shift.cwa", c.without_stamps, "W-CLOCK-UNSET W-RATE"),
    read("X16", "shift.cwa", c.moved(range(50, 51), c.YEAR_US), "W-CLOCK-FWD"),
    read("X17", "shift.cwa", c.moved(range(75, 150), -3_600_000_000), "W-CLOCK-BACK"),
    read("X18", "shift.cwa", c.half_the_rate),
)
