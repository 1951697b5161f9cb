"""The robot: what it is calibrated to (`calibration`) and the missions it drives (`mission`)."""
