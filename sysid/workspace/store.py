"""The workspace: models, the state of a session and the exported plant, in one folder of JSON.

::

    .sysid/
      models/<id>.json     {"id", "model", "report"}
      index.json           ids in the order of saving
      state.json           "latest" (ids of the last fit, winner first), "best" (last comparison),
                           "augmented" (last diagnosis that added something)
      plant/               the exported plant package
      missions/            logs of simulated missions
      followed/            rows of logs that were followed, on which their models stand
      diagnosis/           the last diagnosis: diagnosis.json, index.html, page.json, next_*.csv

Every file is replaced as a whole, so a reader never meets half of one; what is read, changed and
written back is changed under a lock, so that commands may run at the same time.
"""

import hashlib
import json
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from sysid.data import documents
from sysid.data.schema import STORED, checked
from sysid.errors import DataError, ModelError, UsageError

if TYPE_CHECKING:
    from sysid.data.record import Record
    from sysid.structures.model import Model


def _identity(described: dict[str, Any]) -> dict[str, Any]:
    """What makes a model itself: everything but the folder its log happened to lie in."""
    provenance = described["provenance"]
    options = {k: v for k, v in provenance["options"].items() if k != "files"}
    return {**described, "provenance": {**provenance, "options": options}}


def _same(stored: Any, described: dict[str, Any]) -> bool:
    try:
        return _identity(stored) == _identity(described)
    except (KeyError, TypeError, AttributeError):
        return False


if sys.platform == "win32":
    import msvcrt

    def _lock(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_LOCK, 1)
else:
    import fcntl

    def _lock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX)


AUGMENTED = "augmented"
"""Under which the model of the last diagnosis is remembered, where that added something."""

_DIGITS = 6
"""Digits of the hash in an id; more where two models of a workspace would share them."""


@dataclass(frozen=True)
class StoredModel:
    """A model of the workspace.

    Attributes:
        id: structure and the head of the hash of the model, e.g. ``arx-1f00ba``.
        report: what ``fit`` had to say about it, JSON-able.
    """

    id: str
    path: Path
    model: "Model"
    report: dict[str, Any]


@dataclass(frozen=True)
class _StoredFile:
    """What the file of a model holds."""

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STORED

    id: str
    model: dict[str, Any]
    report: dict[str, Any]


@dataclass(frozen=True)
class _Remembered:
    """A value of state.json, and when it was remembered: the largest order is the newest."""

    __pydantic_config__: ClassVar[Mapping[str, Any]] = STORED

    value: Any
    order: int


class Workspace:
    """A folder that lets commands work in a row without paths; made when something is saved.

    What commands left in it that were killed while they wrote is put in order first.

    Attributes:
        plant_dir, diagnosis_dir, missions_dir: where ``export``, ``diagnose`` and ``simulate`` put
            their results by default.
        followed_dir: where the rows of a followed log are kept for its model.
    """

    def __init__(self, root: Path) -> None:
        from sysid.data.files import settle

        self.root = Path(root)
        self.plant_dir, self.diagnosis_dir = self.root / "plant", self.root / "diagnosis"
        self.missions_dir, self.followed_dir = self.root / "missions", self.root / "followed"
        with suppress(OSError):  # whatever is wrong with it, its use will say
            for folder in (self.root, *(p for p in self.root.iterdir() if p.is_dir())):
                settle(folder)

    def save(self, model: "Model", report: Mapping[str, Any]) -> StoredModel:
        """Store a model; the same model again replaces its report and becomes the newest."""
        from sysid.data.files import write_atomic

        described = model.to_json()
        canonical = json.dumps(_identity(described), sort_keys=True, separators=(",", ":"))
        digest = hashlib.sha256(canonical.encode()).hexdigest()
        kept = documents.plain_object(report)
        with self.locked():
            ids = self._ids()
            id = self._free_id(model.structure.name, digest, described)
            stored = StoredModel(id, self._path(id), model, kept)
            content = {"id": id, "model": described, "report": kept}
            write_atomic(stored.path, documents.text(content))
            self._write("index.json", [*(i for i in ids if i != id), id])
        return stored

    def load(self, id: str) -> StoredModel:
        """The model called ``id``, or the only one whose id begins like that."""
        ids = self._ids()
        matches = [i for i in ids if i == id] or [i for i in ids if id and i.startswith(id)]
        if len(matches) == 1:
            return self._read(matches[0])
        if matches:
            raise UsageError(f"{id!r} could be {', '.join(matches)}; give more letters of the id")
        there = f"there are {', '.join(ids)}" if ids else "it is empty; run `sysid fit` first"
        raise UsageError(f"no model {id!r} in the workspace {self.root}: {there}")

    def all(self) -> list[StoredModel]:
        """Every model that can be read, as of :meth:`readable`."""
        return self.readable()[0]

    def readable(self) -> tuple[list[StoredModel], dict[str, str]]:
        """The models in the order of saving, and id → why of those that cannot be read: a damaged
        file, or a structure of a package that is not installed.
        """
        models: list[StoredModel] = []
        unreadable: dict[str, ModelError] = {}
        for id in self._ids():
            try:
                models.append(self._read(id))
            except ModelError as error:
                unreadable[id] = error
        if unreadable and not models:
            raise next(iter(unreadable.values()))
        return models, {id: str(error) for id, error in unreadable.items()}

    def remove(self, id: str) -> str:
        """Delete one model by its id or the beginning of it; return its id.

        A damaged model can be removed too, under its full id.
        """
        ids = self._ids()
        gone = id if id in ids else self.load(id).id
        with self.locked():
            try:
                self._path(gone).unlink(missing_ok=True)
            except OSError as error:
                raise DataError(f"{gone} cannot be removed ({error.strerror})") from None
            self._write("index.json", [i for i in self._ids() if i != gone])
        return gone

    def remember(self, key: str, value: Any) -> None:
        """Keep a small JSON-able value under a name; the order of remembering is kept too."""
        with self.locked():
            state = self._state()
            latest = max((entry["order"] for entry in state.values()), default=0)
            state[key] = {"value": documents.plain(value), "order": latest + 1}
            self._write("state.json", state)

    def chosen(self, id: str | None) -> StoredModel:
        """The model a command works on when the user does not say which.

        That is ``id`` if it is given; else the newest of these: the winner of the last fit, the
        best of the last comparison, what the last diagnosis made. Removed ones are passed over.
        """
        if id is not None:
            return self.load(id)
        ids = self._ids()
        if not ids:
            raise ModelError(f"the workspace {self.root} holds no model; run `sysid fit` first")
        wanted = self._preferred("latest", "best", AUGMENTED)
        return self._read(next((i for i in wanted if i in ids), ids[-1]))

    def best_for(self, record: "Record") -> StoredModel | None:
        """The model of these channels and this sample time that ``chosen`` would come to first.

        Behind those remembered stand the others, the newest first. Models that a diagnosis made
        count only when a comparison put them first: else a diagnosis would doubt its own result.
        """
        ids, preferred = self._ids(), self._preferred("latest", "best")
        for id in dict.fromkeys([*(i for i in preferred if i in ids), *reversed(ids)]):
            try:
                stored = self._read(id)
            except ModelError:
                continue
            made = stored.model.provenance.options.get("made_by") == "diagnose"
            if made and id not in preferred:
                continue
            with suppress(ModelError):
                stored.model.check(record)
                return stored
        return None

    def _preferred(self, *keys: str) -> list[str]:
        """Ids remembered under these keys, the newer first; some may be gone."""
        state = self._state()
        newest_first = sorted(
            (state[key] for key in keys if key in state),
            key=lambda entry: -int(entry["order"]),
        )
        wanted: list[str] = []
        for entry in newest_first:
            value = entry["value"]
            wanted += value if isinstance(value, list) else [value]
        return wanted

    def _path(self, id: str) -> Path:
        return self.root / "models" / f"{id}.json"

    def _free_id(self, structure: str, digest: str, described: dict[str, Any]) -> str:
        for digits in range(_DIGITS, len(digest)):
            id = f"{structure}-{digest[:digits]}"
            taken: Any = None
            with suppress(ModelError):  # a damaged file of this very id is mended by writing it
                taken = self._json(self._path(id), missing={})
            if not isinstance(taken, dict) or _same(taken.get("model", described), described):
                return id
        return f"{structure}-{digest}"

    def _read(self, id: str) -> StoredModel:
        from sysid.structures.model import Model

        path = self._path(id)
        try:
            content = checked(_StoredFile, self._json(path))
        except ValueError as error:
            raise ModelError(
                f"{path} is damaged ({error}); remove it with `sysid models remove {id}`"
            ) from None
        if content.id != id:
            raise ModelError(
                f"{path} is damaged (it is of {content.id}); remove it with `sysid models remove "
                f"{id}`"
            )
        try:
            model = Model.from_json(content.model)
        except ModelError as error:
            raise ModelError(f"{path}: {error}") from None
        except LookupError:
            raise ModelError(f"{path} is damaged; fit the model again") from None
        return StoredModel(id, path, model, dict(content.report))

    def _ids(self) -> list[str]:
        """Ids in the order of saving; files the index does not know come last, by name."""
        self._check_root()
        folder = self.root / "models"
        try:
            there = {p.stem for p in folder.glob("*.json")} if folder.is_dir() else set()
        except OSError as error:
            raise DataError(f"{folder} cannot be read ({error.strerror})") from None
        path = self.root / "index.json"
        try:
            index = checked(tuple[str, ...], self._json(path, missing=[]))
        except ValueError as error:
            raise ModelError(f"{path} is damaged ({error}); delete it") from None
        known = [i for i in index if i in there]
        return [*known, *sorted(there.difference(known))]

    def _state(self) -> dict[str, dict[str, Any]]:
        self._check_root()
        path = self.root / "state.json"
        state: dict[str, dict[str, Any]] = self._json(path, missing={})
        try:
            checked(dict[str, _Remembered], state)
        except ValueError as error:
            raise ModelError(f"{path} is damaged ({error}); delete it and fit again") from None
        return state

    def _json(self, path: Path, missing: Any = None) -> Any:
        from sysid.data.files import contents

        try:
            return documents.parsed(contents(path))
        except FileNotFoundError:
            if missing is not None:
                return missing
            raise ModelError(f"{path} is gone; fit the model again") from None
        except OSError as error:
            raise ModelError(f"{path} cannot be read ({error.strerror})") from None
        except ValueError as error:
            raise ModelError(f"{path} is damaged ({error}); delete it") from None

    def _write(self, name: str, value: Any) -> None:
        from sysid.data.files import write_atomic

        write_atomic(self.root / name, documents.text(value))

    def _check_root(self) -> None:
        if self.root.exists() and not self.root.is_dir():
            raise UsageError(f"the workspace {self.root} is a file; name a folder")

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the workspace for reading, changing and writing back."""
        self._check_root()
        try:
            self.root.mkdir(parents=True, exist_ok=True)
            lock = open(self.root / ".lock", "ab")  # noqa: SIM115 (closed below, after the block)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise DataError(
                f"the workspace {self.root} cannot be written ({reason}); choose another folder"
            ) from None
        with lock:  # closing it lets go of the lock
            with suppress(OSError):  # some network disks know no locks: still whole files
                _lock(lock.fileno())
            yield
