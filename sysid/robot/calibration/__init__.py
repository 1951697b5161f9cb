"""The vehicle from logs that hold the pose: radii, widths, slip, masses."""
