"""Tables that no reader understands by itself, read through a saved column profile."""

import io
import json

import pytest

from acromion.fusion.errors import UnknownColumns, UnusableProfile
from acromion.fusion.readers import parse_profile, read_recording
from acromion.fusion.recording import Recording

UNITS = '"acceleration_unit": "g", "angular_rate_unit": "dps"'
NAMED = f'{{"acceleration": ["p", "q", "r"], "angular_rate": ["u", "v", "w"], "time": "k", {UNITS}}}'
TWITCH = [0.001 * (k % 7 == 3) for k in range(900)]
ROWS = [(10 * k, t, t, 1.0 + t, 0.5 + t, t - 0.25, k % 50) for k, t in enumerate(TWITCH)]


def read_with(profile: str, text: str, rate_hz: float | None = None) -> Recording:
    return read_recording(
        io.BytesIO(text.encode()), file_name="x.csv", rate_hz=rate_hz, profile=parse_profile(profile)
    )


def table(header: str = "k,p,q,r,u,v,w\n") -> str:
    return header + "".join(",".join(map(str, row)) + "\n" for row in ROWS)


def test_columns_are_found_by_the_names_that_the_profile_gives() -> None:
    recording = read_with(NAMED, table())

    assert recording.duration_us == 9_000_000
    assert recording.segments[0].gyr_dps[7].tolist() == [0.5, -0.25, 7.0]


def test_columns_are_found_by_number_where_there_is_no_header() -> None:
    numbered = f'{{"acceleration": [2, 3, 4], "angular_rate": [5, 6, 7], "time": 1, {UNITS}}}'

    recording = read_with(numbered, table(""))

    assert recording.duration_us == 9_000_000
    assert recording.segments[0].acc_g[0, 2] == 1.0


def test_units_and_factors_are_applied() -> None:
    rows = "".join(f"{k / 100:.2f},0,0,2000,9,{k % 5},0\n" for k in range(900))
    profile = json.loads(NAMED) | {
        "acceleration_factor": 0.0005,
        "angular_rate_unit": "mdps",
        "time_unit": "s",
    }

    recording = read_with(json.dumps(profile), "k,p,q,r,u,v,w\n" + rows)

    assert recording.segments[0].acc_g[0, 2] == pytest.approx(1.0)
    assert recording.segments[0].gyr_dps[0, 0] == pytest.approx(0.009)


@pytest.mark.parametrize(("asked_hz", "duration_us"), [(None, 18_000_000), (100.0, 9_000_000)])
def test_without_time_the_profile_tells_the_rate_unless_one_is_asked_for(
    asked_hz: float | None, duration_us: int
) -> None:
    profile = json.loads(NAMED) | {"time": None, "rate_hz": 50}

    assert read_with(json.dumps(profile), table(), rate_hz=asked_hz).duration_us == duration_us


def test_the_order_of_day_and_month_is_told() -> None:
    rows = "".join(f"04/03/2026 08:00:{k / 100:05.2f},0,0,1,0,{k % 5},0\n" for k in range(900))
    profile = json.loads(NAMED) | {"date_order": "dmy"}

    recording = read_with(json.dumps(profile), "k,p,q,r,u,v,w\n" + rows)

    assert recording.start is not None
    assert (recording.start.month, recording.start.day) == (3, 4)


def test_a_column_that_is_not_there_is_named() -> None:
    with pytest.raises(UnknownColumns) as refusal:
        read_with(NAMED.replace('"w"', '"z"'), table())

    assert "z" in str(refusal.value.facts["list"])


def test_a_profile_states_the_pose_of_every_recording() -> None:
    profile = json.loads(NAMED) | {"pose_held": "start"}

    assert read_with(json.dumps(profile), table()).pose_held == "start"


def test_a_profile_may_state_the_pose_alone() -> None:
    text = table("time_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n")

    recording = read_with('{"pose_held": "start"}', text)

    assert (recording.pose_held, recording.duration_us) == ("start", 9_000_000)


def test_a_profile_may_say_that_what_the_header_states_of_the_pose_does_not_hold() -> None:
    text = "# pose_held: start\n" + table("time_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n")

    assert read_with('{"pose_held": "no"}', text).pose_held == "no"


@pytest.mark.parametrize("text", [NAMED, '{"pose_held": "start"}'])
def test_a_profile_survives_being_saved(text: str) -> None:
    profile = parse_profile(text)

    assert parse_profile(profile.to_json()) == profile


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "json"),
        ("[]", "names"),
        ('{"acceleration": [1, 2, 3]}', "names"),
        (NAMED.replace('"time"', '"tiem"'), "names"),
        ('{"acceleration": [1, 2], "angular_rate": [4, 5, 6]}', "places"),
        ('{"acceleration": [0, 2, 3], "angular_rate": [4, 5, 6]}', "places"),
        ('{"acceleration": [1, 2, 3], "angular_rate": [4, 5, 6], "time": 1.5}', "places"),
        (NAMED[:-1] + ', "acceleration_unit": "stone"}', "units"),
        (NAMED[:-1] + ', "date_order": "ydm"}', "units"),
        (NAMED[:-1] + ', "pose_held": "end"}', "pose held"),
        ('{"pose_held": "end"}', "pose held"),
        ('{"pose_held": "start", "rate_hz": 50}', "names"),
        (NAMED[:-1] + ', "rate_hz": -1}', "profile-numbers"),
        (NAMED[:-1] + ', "rate_hz": true}', "profile-numbers"),
    ],
)
def test_a_profile_that_says_nothing_usable_is_refused(text: str, why: str) -> None:
    with pytest.raises(UnusableProfile) as refusal:
        parse_profile(text)

    assert refusal.value.facts["why"] == why
