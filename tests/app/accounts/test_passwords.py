"""Which passwords may be had."""

import pytest

from app.access.passwords import check_password, hash_password, verify_password
from app.errors import WeakPassword


def find_fault(password: str, *names: str) -> str:
    try:
        check_password(password, names)
    except WeakPassword as refusal:
        return str(refusal.facts["weak"])
    return ""


@pytest.mark.parametrize(
    ("password", "names", "fault"),
    [
        ("elevenchars", (), "short"),
        ("twelve chars", (), ""),
        ("a1" + "é ü漢😀" * 25 + "z", (), ""),
        ("xyzabcde" * 16 + "!", (), "long"),
        ("123456qwerty", (), "common"),
        ("QwertyQwerty", (), "common"),
        ("aaaaaaaaaaaaaaaa", (), "common"),
        ("abababababababab", (), "common"),
        ("my acromion hurts", (), "name"),
        ("clara goes to work", ("clara",), "name"),
        ("seven annual reports", ("Ann",), ""),  # a short name may be part of a word
    ],
)
def test_a_password_is_judged_by_length_by_how_many_have_it_and_by_names(
    password: str, names: tuple[str, ...], fault: str
) -> None:
    assert find_fault(password, *names) == fault


def test_a_password_of_128_characters_counts_to_the_last() -> None:
    password = "abcdefgh" * 16

    kept = hash_password(password)

    assert verify_password(kept, password)
    assert not verify_password(kept, password[:-1])
    assert not verify_password(None, password)
