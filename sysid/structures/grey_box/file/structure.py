"""A grey box whose equations stand in a file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self, cast

from sysid.data.record import Channel
from sysid.data.yaml_files.source import text_of
from sysid.errors import UsageError
from sysid.fitting.problem import Parameter
from sysid.structures.grey_box.file.definition import definition_of
from sysid.structures.grey_box.file.physics import FilePhysics
from sysid.structures.grey_box.physics import Physics
from sysid.structures.grey_box.structure import GreyBox, grey_box_traits
from sysid.structures.traits import Traits


@dataclass(frozen=True)
class FromFile(GreyBox[FilePhysics]):
    """A grey box whose states, parameters and equations a file gives; a model holds their text.

    Attributes:
        text: of a class made by ``structure_of_file``, the file.
    """

    name: ClassVar[str] = "ode"
    traits: ClassVar[Traits] = grey_box_traits(
        title="Equations of a file",
        equation="dx/dt = f(x, u, p), y = g(x, p) as a file writes them",
        when="a plant whose equations are known",
    )
    physics_class: ClassVar[type[Physics]] = FilePhysics
    text: ClassVar[str] = ""

    @classmethod
    def physics_for(cls, given: Mapping[str, str], nu: int, ny: int) -> FilePhysics:
        d = definition_of(cls.text)
        if (nu, ny) != (len(d.inputs), len(d.outputs)):
            raise UsageError(
                f"the file has inputs {', '.join(d.inputs)} and outputs {', '.join(d.outputs)}, "
                f"the log {nu} and {ny}; choose its columns by `inputs` and `outputs`"
            )
        return FilePhysics(nu, ny, cls.text)

    @classmethod
    def from_orders(
        cls, raw: Mapping[str, Any], nu: int, ny: int, options: Mapping[str, str] | None = None
    ) -> Self:
        made: Any = super().from_orders(raw, nu, ny, options)
        d, sampling = made.physics.definition, made.sampling
        if d.linear or d.said.time == "discrete":
            sampling = replace(sampling, substeps=1)
        elif sampling.substeps == 0:
            sampling = replace(sampling, substeps=d.said.substeps)
        # of a class that a model file can name
        return cast(Self, FromFile(made.physics, sampling, made.opened))

    @classmethod
    def from_json(cls, raw: Mapping[str, Any]) -> Self:
        made = super().from_json(raw)
        d = made.physics.definition
        if (made.nu, made.ny) != (len(d.inputs), len(d.outputs)):
            raise ValueError("its equations have other channels")
        return made

    def parameters(
        self, inputs: Sequence[Channel], outputs: Sequence[Channel]
    ) -> tuple[Parameter, ...]:
        """Those of the file."""
        self.physics.require_channels(inputs, outputs)
        return super().parameters(inputs, outputs)


def structure_of_file(path: str | Path) -> type[FromFile]:
    """The structure that a file of equations describes."""
    path = Path(path)
    text = text_of(path)
    d = definition_of(text, path.name)
    equations = ", ".join(f"{n}: {e}" for n, e in d.said.equations.items())
    traits = grey_box_traits(
        title=d.said.title or path.name, equation=equations, when=f"as {path.name} says"
    )
    channels = ((len(d.inputs), len(d.outputs)),)
    body = {
        "__doc__": d.said.title or f"Equations of {path.name}.",
        "__module__": __name__,
        "name": str(path),
        "traits": traits,
        "text": text,
        "largest": channels,
    }
    return type("FromFile", (FromFile,), body)
