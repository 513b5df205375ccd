"""Write the known devices as the table of docs/formats.md.

python -m benchmarks.devices
"""

from fusion.devices import KNOWN_DEVICES

HEAD = "| device | form | unstated units | rate | axes | clock | seen in |\n|---|---|---|---|---|---|---|"


def main() -> None:
    """Print a row for each entry."""
    print(HEAD)
    for one in KNOWN_DEVICES:
        units = ", ".join(filter(None, (one.acc_unit, one.gyr_unit, one.time_unit)))
        print(f"| {one.name} | {one.form} | {units} | {one.rate} | {one.axes} | {one.clock} | {one.source} |")


if __name__ == "__main__":
    main()
