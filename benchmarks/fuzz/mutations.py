"""Mutations of bytes. ``random.Random`` makes the choices, so that Hypothesis can drive and shrink them."""

import re
from functools import reduce
from random import Random

NUMBERS = (
    b"",
    b"-",
    b"0",
    b"1e99",
    b"-1e-99",
    b"9" * 30,
    b"nan",
    b"inf",
    b"4294967295",
    b"-0.0",
    b"1,5",
    b'"1"',
)
ALPHABET = b'0123456789,.;-+eE \t\r\n"\0\x1e\xff'
WORDS = (b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x80\0\0\0", b"\x7f\xff\xff\xff", b"\x01\0\0\0")
LONGEST_CUT = 4000


def flip_bits(content: bytearray, random: Random) -> None:
    for _ in range(random.choice((1, 1, 3, 20))):
        content[random.randrange(len(content))] ^= 1 << random.randrange(8)


def cut(content: bytearray, random: Random) -> None:
    at = random.randrange(len(content))
    del content[at : at + random.choice((1, 2, 9, 100, LONGEST_CUT))]


def truncate(content: bytearray, random: Random) -> None:
    del content[random.randrange(len(content)) :]


def put_in(content: bytearray, random: Random) -> None:
    at = random.randrange(len(content))
    content[at:at] = bytes(random.choice(ALPHABET) for _ in range(random.choice((1, 3, 40))))


def splice(content: bytearray, random: Random) -> None:
    """Copy a stretch over another one."""
    source, to = random.randrange(len(content)), random.randrange(len(content))
    length = random.choice((1, 8, 100, 1000))
    content[to : to + length] = content[source : source + length]


def double(content: bytearray, random: Random) -> None:
    """Insert a copy of a stretch."""
    at = random.randrange(len(content))
    length = random.choice((1, 30, 2150, len(content)))
    content[at:at] = content[at : at + length]


def swap_lines(content: bytearray, random: Random) -> None:
    lines = bytes(content).split(b"\n")
    first, second = random.randrange(len(lines)), random.randrange(len(lines))
    lines[first], lines[second] = lines[second], lines[first]
    content[:] = b"\n".join(lines)


def edit_number(content: bytearray, random: Random) -> None:
    found = [*re.finditer(rb"[-+]?\d[\d.]*", bytes(content))]
    if found:
        chosen = random.choice(found)
        content[chosen.start() : chosen.end()] = random.choice(NUMBERS)


def edit_head(content: bytearray, random: Random) -> None:
    at = random.randrange(min(len(content), 400))
    content[at : at + 1] = bytes([random.choice(ALPHABET)])


def set_word(content: bytearray, random: Random) -> None:
    at = random.randrange(len(content))
    content[at : at + 4] = random.choice(WORDS)


MUTATIONS = (
    flip_bits,
    cut,
    truncate,
    put_in,
    splice,
    double,
    swap_lines,
    edit_number,
    edit_head,
    set_word,
)


def mutate(content: bytes, random: Random) -> bytes:
    """Damage a file in one to eight ways."""
    damaged = bytearray(content)
    for _ in range(random.choice((1, 1, 2, 3, 8))):
        if not damaged:
            break
        random.choice(MUTATIONS)(damaged, random)
    return bytes(damaged)


def mutate_records(log: bytes, random: Random) -> bytes:
    """Damage records inside a log.bin, and correct sizes and checksums, so that the damage is reached."""
    records = split_records(log)
    for _ in range(random.choice((1, 1, 2, 5))):
        place = random.randrange(len(records))
        choice = random.randrange(5)
        if choice == 0:
            records.insert(random.randrange(len(records)), records[place])
        elif choice == 1 and len(records) > 1:
            del records[place]
        elif choice == 2:
            records[place] = _change_stamp(records[place], random)
        else:
            records[place] = records[place][:6] + _change_payload(records[place], random)
    return b"".join(close_record(record) for record in records)


def mutate_blocks(log: bytes, random: Random) -> bytes:
    """Damage and move blocks inside a `.cwa`, and correct the checksums."""
    header, blocks = log[:1024], [log[at : at + 512] for at in range(1024, len(log), 512)]
    for _ in range(random.choice((1, 1, 2, 5, 20))):
        place, choice = random.randrange(len(blocks)), random.randrange(6)
        if choice == 0:
            blocks.insert(random.randrange(len(blocks)), blocks[place])
        elif choice == 1 and len(blocks) > 1:
            del blocks[place]
        else:
            blocks[place] = _change_block(blocks[place], random)
    return header + b"".join(map(close_block, blocks))


def close_block(block: bytes) -> bytes:
    """Restore length and checksum; unused space stays unchanged."""
    if not block.startswith(b"AX"):
        return block
    filled = (block[:2] + b"\xfc\x01" + block[4:510]).ljust(510, b"\0")
    total = sum(int.from_bytes(filled[at : at + 2], "little") for at in range(0, 510, 2))
    return filled + (-total % 65_536).to_bytes(2, "little")


def _change_block(block: bytes, random: Random) -> bytes:
    """Damage a block, mostly in its header, where most faults are possible."""
    head, rest = bytearray(block[:30]), bytearray(block[30:510])
    random.choice((flip_bits, set_word, splice))(random.choice((head, head, head, rest)), random)
    return bytes(head[:30]).ljust(30, b"\0") + bytes(rest)


def split_records(log: bytes) -> list[bytes]:
    """Return records without size and checksum: separator, kind, timestamp; then the payload."""
    records = []
    at = 0
    while at + 8 < len(log):
        size = int.from_bytes(log[at + 6 : at + 8], "little")
        records.append(log[at : at + 6] + log[at + 8 : at + 8 + size])
        at += 9 + size
    return records


def close_record(record: bytes) -> bytes:
    """Restore size and checksum."""
    payload = record[6 : 6 + 65_535]
    frame = record[:6] + len(payload).to_bytes(2, "little") + payload
    return frame + bytes([~reduce(lambda folded, byte: folded ^ byte, frame) & 0xFF])


def _change_stamp(record: bytes, random: Random) -> bytes:
    stamp = int.from_bytes(record[2:6], "little")
    changed = random.choice((stamp + random.randrange(-5, 6), stamp + 90_000, 0, 2**32 - 1, 2**31))
    kind = random.choice((record[1], record[1], random.randrange(27)))
    return record[:1] + bytes([kind]) + (changed % 2**32).to_bytes(4, "little") + record[6:]


def _change_payload(record: bytes, random: Random) -> bytes:
    payload = bytearray(record[6:]) or bytearray(1)
    random.choice((flip_bits, cut, truncate, put_in, splice, double, set_word))(payload, random)
    return bytes(payload)
