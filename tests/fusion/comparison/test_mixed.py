"""The mixed model, against published examples and closed forms."""

from math import sqrt

import pandas as pd
import pytest

from acromion.fusion import MixedModel, fit_mixed_model

# Davies and Goldsmith 1972, Statistical Methods in Research and Production, section 6.4: yield of dyestuff,
# five preparations of each of six batches. REML in R (lme4, "Dyestuff"): batch 1764.05, residual 2451.25.
DYESTUFF = {
    "A": (1545, 1440, 1440, 1520, 1580),
    "B": (1540, 1555, 1490, 1560, 1495),
    "C": (1595, 1550, 1605, 1510, 1560),
    "D": (1445, 1440, 1595, 1465, 1545),
    "E": (1595, 1630, 1515, 1635, 1625),
    "F": (1520, 1455, 1450, 1480, 1445),
}
# The same, section 6.5: strength of a paste, two tests of three casks of each of ten deliveries. REML in R
# (lme4, "Pastes"): deviations 2.904 of casks, 1.287 of deliveries, 0.823 of tests.
PASTES = """
62.8 62.6 60.1 62.3 62.7 63.1 60.0 61.4 57.5 56.9 61.1 58.9 58.7 57.5 63.9 63.1 65.4 63.7 57.1 56.4
56.9 58.6 64.7 64.5 55.1 55.1 54.7 54.2 58.8 57.5 63.4 64.9 59.3 58.1 60.5 60.0 62.5 62.6 61.0 58.7
56.9 57.7 59.2 59.4 65.2 66.0 64.8 64.1 54.8 54.8 64.0 64.0 57.7 56.8 58.3 59.3 59.2 59.2 58.9 56.6
"""


@pytest.fixture(scope="module")
def dyestuff() -> MixedModel:
    rows = [
        (batch, str(day), value) for batch, values in DYESTUFF.items() for day, value in enumerate(values)
    ]
    return fit_mixed_model(pd.DataFrame(rows, columns=["subject", "day", "yield"]), "yield")


@pytest.fixture(scope="module")
def pastes() -> MixedModel:
    values = [float(word) for word in PASTES.split()]
    rows = {
        "subject": [number // 6 for number in range(60)],
        "day": [number // 2 % 3 for number in range(60)],
        "strength": values,
    }
    return fit_mixed_model(pd.DataFrame(rows), "strength")


def test_one_row_a_day_gives_the_components_of_the_published_dyestuff_example(dyestuff: MixedModel) -> None:
    assert (dyestuff.rows, dyestuff.people, dyestuff.is_converged) == (30, 6, True)
    assert dyestuff.day_sd is None
    assert dyestuff.person_sd**2 == pytest.approx(1764.05, rel=2e-3)
    assert dyestuff.residual_sd**2 == pytest.approx(2451.25, rel=2e-3)


def test_the_range_of_a_balanced_mean_is_that_of_the_people_by_students_t(dyestuff: MixedModel) -> None:
    # the mean square between batches is 11271.5, t of 5 degrees of freedom 2.5706
    half = 2.5706 * sqrt(11271.5 / 30)

    (mean,) = dyestuff.effects
    assert mean.name == "intercept"
    assert mean.estimate == pytest.approx(1527.5)
    assert (mean.interval.low, mean.interval.high) == pytest.approx((1527.5 - half, 1527.5 + half), abs=0.1)


def test_days_within_people_give_the_components_of_the_published_paste_example(pastes: MixedModel) -> None:
    assert pastes.day_sd == pytest.approx(2.904, abs=0.003)
    assert pastes.person_sd == pytest.approx(1.287, abs=0.006)
    assert pastes.residual_sd == pytest.approx(0.823, abs=0.001)
    assert pastes.effects[0].estimate == pytest.approx(60.0533, abs=1e-3)


def test_a_task_of_two_in_balanced_data_is_the_paired_t_test_of_the_people() -> None:
    # differences 1, 2, 3: mean 2, deviation 1, t of 2 degrees of freedom 4.3027
    pairs = {"A": (10.0, 11.0), "B": (14.0, 16.0), "C": (12.0, 15.0)}
    rows = [
        (who, "1", task, pair[k]) for who, pair in pairs.items() for k, task in enumerate(("Rest", "Work"))
    ]
    table = pd.DataFrame(rows, columns=["subject", "day", "label", "time"])

    _, task = fit_mixed_model(table, "time", ["label"]).effects

    assert task.name == "label: Work"
    assert task.estimate == pytest.approx(2.0)
    half = 4.3027 / sqrt(3)
    assert (task.interval.low, task.interval.high) == pytest.approx((2 - half, 2 + half), abs=2e-3)
    assert task.p_value == pytest.approx(0.0742, abs=5e-4)  # t = 2 sqrt(3), two-sided


def test_tasks_that_differ_between_people_are_compared_by_the_people_whatever_the_number_of_days() -> None:
    # differences of the means of two days 1, 2, 9: mean 4, deviation sqrt(19), t of 2 degrees of freedom
    means = {"A": (10.0, 11.0), "B": (14.0, 16.0), "C": (12.0, 21.0)}
    rows = [
        (who, day, task, pair[k] + 0.1 * sign)
        for who, pair in means.items()
        for day, sign in (("1", -1), ("2", 1))
        for k, task in enumerate(("Rest", "Work"))
    ]
    table = pd.DataFrame(rows, columns=["subject", "day", "label", "time"])

    _, task = fit_mixed_model(table, "time", ["label"]).effects

    half = 4.3027 * sqrt(19 / 3)
    assert (task.interval.low, task.interval.high) == pytest.approx((4 - half, 4 + half), abs=1e-2)


def test_a_task_of_one_person_has_one_degree_of_freedom() -> None:
    rows = pd.DataFrame(
        {
            "subject": list("AABBCC"),
            "day": list("121212"),
            "label": ["rest", "rest", "rest", "rest", "rest", "work"],
            "time": [1.0, 2.0, 4.0, 5.5, 3.0, 9.0],
        }
    )

    task = fit_mixed_model(rows, "time", "label").effects[1]

    assert task.interval.low < 0.0 < task.interval.high


def test_people_who_do_not_differ_still_have_a_range_of_the_mean() -> None:
    # all means are 5: REML gives 6 / (6 - 1) for the days and 0 for people; t of 2 degrees of freedom 4.3027
    rows = pd.DataFrame({"subject": list("AABBCC"), "day": list("121212"), "time": [4.0, 6, 4, 6, 4, 6]})

    found = fit_mixed_model(rows, "time")

    assert found.person_sd == pytest.approx(0.0, abs=0.02)
    assert found.residual_sd**2 == pytest.approx(6 / 5, rel=1e-3)
    half = found.effects[0].interval.high - 5.0
    assert half == pytest.approx(4.3027 * sqrt(6 / 5 / 6), rel=1e-3)


def test_a_row_with_a_missing_figure_is_left_out() -> None:
    rows = pd.DataFrame({"subject": list("AABBCC"), "day": list("121212"), "time": [1.0, 2, 4, 6, 5, None]})

    assert fit_mixed_model(rows, "time").rows == 5


@pytest.mark.parametrize(
    ("rows", "fixed", "told"),
    [
        ({"subject": list("AABB"), "job": list("xxyy")}, ["job"], "too few people"),
        ({"subject": list("ABCD"), "job": list("xxyy")}, [], "nobody has two rows"),
        (
            {"subject": list("AABB"), "job": list("xyxy"), "arm": list("lrlr")},
            ["job", "arm"],
            "distinguished",
        ),
    ],
)
def test_a_model_that_cannot_be_fitted_is_refused(
    rows: dict[str, list[str]], fixed: list[str], told: str
) -> None:
    table = pd.DataFrame(rows | {"day": list("1212"), "time": [1.0, 2.0, 4.0, 8.0]})

    with pytest.raises(ValueError, match=told):
        fit_mixed_model(table, "time", fixed)


def test_a_day_that_does_not_count_is_not_in_the_model() -> None:
    rows: list[tuple[str, str, float, str | None]] = [
        (f"P{k}", str(day), float(10 * k + day), None) for k in range(4) for day in range(3)
    ]
    short = ("P0", "3", 99.0, "short")
    columns = ["subject", "day", "time", "left_out"]

    found = fit_mixed_model(pd.DataFrame([*rows, short], columns=columns), "time")

    assert found == fit_mixed_model(pd.DataFrame(rows, columns=columns), "time")


def test_one_fixed_effect_may_be_given_as_text() -> None:
    rows = pd.DataFrame(
        {
            "subject": list("AABBCCDD"),
            "day": [1, 2] * 4,
            "label": ["rest", "work"] * 4,
            "x": [1.0, 3.0, 2.0, 3.0, 1.0, 4.0, 2.0, 5.0],
        }
    )

    assert fit_mixed_model(rows, "x", "label") == fit_mixed_model(rows, "x", ["label"])


def test_a_column_that_does_not_exist_or_has_an_infinite_value_is_refused_by_name() -> None:
    rows = pd.DataFrame({"subject": list("AABB"), "day": [1, 2] * 2, "x": [1.0, 3.0, 2.0, float("inf")]})

    with pytest.raises(ValueError, match="these columns do not exist: label"):
        fit_mixed_model(rows, "x", "label")
    with pytest.raises(ValueError, match="these columns have infinite values: x"):
        fit_mixed_model(rows, "x")


def test_both_arms_of_a_day_are_refused_unless_the_side_is_an_effect() -> None:
    rows = [
        (f"P{k}", str(day), side, float(k + day + (side == "left")))
        for k in range(4)
        for day in range(3)
        for side in ("left", "right")
    ]
    table = pd.DataFrame(rows, columns=["subject", "day", "side", "time"])

    with pytest.raises(ValueError, match="P0 has both arms on 0"):
        fit_mixed_model(table, "time")
    assert fit_mixed_model(table, "time", "side").rows == 24


def test_a_row_that_is_there_twice_is_refused() -> None:
    rows = [(f"P{k}", str(day), float(10 * k + day)) for k in range(4) for day in range(3)]
    table = pd.DataFrame(rows, columns=["subject", "day", "time"]).assign(path="p.gt3x")

    with pytest.raises(ValueError, match="a row is there twice"):
        fit_mixed_model(pd.concat([table, table]), "time")
