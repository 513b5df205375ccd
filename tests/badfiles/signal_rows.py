"""What must become of files by their signals: units, axes, faults of the sensor (rows 85 to 90, 95)."""

from tests.badfiles import gt3x_files as g
from tests.badfiles import signal_files as s
from tests.badfiles import table_files as t
from tests.badfiles.outcomes import given, read, refused
from tests.fusion.readers.tables.table_builder import HEADER

FILLED = "W-STUCK-PART W-GAP"
SIGNALS = (
    read("85", "shift.csv", given("# rate_hz: 104\n" + t.canon()), "W-DRIFT"),
    read("85 nominal", "shift.csv", given("# rate_hz: 100\n" + t.canon())),
    read("86 m/s2", "shift.csv", s.scaled(9.80665, 1.0), "W-UNITS"),
    read("86 mg", "shift.csv", s.scaled(1000.0, 1.0), "W-UNITS"),
    read("86 mg under g", "shift.csv", s.scaled(1000.0, 1.0, HEADER), "W-UNITS"),
    read("86 m/s2 under g", "shift.csv", s.scaled(9.80665, 1.0, HEADER), "W-UNITS"),
    *(
        read(f"86 {true} under {named}", "shift.csv", given(t.misnamed(named, per_s)), "W-UNITS")
        for true, named, per_s in (
            ("s", "ms", 1),
            ("ms", "s", 1000),
            ("ms", "us", 1000),
            ("us", "ms", 1_000_000),
        )
    ),
    refused("86 ten seconds", "shift.csv", given(t.every_ten_seconds()), "E-RATE"),
    read("86 rad/s", "shift.csv", s.scaled(1.0, 0.0174533, times=8), "W-UNITS", (480.0, 0.0, 0.0)),
    refused("86 x2", "shift.csv", s.scaled(2.0, 1.0), "E-SCALE"),
    refused("86 x0.5", "shift.csv", s.scaled(0.5, 1.0, HEADER), "E-SCALE"),
    refused("87 swapped", "shift.csv", s.altered(s.swap_sensors, times=8), "E-SWAPPED"),
    refused("87 swapped, much movement", "shift.csv", s.tumbled(s.swap_sensors), "E-SWAPPED"),
    refused("87 swapped, and gyro late", "shift.csv", s.tumbled(s.swap_and_delay), "E-SWAPPED"),
    refused("87 permuted", "shift.csv", s.tumbled(s.permute_gyro), "E-MIXED"),
    refused("87 one sign", "shift.csv", s.tumbled(s.flip_gyro_y), "E-MIXED"),
    read("87 left-handed", "shift.csv", s.tumbled(s.left_handed), "W-UNITS", (240.0, 0.0, 0.0)),
    read("87 right", "shift.csv", s.tumbled(s.leave), "", (240.0, 0.0, 0.0)),
    *(
        refused(f"87 {name}", "shift.csv", s.tumbled(change), "E-MIXED")
        for name, change in (
            ("acc xy swapped", s.order_acc(1, 0, 2)),
            ("acc yz swapped", s.order_acc(0, 2, 1)),
            ("acc xz swapped", s.order_acc(2, 1, 0)),
            ("acc turned round", s.order_acc(1, 2, 0)),
        )
    ),
    *(
        read(f"87 {name}", "shift.csv", s.tumbled(change), "W-UNITS", (240.0, 0.0, 0.0))
        for name, change in (
            ("gyro negated", s.negate_gyro),
            ("gyro x0.001", s.multiply_gyro(0.001)),
            ("gyro x1000", s.multiply_gyro(1000.0)),
        )
    ),
    *(
        read(f"87 gyro x{factor}", "shift.csv", s.tumbled(s.multiply_gyro(factor)), warnings, times_s)
        for factor, warnings, times_s in (
            (0.5, "W-SCALE-DOUBT W-UNTRUSTED", (166.0, 74.0, 0.0)),
            (0.87, "W-SCALE-DOUBT W-UNTRUSTED", (235.0, 5.0, 0.0)),
            (1.3, "W-SCALE-DOUBT W-UNTRUSTED", (145.0, 95.0, 0.0)),
            (2.0, "W-SCALE-DOUBT W-UNTRUSTED W-LOWCOVER", (62.0, 178.0, 0.0)),
        )
    ),
    read(
        "87 gyro z x2",
        "shift.csv",
        s.tumbled(s.multiply_gyro(2.0, slice(5, 6))),
        "W-SCALE-DOUBT W-UNTRUSTED W-LOWCOVER",
        (90.0, 150.0, 0.0),
    ),
    read("87 GT9X right", "shift.csv", s.tumbled(s.leave, s.write_actilife), "", (240.0, 0.0, 0.0)),
    *(
        refused(f"87 GT9X {name}", "shift.csv", s.tumbled(change, s.write_actilife), "E-MIXED")
        for name, change in (
            ("gyro negated", s.negate_gyro),
            ("gyro swapped", s.permute_gyro),
            ("gyro rad/s", s.multiply_gyro(0.0174533)),
        )
    ),
    refused("86 no unit, no movement", "shift.csv", s.altered(s.hang, s.UNITLESS), "E-UNIT"),
    refused("87 gyro late", "shift.csv", s.tumbled(s.delay_gyro(50)), "E-MIXED"),
    refused("87 gyro noise", "shift.csv", s.tumbled(s.noise_for_gyro), "E-MIXED"),
    refused("87 acc x x1.5", "shift.csv", s.turned_all_round(s.stretch_acc(1.5)), "E-SCALE"),
    read("86 mdps", "shift.csv", s.altered(s.multiply_gyro(1000.0)), "W-UNITS"),
    refused("86 impossible rate", "shift.csv", s.altered(s.wild_at_rest), "E-SCALE"),
    read("88", "shift.csv", s.altered(s.throw, s.PREAMBLE + HEADER), "W-CLIP W-SHORT", (59.7, 0.0, 0.3)),
    refused("89 one axis", "shift.csv", s.altered(s.dead_axis), "E-DEAD"),
    refused("89 all zero", "shift.csv", s.altered(s.all_zero), "E-DEAD"),
    read("89 part", "shift.csv", s.altered(s.freeze_axis), "W-STUCK-PART W-SHORT", (50.0, 0.0, 10.0)),
    read("89 zeros", "shift.csv", s.altered(s.zero_part), f"{FILLED} W-SHORT", (57.0, 3.0, 0.0)),
    read("89 zeros, 10 ms", "shift.csv", s.altered(s.zeros_of(1)), f"{FILLED} W-SHORT", (59.95, 0.05, 0.0)),
    read("89 zeros, 0.4 s", "shift.csv", s.altered(s.zeros_of(40)), f"{FILLED} W-SHORT", (58.0, 2.0, 0.0)),
    read(
        "89 zeros, 0.4 s, GT9X",
        "shift.csv",
        s.rewritten(s.zeros_of(40), s.write_actilife),
        f"{FILLED} W-SHORT",
        (58.0, 2.0, 0.0),
    ),
    read("89 zeros, 1.4 s every 10 s", "shift.csv", s.tumbled(s.zeros_of(140)), FILLED, (207.8, 32.2, 0.0)),
    read("89 acc zero, 80 ms", "shift.csv", s.altered(s.zero_acc), f"{FILLED} W-SHORT", (59.6, 0.4, 0.0)),
    read("89 repeats", "shift.csv", s.altered(s.repeats), f"{FILLED} W-SHORT", (57.0, 3.0, 0.0)),
    read("90", "shift.csv", s.altered(s.spikes), "W-SPIKE W-SHORT", (59.92, 0.0, 0.08)),
    read(
        "95 days",
        "shift.gt3x",
        g.three_days,
        "W-GAP W-MULTIDAY W-LOWCOVER W-PUT-BACK",
        (60.0, 158_400.0, 0.0),
    ),
    refused("95 tiny", "shift.csv", given(t.canon()[:200]), "E-SHORT"),
)
