"""Base class of the sections of a hand-written file: typed, bounded, immutable keys."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

# Bounds far outside any use, which keep every later formula inside the range of floats.
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Positive = Annotated[float, Field(ge=1e-6, le=1e6)]
Gain = Annotated[float, Field(ge=0, le=1e6)]


class Settings(BaseModel):
    """A section of a file; unknown keys, wrong types and infinities are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _mapping(cls, value: Any) -> Any:
        """Read a key with nothing after it, as in ``guidance:``, as an empty section."""
        return {} if value is None else value
