"""Draw the known devices as the table of docs/reference/formats.md."""

from acromion.fusion.devices import KNOWN_DEVICES

HEAD = "| device | form | unstated units | rate | axes | clock | seen in |\n|---|---|---|---|---|---|---|"


def draw_devices() -> str:
    """Return the table: a row for each entry."""
    rows = [HEAD]
    for one in KNOWN_DEVICES:
        units = ", ".join(filter(None, (one.acc_unit, one.gyr_unit, one.time_unit)))
        rows.append(
            f"| {one.name} | {one.form} | {units} | {one.rate} | {one.axes} | {one.clock} | {one.source} |"
        )
    return "\n".join(rows)
