"""What must become of each bad file: one line for each row of RELIABILITY.md §1.3 and its variants.

Times are those of the file of one minute: recorded = analysed + missing + excluded.
"""

from datetime import datetime

from tests.badfiles import gt3x_files as g
from tests.badfiles import person_files as p
from tests.badfiles import table_files as t
from tests.badfiles.axivity_rows import AXIVITY
from tests.badfiles.clock_rows import CLOCKS
from tests.badfiles.order_rows import ORDER
from tests.badfiles.outcomes import given, read, refused
from tests.badfiles.signal_rows import SIGNALS
from tests.fusion.readers.gt3x.gt3x_builder import INFO, T0, record
from tests.fusion.readers.tables.table_builder import HEADER

ALWAYS = frozenset({"W-FEW-HOURS", "W-NPOSE", "W-POSE-ASSUMED", "W-WHICH-POSE", "W-POSE-UNSTEADY"})
"""What any recording of an hour without sway is told whose pose nobody stated."""
HTML = b"<!DOCTYPE html><html><body>404 Not Found</body></html>"


CONTAINERS = (
    refused("1", "shift.csv", given(b""), "E-EMPTY"),
    refused("1 zeros", "shift.csv", given(bytes(200_000)), "E-BLANK"),
    refused("2", "shift.gt3x", given(t.canon()), "E-EXT"),
    refused("3 xlsx", "shift.csv", t.workbook, "E-TYPE"),
    refused("3 docx", "shift.csv", given(g.archive({"word/document.xml": "<d/>"})), "E-TYPE"),
    refused("3 pdf", "shift.csv", given(b"%PDF-1.7\n" + b"x" * 500), "E-TYPE"),
    refused("3 jpg", "shift.csv", given(b"\xff\xd8\xff\xe0" + bytes(500)), "E-TYPE"),
    refused("3 html", "shift.csv", given(HTML), "E-TYPE"),
    refused("4", "shift.gt3x", g.cut_in_half, "E-ZIP-TRUNC"),
    refused("5", "shift.gt3x", g.index_lost, "E-ZIP-TRUNC"),
    refused("6", "shift.gt3x", g.deflate_flipped, "E-ZIP-CRC"),
    refused("7", "shift.gt3x", given(g.archive({"info.txt": INFO})), "E-GT3X-PART"),
    refused("8", "shift.gt3x", given(g.archive({"log.bin": g.LOG})), "E-GT3X-PART"),
    refused("9", "shift.gt3x", given(g.pack(b"")), "E-NO-SAMPLES"),
    refused(
        "10",
        "shift.gt3x",
        given(g.archive({"activity.bin": b"x", "lux.bin": b"", "info.txt": INFO})),
        "E-GT3X-OLD",
    ),
    refused("11", "shift.gt3x", g.doubled_log, "E-ZIP-UNSAFE"),
    refused("12 up", "shift.gt3x", lambda: g.with_member("../../../tmp/evil.txt"), "E-ZIP-UNSAFE"),
    refused("12 absolute", "shift.gt3x", lambda: g.with_member("/etc/passwd"), "E-ZIP-UNSAFE"),
    refused("12 backslash", "shift.gt3x", lambda: g.with_member("..\\evil.txt"), "E-ZIP-UNSAFE"),
    refused("12 link", "shift.gt3x", lambda: g.with_member("x", link=True), "E-ZIP-UNSAFE"),
    refused("13", "shift.gt3x", g.many_members, "E-ZIP-UNSAFE"),
    refused("14", "shift.gt3x", g.zip_bomb, "E-ZIP-UNSAFE"),
    refused("15", "shift.gt3x", g.lying_index, "E-ZIP-CRC"),
    refused("16 encrypted", "shift.gt3x", g.encrypted, "E-ZIP-UNSAFE"),
    refused("16 compression", "shift.gt3x", g.strange_compression, "E-ZIP-UNSAFE"),
    refused("16 nested", "shift.zip", g.zip_in_zip, "E-ZIP-UNSAFE"),
    refused("16 gt3x.gz", "shift.gt3x.gz", t.gzipped(g.pack(g.LOG)), "E-ZIP-UNSAFE"),
    refused("16 gz.gz", "shift.csv.gz", t.gzipped(t.gzipped(t.canon().encode())()), "E-ZIP-UNSAFE"),
    refused("16 gz bomb", "shift.csv.gz", t.gzip_bomb, "E-ZIP-UNSAFE"),
    refused("16 gz cut", "shift.csv.gz", t.gzipped(t.canon().encode(), 0.5), "E-ZIP-TRUNC"),
    refused("16 gz flipped", "shift.csv.gz", t.gzip_flipped, "E-ZIP-CRC"),
    read("16 csv.gz", "shift.csv.gz", t.gzipped(t.canon().encode())),
    read("16 csv in zip", "shift.zip", t.zipped("shift.csv")),
    refused("16 two csv in zip", "shift.zip", t.zipped("a.csv", "b.csv"), "E-ZIP-UNSAFE"),
)

GONE = (59.0, 1.0, 0.0)
RECORDS = (
    read("17", "shift.gt3x", g.cut_in_a_record, "W-TRUNC-TAIL W-SHORT", (59.0, 0.0, 0.0)),
    read("18", "shift.gt3x", g.wrong_checksum, "W-CHECKSUM W-GAP W-SHORT", GONE),
    read("19", "shift.gt3x", g.wrong_checksum_in_sleep, "W-CHECKSUM W-SLEEP W-SHORT", (50.0, 0.0, 10.0)),
    read("20", "shift.gt3x", g.broken_separator, "W-RESYNC W-GAP W-SHORT", GONE),
    read("21", "shift.gt3x", g.size_says_60000, "W-RESYNC W-GAP W-SHORT", GONE),
    read("22 zeros", "shift.gt3x", g.block_of_zeros, "W-RESYNC W-GAP W-SHORT", (58.0, 2.0, 0.0)),
    read("22 text", "shift.gt3x", g.block_of_another_file, "W-RESYNC W-GAP W-SHORT", (58.0, 2.0, 0.0)),
    read("23", "shift.gt3x", g.without_a_stretch, "W-GAP", (60.0, 60.0, 0.0)),
    read("24", "shift.gt3x", g.replaced(20, g.second(20) * 2), "W-DUP"),
    read("25", "shift.gt3x", g.replaced(20, g.second(20) + g.second(22, stamp=20)), "W-DUP-CONFLICT"),
    read("26", "shift.gt3x", g.clock_back, "W-CLOCK-BACK"),
    read("27", "shift.gt3x", g.replaced(20, g.second(20, stamp=20 + g.YEAR_S)), "W-CLOCK-FWD"),
    read("28", "shift.gt3x", g.replaced(20, g.second(20, stamp=-T0)), "W-CLOCK-FWD"),
    read("29 1970", "shift.gt3x", g.never_set(0), "W-CLOCK-UNSET"),
    read("29 2099", "shift.gt3x", g.never_set(4_070_908_800), "W-CLOCK-UNSET"),
    read("30", "shift.gt3x", g.replaced(20, g.second(20, n_rows=99)), "W-SEC-COUNT"),
    read("31", "shift.gt3x", g.replaced(20, g.second(20, n_rows=101))),
    read("32", "shift.gt3x", g.replaced(20, record(0, T0 + 20, b"\0")), "W-DOCKED W-SHORT", (59.0, 0.0, 1.0)),
    read("33", "shift.gt3x", g.asleep(20, 30), "W-SLEEP W-SHORT", (50.0, 0.0, 10.0)),
    read("34", "shift.gt3x", g.asleep(40, 60, leaves=False), "W-SLEEP W-SHORT", (40.0, 0.0, 20.0)),
    read("35", "shift.gt3x", given(g.pack(record(3, T0, b"\x09") + g.LOG))),
    read("36", "shift.gt3x", g.asleep(0, 10), "W-SLEEP W-SHORT", (50.0, 0.0, 0.0)),
    read("37", "shift.gt3x", g.forged_sleep, "W-CLOCK-FWD"),
    read("38", "shift.gt3x", g.odd_records),
    read("39", "shift.gt3x", lambda: g.million_records(77, b"x", 1_000_000)),
    read("40", "shift.gt3x", lambda: g.million_records(0, b"", 100_000)),
    refused("41", "shift.gt3x", g.primary_only, "E-NO-GYRO"),
    refused("42 missing", "shift.gt3x", given(g.pack(g.seconds())), "E-GT3X-PART"),
    refused("42 scale 0", "shift.gt3x", g.scale_zero, "E-COLS"),
    read("42 late", "shift.gt3x", g.schema_late),
    read("42 changed", "shift.gt3x", g.schema_changed),
    read("42 unknown column", "shift.gt3x", g.strange_column),
    read("42 8 bits", "shift.gt3x", g.eight_bits, "W-RESOLUTION"),
    read("43", "shift.gt3x", given(g.pack(g.with_primary(0.7))), "W-BIAS"),
    read("43 agreeing", "shift.gt3x", given(g.pack(g.with_primary()))),
    read(
        "44",
        "shift.gt3x",
        g.with_info(INFO.replace("TAS1E", "MOS2E").replace("1.7.2", "1.6.0")),
        "W-FIRMWARE",
    ),
    read("44 TAS", "shift.gt3x", g.with_info(INFO.replace("1.7.2", "1.6.0"))),
    read("45", "shift.gt3x", g.with_info(INFO.replace("Resets: 0", "Resets: 3")), "W-RESETS"),
    read("45 battery", "shift.gt3x", g.flat_battery, "W-BATTERY"),
)

RATE_LINE = "Sample Rate: 100\r\n"
INFO_AND_TIME = (
    read("46 mark", "shift.gt3x", g.with_info("\ufeff" + INFO)),
    read("46 LF", "shift.gt3x", g.with_info(INFO.replace("\r\n", "\n"))),
    read("47", "shift.gt3x", g.with_info(INFO + "Acceleration Max: 8,0\r\nBattery Voltage: 4,03\r\n")),
    read("48 missing", "shift.gt3x", g.with_info(INFO.replace(RATE_LINE, "")), "W-RATE"),
    read("48 zero", "shift.gt3x", g.with_info(INFO.replace("Rate: 100", "Rate: 0")), "W-RATE"),
    read("49", "shift.gt3x", g.with_info(INFO.replace("Rate: 100", "Rate: 30"), g.with_primary()), "W-RATE"),
    read("50", "shift.gt3x", g.with_info(INFO.replace("Rate: 100", "Rate: 100 Hz"))),
    read("51", "shift.gt3x", g.with_info(INFO)),
    read("52", "shift.gt3x", g.with_info((INFO + "Subject Name: Renée\r\n").encode("latin-1")), "W-ENCODING"),
    read("53", "shift.gt3x", g.with_info(INFO + "Subject Name: a:b:\u202e\x07" + "x" * 4096 + "\r\n")),
    read("54", "shift.gt3x", g.with_info(INFO + "Subject Name: <img onerror=1>{{7*7}}=cmd|x\r\n")),
    read("55", "shift.gt3x", given(g.pack(record(6, T0, b'{"UsedUtc":true}') + g.LOG))),
    read(
        "55 no zone",
        "shift.gt3x",
        g.with_info(INFO.replace("TimeZone: -05:00:00\r\n", ""), record(6, T0, b'{"UsedUtc":true}') + g.LOG),
        "W-TZ",
    ),
    *CLOCKS,
    read("57 plus", "shift.gt3x", g.with_info(INFO.replace("-05:00:00", "05:30:00"))),
    read("57 minus", "shift.gt3x", g.with_info(INFO.replace("-05:00:00", "-03:30:00"))),
    read("57 garbage", "shift.gt3x", g.with_info(INFO.replace("-05:00:00", "rubbish")), "W-TZ"),
    read(
        "58",
        "shift.gt3x",
        g.with_info(INFO.replace("Stop Date: 0", "Stop Date: 639080640000000000")),
        "W-EARLY-END",
    ),
)

XML = '<?xml version="1.0"?>'
ROW_LOST = (59.99, 0.01, 0.0)
TABLES = (
    refused("59", "shift.csv", given(HEADER + "\n"), "E-NO-SAMPLES"),
    read("60 mark", "shift.csv", given("\ufeff" + t.canon())),
    read("60 CRLF", "shift.csv", given(t.canon().replace("\n", "\r\n"))),
    read("60 CR", "shift.csv", given(t.canon().replace("\n", "\r"))),
    read("60 blank", "shift.csv", t.line_changed(2000, lambda line: line + "\n")),
    read("61 UTF-16", "shift.csv", t.encoded(t.canon(), "utf-16"), "W-ENCODING"),
    read(
        "61 Latin-1",
        "shift.csv",
        t.encoded(t.canon().replace("time_us", "temps_µs"), "latin-1"),
        "W-ENCODING",
    ),
    read("62", "shift.csv", given(t.french(t.canon())), "W-LOCALE"),
    refused("63", "shift.csv", given(t.french(t.canon().replace("time_us", "time_us"), ",")), "E-DECIMAL"),
    read("64", "shift.csv", given(t.wholes_first(600)), "W-LOCALE", (66.0, 0.0, 0.0)),
    read("65 tab", "shift.txt", given(t.canon().replace(",", "\t"))),
    refused("65 thousands", "shift.csv", given(t.thousands()), "E-COLS"),
    read("65 single spaces", "shift.txt", given(t.single_spaces("// Update Rate: 100.0Hz\n")), "W-RATE"),
    refused("65 single spaces, no rate", "shift.txt", given(t.single_spaces()), "E-RATE"),
    read("66", "shift.csv", t.line_changed(2000, lambda line: line + "\n" + HEADER), "W-HEADER-REPEAT"),
    refused("67", "shift.csv", given(t.canon().split("\n", 1)[1]), "E-COLS"),
    read("68", "shift.csv", given(t.canon()[:-20]), "W-TRUNC-TAIL W-SHORT", (59.99, 0.0, 0.0)),
    read(
        "69",
        "shift.csv",
        given(t.canon()[:100_000] + "\0" * 4096 + t.canon()[104_096:]),
        "W-ROWS-DROPPED W-GAP W-SHORT",
        (59.17, 0.83, 0.0),
    ),
    read(
        "70",
        "shift.csv",
        t.lines_changed(lambda x: [*x[:2000], x[2000][:30] + x[2001], *x[2002:]]),
        "W-ROWS-DROPPED W-GAP W-SHORT",
        (59.98, 0.02, 0.0),
    ),
    read(
        "71 fewer",
        "shift.csv",
        t.line_changed(2000, lambda x: x[:20]),
        "W-ROWS-DROPPED W-GAP W-SHORT",
        ROW_LOST,
    ),
    read(
        "71 more",
        "shift.csv",
        t.line_changed(2000, lambda x: x + ",7,8"),
        "W-ROWS-DROPPED W-GAP W-SHORT",
        ROW_LOST,
    ),
    refused("71 many", "shift.csv", t.lines_changed(lambda x: [*x[:2000], *["?"] * 500, *x[2500:]]), "E-ROW"),
    *(
        read(
            f"72 {word or 'empty'}",
            "shift.csv",
            t.line_changed(2000, lambda x, word=word: x.rsplit(",", 1)[0] + "," + word),  # type: ignore[misc]
            "W-NAN W-GAP W-SHORT",
            ROW_LOST,
        )
        for word in ("NaN", "inf", "-inf", "-", "")
    ),
    read("73", "shift.csv", t.line_changed(2000, lambda x: x.replace(",", ',"', 1))),
    refused("74", "shift.csv", given(b"1" * (50 << 20)), "E-TYPE"),
    read("75", "shift.csv", given(t.wrapped()), "W-WRAP"),
    read("76 millis", "shift.csv", given(t.whole_milliseconds()), "W-SHORT"),
    read("76 seconds", "shift.csv", given(t.whole_seconds()), "W-JITTER"),
    read("77", "shift.csv", given(t.late_rows()), "W-ORDER"),
    read("77 set back", "shift.csv", given(t.clock_back()), "W-CLOCK-BACK"),
    *ORDER,
    read("78", "shift.csv", given(t.stalls()), "W-GAP", (60.0, 3.56, 0.0)),
    read("79 d/M", "shift.csv", given(t.calendar_table("%d/%m/%Y %H:%M:%S.%f"))),
    read("79 M/d", "shift.csv", given(t.calendar_table("%m/%d/%Y %H:%M:%S.%f"))),
    read("79 d.M", "shift.csv", given(t.calendar_table("%d.%m.%Y %H:%M:%S.%f"))),
    refused(
        "79 either",
        "shift.csv",
        given(t.calendar_table("%d/%m/%Y %H:%M:%S.%f", datetime(2026, 3, 4, 8))),  # noqa: DTZ001
        "E-TIME",
    ),
    read("79 compact", "shift.csv", given(t.calendar_table("%Y%m%dT%H%M%S.%f"))),
    read(
        "79 no date, over midnight",
        "shift.csv",
        given(t.calendar_table("%H:%M:%S.%f", datetime(2026, 3, 14, 23, 59, 30))),  # noqa: DTZ001
        "W-NO-DATE",
    ),
    read("79 AM", "shift.csv", given(t.zoned(" AM", "%I:%M:%S.%f")), "W-NO-DATE"),
    refused("79 month's name", "shift.csv", given(t.month_names()), "E-TIME"),
    read("79 two columns", "shift.csv", given(t.date_and_time())),
    read("79 ActiLife", "shift.csv", given(t.actilife("dd/MM/yyyy", "14/03/2026"))),
    read("79 ActiLife lying", "shift.csv", given(t.actilife("dd/MM/yyyy", "03/14/2026"))),
    read(
        "79 ActiLife, saved again in French",
        "shift.csv",
        given(t.resaved("%d/%m/%Y %H:%M:%S.%f", datetime(2026, 3, 2, 8), "3/2/2026")),  # noqa: DTZ001
        "W-LOCALE",
    ),
    read(
        "79 ActiLife, header of another day",
        "shift.csv",
        given(t.resaved("%d/%m/%Y %H:%M:%S.%f", datetime(2026, 3, 2, 8), "9/9/2025")),  # noqa: DTZ001
        "W-LOCALE W-DATE-ORDER",
    ),
    read("79 ActiLife stamps", "shift.csv", given(t.actilife(stamps=True))),
    refused("80 tenths", "shift.csv", given(t.excel_times()), "E-TIME"),
    refused("80 minutes", "shift.csv", given(t.excel_minutes()), "E-TIME"),
    read("80 decimals", "shift.csv", given(t.rounded()), "W-PRECISION"),
    refused("81", "shift.csv", t.excel_cut, "E-EXCEL-CUT"),
    refused("82", "shift.csv", given(t.counts()), "E-EPOCH"),
    read(
        "83",
        "shift.csv",
        given(
            t.canon().replace(
                HEADER, "Timestamp (us),AccX(g),AccY(g),AccZ(g),GyroX(dps),GyroY(dps),GyroZ(dps)"
            )
        ),
    ),
    read("83 words beside the readings", "shift.csv", given(t.labelled())),
    read("83 French", "shift.csv", t.encoded(t.french_names()), "W-LOCALE"),
    read("83 French, cp1252", "shift.csv", t.encoded(t.french_names(), "cp1252"), "W-LOCALE W-ENCODING"),
    refused("84 DTD", "shift.mvnx", given(f"{XML}<!DOCTYPE m [<!ENTITY a 'b'>]><mvnx/>"), "E-XML"),
    refused("84 entity", "shift.mvnx", given(f"{XML}<!DOCTYPE m SYSTEM 'http://[::1]/'><mvnx/>"), "E-XML"),
    refused("84 cut", "shift.mvnx", given(f"{XML}<mvnx version='4'><subject><frames>"), "E-XML"),
)

PERSONS = (
    refused("91 never still", "shift.csv", p.swing(0.0), "E-CALIBRATION"),
    refused("91 still for 1 s", "shift.csv", p.swing(1.0), "E-CALIBRATION"),
    read("91 still for 3 s", "shift.csv", p.swing(3.0), "W-NO-STILL"),
    read("92 upside down", "shift.csv", p.turned((1, -1, -1))),
    read("92 other side", "shift.csv", p.turned((-1, -1, 1))),
    read("93", "shift.csv", p.put_back_turned, "W-PUT-BACK W-GAP", (5403.52, 360.0, 0.0)),
    read("94", "shift.csv", p.left_on_a_desk, "W-NONWEAR", (780.0, 0.0, 0.0)),
    read("96 twice in one file", "shift.csv", p.the_same_twice, "W-DUP"),
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
