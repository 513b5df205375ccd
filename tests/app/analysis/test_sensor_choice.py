"""Which of several sensors is on the arm: on the page and by REST."""

from app.api.library.models import AnalysisSettings
from app.report.words.columns import format_columns
from app.web.recording.columns import read_profile
from fusion.readers import propose_profile

TABLE = (
    b"sensor,left,left,left,left,left,left,right,right,right,right,right,right\n"
    b"time_ms,ax,ay,az,gx,gy,gz,ax,ay,az,gx,gy,gz\n"
) + b"".join(b"%d,0,0,1,0,0,0,0,1,0,0,0,0\n" % (10 * k) for k in range(50))


def test_the_page_offers_the_sensors_of_the_table() -> None:
    assert propose_profile(TABLE).sensors == ("left", "right")


def test_the_form_gives_the_sensor_with_its_units_and_rate() -> None:
    form = {"sensor": ["right"], "acceleration_unit": ["g"], "rate_hz": ["204,8"]}

    assert read_profile(form) == {"sensor": "right", "acceleration_unit": "g", "rate_hz": 204.8}


def test_the_report_names_the_sensor() -> None:
    assert format_columns('{"sensor": "right"}', "en") == "Sensor on the upper arm: right"


def test_a_request_may_name_the_sensor() -> None:
    assert AnalysisSettings(sensor="right").sensor == "right"
