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
    ("password", "fault"),
    [
        ("elevenchars", "short"),
        ("twelve chars", ""),
        ("a1" + "é ü漢😀" * 25 + "z", ""),
        ("xyzabcde" * 16 + "!", "long"),
        ("123456qwerty", "common"),
        ("QwertyQwerty", "common"),
        ("aaaaaaaaaaaaaaaa", "common"),
        ("abababababababab", "common"),
        ("my acromion hurts", "name"),
    ],
)
def test_a_password_is_judged_by_length_and_by_how_many_have_it(password: str, fault: str) -> None:
    assert find_fault(password) == fault


def test_a_password_does_not_hold_the_name_of_the_person() -> None:
    assert find_fault("clara goes to work", "clara") == "name"


def test_a_short_name_may_be_part_of_a_word() -> None:
    assert find_fault("seven annual reports", "Ann") == ""


def test_a_password_of_128_characters_counts_to_the_last() -> None:
    password = "abcdefgh" * 16

    kept = hash_password(password)

    assert verify_password(kept, password)
    assert not verify_password(kept, password[:-1])


def test_no_kept_hash_is_never_right() -> None:
    assert not verify_password(None, "seven green bicycles")
