"""What the image brings along may be shipped with it."""

import pytest

from benchmarks.third_party import Package, add_licences, read_lock


def test_every_locked_package_has_a_licence_that_may_be_shipped() -> None:
    assert [package for package in read_lock() if not package.may_be_shipped] == []


@pytest.mark.parametrize(
    ("licence", "may_be_shipped"),
    [
        ("MIT", True),
        ("Apache-2.0 OR GPL-2.0-only", True),
        ("BSD-3-Clause AND GPL-2.0-only", False),
        ("BSD-2-Clause AND Apache-2.0 WITH LLVM-exception", True),
        ("AGPL-3.0-only", False),
        ("unknown", False),
    ],
)
def test_a_licence_is_accepted_by_each_of_its_parts(licence: str, may_be_shipped: bool) -> None:
    assert Package("any", "1", licence).may_be_shipped is may_be_shipped


def test_the_list_names_each_licence() -> None:
    document: dict[str, object] = {"components": [{"name": "h11", "version": "0.16.0"}]}

    add_licences(document, {"h11": Package("h11", "0.16.0", "MIT")})

    named = [{"expression": "MIT", "acknowledgement": "declared"}]
    assert document == {"components": [{"name": "h11", "version": "0.16.0", "licenses": named}]}
