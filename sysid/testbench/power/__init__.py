"""The power supply: a battery from rests and loads, an H-bridge from a staircase of PWM."""
