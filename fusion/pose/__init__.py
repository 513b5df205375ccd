"""Where the sensor sits on the arm: pose windows, slips, wear, the arm's axis."""
