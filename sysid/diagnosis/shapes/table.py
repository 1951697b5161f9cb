"""All shapes, one line a kind."""

from sysid.diagnosis.shapes import between_inputs, linear, over_command, over_speed, over_time
from sysid.diagnosis.shapes.shape import Shape

SHAPES: tuple[Shape, ...] = (
    *over_time.SHAPES,
    *over_command.SHAPES,
    *over_speed.SHAPES,
    *linear.SHAPES,
    *between_inputs.SHAPES,
)
"""In the order in which equals are preferred."""
