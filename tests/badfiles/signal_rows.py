"""What must become of files by their signals: units, axes, faults of the sensor (rows 85 to 90, 95)."""

from functools import partial

from tests.badfiles import gt3x_files as g
from tests.badfiles import signal_files as s
from tests.badfiles import table_files as t
from tests.badfiles.outcomes import read, read_gt3x, refused
from tests.fusion.readers.tables.table_builder import HEADER

FILLED = "W-STUCK-PART W-GAP"
SWAP, PERMUTE = s.mixed((3, 4, 5, 0, 1, 2)), s.mixed((0, 1, 2, 4, 5, 3))
SIGNALS = (
    read("85", lambda: "# rate_hz: 104\n" + t.canon(), "W-DRIFT"),
    read("85 nominal", lambda: "# rate_hz: 100\n" + t.canon()),
    read("86 m/s2", s.scaled(9.80665, 1.0), "W-UNITS"),
    read("86 mg", s.scaled(1000.0, 1.0), "W-UNITS"),
    read("86 mg under g", s.scaled(1000.0, 1.0, HEADER), "W-UNITS"),
    read("86 m/s2 under g", s.scaled(9.80665, 1.0, HEADER), "W-UNITS"),
    *(
        read(
            f"86 {true} under {named}",
            partial(t.misnamed, named, per_s),
            f"W-UNITS unit={named} read_as={true}",
        )
        for true, named, per_s in (
            ("s", "ms", 1),
            ("ms", "s", 1000),
            ("ms", "us", 1000),
            ("us", "ms", 1_000_000),
            ("ns", "s", 1_000_000_000),
        )
    ),
    refused(
        "86 ten seconds",
        t.every_ten_seconds,
        "E-RATE, m=0.1, unit=s, other_unit=ms, other_hz=100.0, cure=time unit",
    ),
    read("86 rad/s", s.scaled(1.0, 0.0174533, times=8), "W-UNITS", (480.0, 0.0, 0.0)),
    refused("86 x2", s.scaled(2.0, 1.0), "E-SCALE, g=2.0"),
    refused("86 x0.5", s.scaled(0.5, 1.0, HEADER), "E-SCALE, g=0.5"),
    refused("87 swapped", s.altered(SWAP, times=8), "E-SWAPPED"),
    refused("87 swapped, much movement", s.tumbled(SWAP), "E-SWAPPED"),
    refused("87 swapped, and gyro late", s.tumbled(s.in_turn(s.delay_gyro(50), SWAP)), "E-SWAPPED"),
    refused("87 permuted", s.tumbled(PERMUTE), "E-MIXED"),
    refused("87 one sign", s.tumbled(s.mixed(factors=(1, 1, 1, 1, -1, 1))), "E-MIXED"),
    read("87 left-handed", s.tumbled(s.mixed(factors=(-1, 1, 1, -1, 1, 1))), "W-UNITS", (240.0, 0.0, 0.0)),
    read("87 right", s.tumbled(s.leave), "", (240.0, 0.0, 0.0)),
    *(
        refused(f"87 {name}", s.tumbled(change), "E-MIXED")
        for name, change in (
            ("acc xy swapped", s.mixed((1, 0, 2, 3, 4, 5))),
            ("acc yz swapped", s.mixed((0, 2, 1, 3, 4, 5))),
            ("acc xz swapped", s.mixed((2, 1, 0, 3, 4, 5))),
            ("acc turned round", s.mixed((1, 2, 0, 3, 4, 5))),
        )
    ),
    *(
        read(f"87 {name}", s.tumbled(change), "W-UNITS", (240.0, 0.0, 0.0))
        for name, change in (
            ("gyro negated", s.negate_gyro),
            ("gyro x0.001", s.multiply_gyro(0.001)),
            ("gyro x1000", s.multiply_gyro(1000.0)),
        )
    ),
    *(
        read(f"87 gyro x{factor}", s.tumbled(s.multiply_gyro(factor)), warnings, times_s)
        for factor, warnings, times_s in (
            (0.5, "W-SCALE-DOUBT W-UNTRUSTED", (166.0, 74.0, 0.0)),
            (0.87, "W-SCALE-DOUBT W-UNTRUSTED", (235.0, 5.0, 0.0)),
            (1.3, "W-SCALE-DOUBT W-UNTRUSTED", (145.0, 95.0, 0.0)),
            (2.0, "W-SCALE-DOUBT W-UNTRUSTED W-LOWCOVER", (62.0, 178.0, 0.0)),
        )
    ),
    read(
        "87 gyro z x2",
        s.tumbled(s.mixed(factors=(1, 1, 1, 1, 1, 2))),
        "W-SCALE-DOUBT W-UNTRUSTED W-LOWCOVER",
        (90.0, 150.0, 0.0),
    ),
    read("87 GT9X right", s.tumbled(s.leave, s.write_actilife), "", (240.0, 0.0, 0.0)),
    *(
        refused(f"87 GT9X {name}", s.tumbled(change, s.write_actilife), told)
        for name, change, told in (
            ("gyro negated", s.negate_gyro, "E-MIXED, factor=-1.0"),
            ("gyro swapped", PERMUTE, "E-MIXED"),
            ("gyro rad/s", s.multiply_gyro(0.0174533), "E-MIXED, factor=57.4"),
        )
    ),
    refused("86 no unit, no movement", s.altered(s.hang, s.UNITLESS), "E-UNIT, sensor=gyroscope"),
    refused(
        "86 registers, no movement",
        s.rewritten(s.hang, s.write_registers),
        "E-UNIT, sensor=gyroscope",
        name="shift.dat",
    ),
    refused("87 gyro late", s.tumbled(s.delay_gyro(50)), "E-MIXED"),
    refused("87 gyro noise", s.tumbled(s.noise_for_gyro), "E-MIXED"),
    refused("87 acc x x1.5", s.turned_all_round(s.mixed(factors=(1.5, 1, 1, 1, 1, 1))), "E-SCALE"),
    read("86 mdps", s.altered(s.multiply_gyro(1000.0)), "W-UNITS"),
    refused(
        "86 impossible rate",
        s.altered(s.in_turn(s.hang, s.multiply_gyro(1e5))),
        "E-SCALE, dps=80825, clock=+0.00 s",
    ),
    read("88", s.altered(s.throw, s.PREAMBLE + HEADER), "W-CLIP W-SHORT", (59.7, 0.0, 0.3)),
    refused("89 one axis", s.altered(s.filled(slice(None), slice(4, 5), 0.25)), "E-DEAD"),
    refused("89 all zero", s.altered(s.filled(slice(None), slice(None), 0.0)), "E-DEAD"),
    read(
        "89 part",
        s.altered(s.filled(slice(3000, 4000), slice(0, 1))),
        "W-STUCK-PART W-SHORT",
        (50.0, 0.0, 10.0),
    ),
    read(
        "89 zeros",
        s.altered(s.filled(slice(2000, 2300), slice(None), 0.0)),
        f"{FILLED} W-SHORT",
        (57.0, 3.0, 0.0),
    ),
    read("89 zeros, 10 ms", s.altered(s.zeros_of(1)), f"{FILLED} W-SHORT", (59.95, 0.05, 0.0)),
    read("89 zeros, 0.4 s", s.altered(s.zeros_of(40)), f"{FILLED} W-SHORT", (58.0, 2.0, 0.0)),
    read(
        "89 zeros, 0.4 s, GT9X",
        s.rewritten(s.zeros_of(40), s.write_actilife),
        f"{FILLED} W-SHORT",
        (58.0, 2.0, 0.0),
    ),
    read("89 zeros, 1.4 s every 10 s", s.tumbled(s.zeros_of(140)), FILLED, (207.8, 32.2, 0.0)),
    read("89 acc zero, 80 ms", s.altered(s.zero_acc), f"{FILLED} W-SHORT", (59.6, 0.4, 0.0)),
    read(
        "89 repeats",
        s.altered(s.filled(slice(2000, 2301), slice(None))),
        f"{FILLED} W-SHORT",
        (57.0, 3.0, 0.0),
    ),
    read("90", s.altered(s.spikes), "W-SPIKE W-SHORT", (59.92, 0.0, 0.08)),
    read_gt3x("95 days", g.three_days, "W-GAP W-MULTIDAY W-LOWCOVER W-PUT-BACK", (60.0, 158_400.0, 0.0)),
    refused("95 tiny", lambda: t.canon()[:200], "E-SHORT"),
)
