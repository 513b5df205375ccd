"""What must become of each bad file: one line for each kind of damage and its variants.

Times are those of the file of one minute: recorded = analysed + missing + excluded.
"""

import gzip
import zipfile
from datetime import datetime
from functools import partial

from tests.badfiles import gt3x_files as g
from tests.badfiles import person_files as p
from tests.badfiles import signal_files as s
from tests.badfiles import table_files as t
from tests.badfiles.axivity_rows import AXIVITY
from tests.badfiles.clock_rows import CLOCKS
from tests.badfiles.order_rows import ORDER
from tests.badfiles.outcomes import read, read_gt3x, refused, refused_gt3x
from tests.badfiles.signal_rows import SIGNALS
from tests.fusion.readers.gt3x.gt3x_builder import INFO, T0, record, schema
from tests.fusion.readers.tables.table_builder import HEADER

ALWAYS = frozenset({"W-FEW-HOURS", "W-NPOSE", "W-POSE-ASSUMED", "W-WHICH-POSE", "W-POSE-UNSTEADY"})
"""What any recording of an hour without sway is told whose pose nobody stated."""
WHOLE, DEFLATED = g.pack(g.LOG), g.pack(g.LOG, compression=zipfile.ZIP_DEFLATED)
CANON, ZEROS = t.canon().encode(), b"0,0,0,0,0,0,0\n"


HTML = b"<!DOCTYPE html><html><body>404 Not Found</body></html>"


CONTAINERS = (
    refused("1", b"", "E-EMPTY"),
    refused("1 zeros", lambda: bytes(200_000), "E-BLANK"),
    refused_gt3x("2", t.canon, "E-EXT, kind=text, right=.csv"),
    refused("2 another name", lambda: WHOLE, "E-EXT, right=.gt3x"),
    refused(
        "3 xlsx",
        partial(g.archive, {"[Content_Types].xml": "<Types/>", "xl/workbook.xml": "<workbook/>"}),
        "E-TYPE",
    ),
    refused("3 docx", partial(g.archive, {"word/document.xml": "<d/>"}), "E-TYPE"),
    refused("3 pdf", lambda: b"%PDF-1.7\n" + b"x" * 500, "E-TYPE"),
    refused("3 jpg", lambda: b"\xff\xd8\xff\xe0" + bytes(500), "E-TYPE"),
    refused("3 html", HTML, "E-TYPE"),
    refused_gt3x("4", lambda: WHOLE[: len(WHOLE) // 2], "E-ZIP-TRUNC, n=63590"),
    refused_gt3x("5", lambda: WHOLE[:-22], "E-ZIP-TRUNC, n=127159"),
    refused_gt3x(
        "6", lambda: g.spoil(DEFLATED, 20_000, DEFLATED[20_000] ^ 0x55), "E-ZIP-CRC, member=log.bin"
    ),
    refused_gt3x("7", partial(g.archive, {"info.txt": INFO}), "E-GT3X-PART, member=log.bin"),
    refused_gt3x("8", partial(g.archive, {"log.bin": g.LOG}), "E-GT3X-PART, member=info.txt"),
    refused_gt3x("9", partial(g.pack, b""), "E-NO-SAMPLES"),
    refused_gt3x(
        "10", partial(g.archive, {"activity.bin": b"x", "lux.bin": b"", "info.txt": INFO}), "E-GT3X-OLD"
    ),
    refused_gt3x("11", g.doubled_log, "E-ZIP-UNSAFE, reason=duplicate"),
    refused_gt3x("12 up", partial(g.with_member, "../../../tmp/evil.txt"), "E-ZIP-UNSAFE, reason=name"),
    refused_gt3x("12 absolute", partial(g.with_member, "/etc/passwd"), "E-ZIP-UNSAFE, reason=name"),
    refused_gt3x("12 backslash", partial(g.with_member, "..\\evil.txt"), "E-ZIP-UNSAFE, reason=name"),
    refused_gt3x("12 drive", partial(g.with_member, "C:evil.txt"), "E-ZIP-UNSAFE, reason=name"),
    refused_gt3x("12 link", partial(g.with_member, "x", link=True), "E-ZIP-UNSAFE, reason=link"),
    refused_gt3x(
        "13",
        partial(g.archive, {"log.bin": g.LOG, "info.txt": INFO, **{f"m{k}": b"" for k in range(200)}}),
        "E-ZIP-UNSAFE, reason=members",
    ),
    refused_gt3x(
        "14", lambda: g.pack(bytes(64 << 20), compression=zipfile.ZIP_DEFLATED), "E-ZIP-UNSAFE, reason=ratio"
    ),
    refused_gt3x("15", g.lying_index, "E-ZIP-CRC"),
    refused_gt3x("16 encrypted", g.encrypted, "E-ZIP-UNSAFE, reason=encrypted"),
    refused_gt3x(
        "16 compression",
        partial(g.pack, g.LOG, compression=zipfile.ZIP_LZMA),
        "E-ZIP-UNSAFE, reason=compression",
    ),
    refused(
        "16 nested",
        partial(g.archive, {"shift.gt3x": WHOLE}),
        "E-ZIP-UNSAFE, reason=nested",
        name="shift.zip",
    ),
    refused("16 gt3x.gz", t.gzipped(WHOLE), "E-ZIP-UNSAFE", name="shift.gt3x.gz"),
    refused("16 gz.gz", t.gzipped(t.gzipped(CANON)()), "E-ZIP-UNSAFE", name="shift.csv.gz"),
    refused(
        "16 gz bomb",
        lambda: gzip.compress(CANON + ZEROS * (4 << 20), 9, mtime=0),
        "E-ZIP-UNSAFE",
        name="shift.csv.gz",
    ),
    refused("16 gz cut", t.gzipped(CANON, 0.5), "E-ZIP-TRUNC", name="shift.csv.gz"),
    refused(
        "16 gz flipped",
        lambda: g.spoil(t.gzipped(CANON)(), 50_000, t.gzipped(CANON)()[50_000] ^ 0x55),
        "E-ZIP-CRC",
        name="shift.csv.gz",
    ),
    read("16 csv.gz", t.gzipped(CANON), name="shift.csv.gz"),
    read("16 csv in zip", t.zipped("shift.csv"), name="shift.zip"),
    refused("16 two csv in zip", t.zipped("a.csv", "b.csv"), "E-SENSORS", name="shift.zip"),
)

GONE = (59.0, 1.0, 0.0)
ODD = record(77, T0, b"?") + record(4, T0, b"\x01") + record(2, T0, b"") + record(13, T0, b"\xff" * 3)
RECORDS = (
    read_gt3x("17", partial(g.pack, g.LOG[:-700]), "W-TRUNC-TAIL W-SHORT", (59.0, 0.0, 0.0)),
    read_gt3x("18", g.damaged(21, -1, bytes([g.second(20)[-1] ^ 0xFF])), "W-CHECKSUM W-GAP W-SHORT", GONE),
    read_gt3x("19", g.wrong_checksum_in_sleep, "W-CHECKSUM W-SLEEP W-SHORT", (50.0, 0.0, 10.0)),
    read_gt3x("20", g.damaged(20, 0, b"\x1f"), "W-RESYNC W-GAP W-SHORT", GONE),
    read_gt3x("21", g.damaged(20, 6, b"\x60\xea"), "W-RESYNC W-GAP W-SHORT", GONE),
    read_gt3x("22 zeros", g.damaged(20, 100, bytes(4096)), "W-RESYNC W-GAP W-SHORT", (58.0, 2.0, 0.0)),
    read_gt3x(
        "22 text",
        g.damaged(20, 100, (b"the quick brown fox jumps over the lazy dog. " * 92)[:4096]),
        "W-RESYNC W-GAP W-SHORT",
        (58.0, 2.0, 0.0),
    ),
    read_gt3x("23", partial(g.later, 20, 60), "W-GAP count=1 first_s=20.0", (60.0, 60.0, 0.0)),
    read_gt3x("24", g.replaced(20, g.second(20) * 2), "W-DUP"),
    read_gt3x("25", g.replaced(20, g.second(20) + g.second(22, stamp=20)), "W-DUP-CONFLICT"),
    read_gt3x("26", partial(g.later, 20, -3600), "W-CLOCK-BACK"),
    read_gt3x("27", g.replaced(20, g.second(20, stamp=20 + g.YEAR_S)), "W-CLOCK-FWD"),
    read_gt3x("28", g.replaced(20, g.second(20, stamp=-T0)), "W-CLOCK-FWD"),
    read_gt3x("29 1970", g.never_set(0), "W-CLOCK-UNSET"),
    read_gt3x("29 2099", g.never_set(4_070_908_800), "W-CLOCK-UNSET"),
    read_gt3x("30", g.replaced(20, g.second(20, n_rows=99)), "W-SEC-COUNT"),
    read_gt3x("31", g.replaced(20, g.second(20, n_rows=101))),
    read_gt3x("32", g.replaced(20, record(0, T0 + 20, b"\0")), "W-DOCKED W-SHORT", (59.0, 0.0, 1.0)),
    read_gt3x("33", g.asleep(20, 30), "W-SLEEP W-SHORT", (50.0, 0.0, 10.0)),
    read_gt3x("34", g.asleep(40, 60, leaves=False), "W-SLEEP W-SHORT", (40.0, 0.0, 20.0)),
    read_gt3x("35", partial(g.pack, record(3, T0, b"\x09") + g.LOG)),
    read_gt3x("36", g.asleep(0, 10), "W-SLEEP W-SHORT", (50.0, 0.0, 0.0)),
    read_gt3x(
        "37",
        partial(g.pack, g.LOG + record(3, T0 + 30, b"\x08") + record(3, T0 + 200_000, b"\x09")),
        "W-CLOCK-FWD",
    ),
    read_gt3x("38", partial(g.pack, g.SCHEMA + ODD + g.seconds())),
    read_gt3x("39", partial(g.many_records, 77, b"x", 1_000_000)),
    read_gt3x("40", partial(g.many_records, 0, b"", 100_000)),
    refused_gt3x(
        "41", partial(g.pack, b"".join(record(26, T0 + k, bytes(540)) for k in range(60))), "E-NO-GYRO"
    ),
    refused_gt3x("42 missing", partial(g.pack, g.seconds()), "E-GT3X-PART, member=SENSOR_SCHEMA"),
    refused_gt3x(
        "42 scale 0", partial(g.pack, record(24, T0, schema(acc_divisor=0.0)) + g.seconds()), "E-COLS"
    ),
    read_gt3x("42 late", partial(g.pack, g.seconds(range(5)) + g.SCHEMA + g.seconds(range(5, 60)))),
    read_gt3x("42 changed", g.schema_changed),
    read_gt3x("42 unknown column", g.strange_column),
    read_gt3x("42 8 bits", g.eight_bits, "W-RESOLUTION"),
    read_gt3x("43", partial(g.pack, g.with_primary(0.7)), "W-BIAS"),
    read_gt3x("43 agreeing", partial(g.pack, g.with_primary())),
    read_gt3x("44", g.with_info(INFO.replace("TAS1E", "MOS2E").replace("1.7.2", "1.6.0")), "W-FIRMWARE"),
    read_gt3x("44 TAS", g.with_info(INFO.replace("1.7.2", "1.6.0"))),
    read_gt3x("45", g.with_info(INFO.replace("Resets: 0", "Resets: 3")), "W-RESETS"),
    read_gt3x(
        "45 battery", partial(g.pack, g.LOG + record(2, T0 + 59, (3300).to_bytes(2, "little"))), "W-BATTERY"
    ),
)

RATE_LINE = "Sample Rate: 100\r\n"
INFO_AND_TIME = (
    read_gt3x("46 mark", g.with_info("\ufeff" + INFO)),
    read_gt3x("46 LF", g.with_info(INFO.replace("\r\n", "\n"))),
    read_gt3x("47", g.with_info(INFO + "Acceleration Max: 8,0\r\nBattery Voltage: 4,03\r\n")),
    read_gt3x("48 missing", g.with_info(INFO.replace(RATE_LINE, "")), "W-RATE"),
    read_gt3x("48 zero", g.with_info(INFO.replace("Rate: 100", "Rate: 0")), "W-RATE"),
    read_gt3x("49", g.with_info(INFO.replace("Rate: 100", "Rate: 30"), g.with_primary()), "W-RATE"),
    read_gt3x("50", g.with_info(INFO.replace("Rate: 100", "Rate: 100 Hz"))),
    read_gt3x("51", g.with_info(INFO)),
    read_gt3x("52", g.with_info((INFO + "Subject Name: Renée\r\n").encode("latin-1")), "W-ENCODING"),
    read_gt3x("53", g.with_info(INFO + "Subject Name: a:b:\u202e\x07" + "x" * 4096 + "\r\n")),
    read_gt3x("54", g.with_info(INFO + "Subject Name: <img onerror=1>{{7*7}}=cmd|x\r\n")),
    read_gt3x("55", partial(g.pack, record(6, T0, b'{"UsedUtc":true}') + g.LOG)),
    read_gt3x(
        "55 no zone",
        g.with_info(INFO.replace("TimeZone: -05:00:00\r\n", ""), record(6, T0, b'{"UsedUtc":true}') + g.LOG),
        "W-TZ",
    ),
    *CLOCKS,
    read_gt3x("57 plus", g.with_info(INFO.replace("-05:00:00", "05:30:00"))),
    read_gt3x("57 minus", g.with_info(INFO.replace("-05:00:00", "-03:30:00"))),
    read_gt3x("57 garbage", g.with_info(INFO.replace("-05:00:00", "rubbish")), "W-TZ"),
    read_gt3x(
        "58", g.with_info(INFO.replace("Stop Date: 0", "Stop Date: 639080640000000000")), "W-EARLY-END"
    ),
)


def replace_last(word: str, line: str) -> str:
    return line.rsplit(",", 1)[0] + "," + word


XML = '<?xml version="1.0"?>'
SECOND_OF_MARCH = datetime(2026, 3, 2, 8)  # noqa: DTZ001 - a device's own clock
FOURTH_OF_MARCH = datetime(2026, 3, 4, 8)  # noqa: DTZ001
BEFORE_MIDNIGHT = datetime(2026, 3, 14, 23, 59, 30)  # noqa: DTZ001
DAY_FIRST = "%d/%m/%Y %H:%M:%S.%f"
LABELLED = [f"{row},{'walking slowly' if k < 3000 else 'pause'},D422CD" for k, row in enumerate(t.values())]
ROW_LOST = (59.99, 0.01, 0.0)
TABLES = (
    refused("59", lambda: HEADER + "\n", "E-NO-SAMPLES"),
    read("60 mark", lambda: "\ufeff" + t.canon()),
    read("60 CRLF", lambda: t.canon().replace("\n", "\r\n")),
    read("60 CR", lambda: t.canon().replace("\n", "\r")),
    read("60 blank", t.line_changed(2000, lambda line: line + "\n")),
    read("61 UTF-16", lambda: t.canon().encode("utf-16"), "W-ENCODING"),
    read("61 UTF-16 BE", lambda: ("\ufeff" + t.canon()).encode("utf-16-be"), "W-ENCODING"),
    read("61 Latin-1", lambda: t.canon().replace("time_us", "temps_µs").encode("latin-1"), "W-ENCODING"),
    read("62", lambda: t.french(t.canon()), "W-LOCALE"),
    refused("63", lambda: t.french(t.canon(), ","), "E-DECIMAL"),
    read("64", partial(t.wholes_first, 600), "W-LOCALE", (66.0, 0.0, 0.0)),
    read("65 tab", lambda: t.canon().replace(",", "\t"), name="shift.txt"),
    refused(
        "65 thousands", lambda: t.stamped([f"{us:,}" for us in t.MICROS[1000:]], t.values()[1000:]), "E-COLS"
    ),
    read(
        "65 single spaces", partial(t.single_spaces, "// Update Rate: 100.0Hz\n"), "W-RATE", name="shift.txt"
    ),
    refused("65 single spaces, no rate", t.single_spaces, "E-RATE", name="shift.txt"),
    read("66", t.line_changed(2000, lambda line: line + "\n" + HEADER), "W-HEADER-REPEAT"),
    refused("67", lambda: t.canon().split("\n", 1)[1], "E-COLS"),
    read("68", lambda: t.canon()[:-20], "W-TRUNC-TAIL W-SHORT", (59.99, 0.0, 0.0)),
    read(
        "69",
        lambda: t.canon()[:100_000] + "\0" * 4096 + t.canon()[104_096:],
        "W-ROWS-DROPPED W-GAP W-SHORT",
        (59.17, 0.83, 0.0),
    ),
    read(
        "70",
        t.lines_changed(lambda x: [*x[:2000], x[2000][:30] + x[2001], *x[2002:]]),
        "W-ROWS-DROPPED W-GAP W-SHORT",
        (59.98, 0.02, 0.0),
    ),
    read("71 fewer", t.line_changed(2000, lambda x: x[:20]), "W-ROWS-DROPPED W-GAP W-SHORT", ROW_LOST),
    read("71 more", t.line_changed(2000, lambda x: x + ",7,8"), "W-ROWS-DROPPED W-GAP W-SHORT", ROW_LOST),
    *(
        read(
            f"71 {word}",
            t.line_changed(2000, partial(replace_last, word)),
            "W-ROWS-DROPPED W-GAP W-SHORT",
            ROW_LOST,
        )
        for word in ("x", "1e99")
    ),
    refused(
        "71 many", t.lines_changed(lambda x: [*x[:2000], *["?"] * 500, *x[2500:]]), "E-ROW, k=500, line=2001"
    ),
    *(
        read(
            f"72 {word or 'empty'}",
            t.line_changed(2000, partial(replace_last, word)),
            "W-NAN W-GAP W-SHORT",
            ROW_LOST,
        )
        for word in ("NaN", "inf", "-inf", "-", "")
    ),
    read("73", t.line_changed(2000, lambda x: x.replace(",", ',"', 1))),
    refused("74", lambda: b"1" * (50 << 20), "E-TYPE"),
    read(
        "75", lambda: t.stamped([(2**32 - 20_000_000 + us) % 2**32 for us in t.MICROS], t.values()), "W-WRAP"
    ),
    read("76 millis", t.whole_milliseconds, "W-SHORT"),
    read("76 seconds", t.whole_seconds, "W-JITTER"),
    read("77", t.late_rows, "W-ORDER"),
    read(
        "77 set back",
        lambda: t.stamped(
            [4 * 10**9 + us - 3_600_000_000 * (us >= 30_000_000) for us in t.MICROS], t.values()
        ),
        "W-CLOCK-BACK",
    ),
    *ORDER,
    read("78", t.stalls, "W-GAP", (60.0, 3.56, 0.0)),
    read("79 d/M", partial(t.calendar_table, DAY_FIRST)),
    read("79 M/d", partial(t.calendar_table, "%m/%d/%Y %H:%M:%S.%f")),
    read("79 d.M", partial(t.calendar_table, "%d.%m.%Y %H:%M:%S.%f")),
    *(
        refused(f"79 {name}", partial(t.calendar_table, pattern, FOURTH_OF_MARCH), "E-TIME, why=date-order")
        for name, pattern in (("either", DAY_FIRST), ("year of two digits", "%d/%m/%y %H:%M:%S.%f"))
    ),
    read("79 compact", partial(t.calendar_table, "%Y%m%dT%H%M%S.%f")),
    read(
        "79 no date, over midnight",
        partial(t.calendar_table, "%H:%M:%S.%f", BEFORE_MIDNIGHT),
        "W-NO-DATE",
    ),
    read("79 AM", partial(t.zoned, " AM", "%I:%M:%S.%f"), "W-NO-DATE"),
    read("79 month's name", partial(t.calendar_table, "%d %b %Y %H:%M:%S.%f")),
    read("79 two columns", t.date_and_time),
    read("79 ActiLife", partial(t.actilife, "dd/MM/yyyy", "14/03/2026")),
    read("79 ActiLife lying", partial(t.actilife, "dd/MM/yyyy", "03/14/2026")),
    read(
        "79 ActiLife, saved again in French",
        partial(t.resaved, DAY_FIRST, SECOND_OF_MARCH, "3/2/2026"),
        "W-LOCALE",
    ),
    read(
        "79 ActiLife, header of another day",
        partial(t.resaved, DAY_FIRST, SECOND_OF_MARCH, "9/9/2025"),
        "W-LOCALE W-DATE-ORDER",
    ),
    read("79 ActiLife stamps", partial(t.actilife, stamps=True)),
    refused("80 tenths", t.excel_times, "E-TIME"),
    refused(
        "80 minutes",
        lambda: t.stamped(["3/14/2026 8:00"] * 6000, t.values(), "timestamp," + t.NAMES),
        "E-TIME",
    ),
    read(
        "80 decimals",
        lambda: t.stamped(t.MICROS, [",".join(f"{one:.2f}" for one in row) for row in s.readings().tolist()]),
        "W-PRECISION",
    ),
    refused("81", t.excel_cut, "E-EXCEL-CUT"),
    refused(
        "82",
        lambda: (
            t.actilife(epoch="00:00:01").split("Acc")[0] + "Axis1,Axis2,Axis3,Steps\n" + "12,5,9,0\n" * 600
        ),
        "E-EPOCH",
    ),
    read(
        "83",
        lambda: t.canon().replace(
            HEADER, "Timestamp (us),AccX(g),AccY(g),AccZ(g),GyroX(dps),GyroY(dps),GyroZ(dps)"
        ),
    ),
    read("83 words beside the readings", lambda: t.stamped(t.MICROS, LABELLED, HEADER + ",activity,device")),
    read("83 French", t.french_names, "W-LOCALE"),
    read("83 French, cp1252", lambda: t.french_names().encode("cp1252"), "W-LOCALE W-ENCODING"),
    refused(
        "84 DTD",
        lambda: f"{XML}<!DOCTYPE m [<!ENTITY a 'b'>]><mvnx/>",
        "E-XML, reason=forbidden",
        name="shift.mvnx",
    ),
    refused(
        "84 entity",
        lambda: f"{XML}<!DOCTYPE m SYSTEM 'http://[::1]/'><mvnx/>",
        "E-XML, reason=forbidden",
        name="shift.mvnx",
    ),
    refused(
        "84 cut",
        lambda: f"{XML}<mvnx version='4'><subject><frames>",
        "E-XML, reason=broken",
        name="shift.mvnx",
    ),
)

PERSONS = (
    refused("91 never still", p.swing(0.0), "E-CALIBRATION"),
    refused("91 still for 1 s", p.swing(1.0), "E-CALIBRATION"),
    read("91 still for 3 s", p.swing(3.0), "W-NO-STILL"),
    read("92 upside down", p.turned((1, -1, -1))),
    read("92 other side", p.turned((-1, -1, 1))),
    read("93", p.put_back_turned, "W-PUT-BACK W-GAP", (5403.52, 360.0, 0.0)),
    read("94", p.left_on_a_desk, "W-NONWEAR", (780.0, 0.0, 0.0)),
    read("96 twice in one file", p.the_same_twice, "W-DUP"),
)

PARTS = {
    "A. Container": CONTAINERS,
    "B. Records in log.bin": RECORDS,
    "C. info.txt and time": INFO_AND_TIME,
    "D. Tables": TABLES,
    "E. Signal and sensor": SIGNALS,
    "E. Person": PERSONS,
    "F. Axivity .cwa": AXIVITY,
}
BAD_FILES = tuple(bad for part in PARTS.values() for bad in part)
