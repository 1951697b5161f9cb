"""Statics as users specify them: one for all channels, or ``input[pwm_l]=dead-zone``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sysid.data.record import Channel
from sysid.errors import UsageError
from sysid.structures.blocks.static.functions import Static, parse_static

AUTO = "auto"


@dataclass(frozen=True)
class RequestedStatics:
    """What a user asked of the statics at one place.

    Attributes:
        place: ``input``, ``output`` or ``static``.
        common: the static of all channels not named, None to choose it on held-out data.
        named: (channel, static or None) of those that are.
    """

    place: str
    common: Static | None = None
    named: tuple[tuple[str, Static | None], ...] = ()

    @property
    def open(self) -> bool:
        """Whether something is left to choose."""
        return self.common is None or any(s is None for _, s in self.named)

    def of_channels(self, channels: Sequence[Channel], default: Static) -> tuple[Static, ...]:
        """The static of each channel, ``default`` where it is open."""
        names = [c.name for c in channels]
        for name, _ in self.named:
            if name not in names:
                raise UsageError(
                    f"`structure_options[{f'{self.place}[{name}]'!r}]`: there is no "
                    f"{self.place} {name!r}; there are {', '.join(names)}"
                )
        given = dict(self.named)
        return tuple(given.get(n, self.common) or default for n in names)


def requested_statics(place: str, options: Mapping[str, str]) -> RequestedStatics:
    """What ``options`` ask of the statics at one place."""
    common, named = None, []
    for key, text in options.items():
        name, bracket, channel = key.partition("[")
        if name != place:
            continue
        static = None if text.strip().lower() == AUTO else parse_static(text)
        if bracket:
            named.append((channel.removesuffix("]"), static))
        else:
            common = static
    return RequestedStatics(place, common, tuple(named))


def option_names(options: Mapping[str, str] | None) -> dict[str, str]:
    """The options with the channel taken off their names, to see whether they exist."""
    return {key.partition("[")[0]: value for key, value in (options or {}).items()}
