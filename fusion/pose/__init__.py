"""How the sensor is mounted on the arm: pose windows, slips, wear, the arm axis."""
