"""A unit called as the standard allows, and as it does not: both versions, by raw calls."""

import ctypes
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_programs import needs_compiler
from plant_models import robot_model

from sysid.export.package import write_package
from sysid.export.verification.co_simulated import FOLDERS

pytestmark = [
    pytest.mark.skipif(find_spec("fmpy") is None, reason="the extra fmu is not installed"),
    needs_compiler,
]

STEP = 0.1
"""Sample time of the plant [s]."""
OK, ERROR = 0, 3
"""Status of both versions."""


class Library:
    """The functions of a unit without anything in between."""

    def __init__(self, unit: Path, folder: Path) -> None:
        import fmpy

        self.about = fmpy.read_model_description(str(unit))
        self.second = self.about.fmiVersion == "2.0"
        made = fmpy.extract(str(unit), unzipdir=str(folder))
        (binary,) = Path(made).glob("binaries/*/plant.*")
        self.code = ctypes.CDLL(str(binary))
        self.places = {v.name: v.valueReference for v in self.about.modelVariables}
        self.real = "Real" if self.second else "Float64"

    def __call__(self, name: str, *arguments: Any) -> int:
        function = getattr(self.code, f"fmi{2 if self.second else 3}{name}")
        return int(function(*arguments))

    def instance(self, guid: str | None = None) -> "Instance":
        token = (guid or self.about.guid or self.about.instantiationToken).encode()
        kept: list[str] = []
        log: Any
        if self.second:
            kind = ctypes.CFUNCTYPE(
                None, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, *[ctypes.c_char_p] * 2
            )
            log = kind(lambda environment, name, status, category, said: kept.append(said.decode()))
            callbacks = (ctypes.c_void_p * 5)(ctypes.cast(log, ctypes.c_void_p).value)
            make = self.code.fmi2Instantiate
            arguments: tuple[Any, ...] = (b"one", 1, token, b"", ctypes.byref(callbacks), 0, 0)
        else:
            kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, *[ctypes.c_char_p] * 2)
            log = kind(lambda environment, status, category, said: kept.append(said.decode()))
            make = self.code.fmi3InstantiateCoSimulation
            no = ctypes.c_bool(False)
            nothing = ctypes.c_void_p(None)
            arguments = (b"one", token, b"", no, no, no, no, nothing, ctypes.c_size_t(0), nothing)
            arguments = (*arguments, log, nothing)
        make.restype = ctypes.c_void_p
        return Instance(self, make(*arguments), kept, log)


class Instance:
    """One instance, and what it says."""

    def __init__(self, library: Library, handle: int | None, said: list[str], log: Any) -> None:
        self.library, self.handle, self.said, self.log = library, handle, said, log

    def call(self, name: str, *arguments: Any) -> int:
        return self.library(name, ctypes.c_void_p(self.handle), *arguments)

    def values(self, verb: str, at: list[int], values: Any, kind: str = "") -> int:
        places = (ctypes.c_uint * len(at))(*at)
        n = ctypes.c_size_t(len(at))
        more = () if self.library.second else (n,)
        return self.call(f"{verb}{kind or self.library.real}", places, n, values, *more)

    def put(self, **given: float) -> int:
        at = [self.library.places[n] for n in given]
        return self.values("Set", at, (ctypes.c_double * len(at))(*given.values()))

    def switch(self, name: str, on: bool) -> int:
        kind = ctypes.c_int if self.library.second else ctypes.c_bool
        return self.values("Set", [self.library.places[name]], (kind * 1)(on), "Boolean")

    def get(self, *names: str) -> list[float]:
        result = (ctypes.c_double * len(names))()
        assert self.values("Get", [self.library.places[n] for n in names], result) == OK, self.said
        return list(result)

    def enter(self) -> int:
        zero, no = ctypes.c_double(0.0), ctypes.c_int(0)
        if self.library.second:
            self.call("SetupExperiment", no, zero, zero, no, zero)
            return self.call("EnterInitializationMode")
        no3 = ctypes.c_bool(False)
        return self.call("EnterInitializationMode", no3, zero, zero, no3, zero)

    def begin(self) -> "Instance":
        assert (self.enter(), self.call("ExitInitializationMode")) == (OK, OK), self.said
        return self

    def step(self, k: float, length: float = STEP) -> int:
        time, step = ctypes.c_double(k * STEP), ctypes.c_double(length)
        if self.library.second:
            return self.call("DoStep", time, step, ctypes.c_int(1))
        shown = [ctypes.byref(ctypes.c_bool()) for _ in range(3)]
        reached = ctypes.byref(ctypes.c_double())
        return self.call("DoStep", time, step, ctypes.c_bool(True), *shown, reached)

    def run(self, first: int, samples: int) -> np.ndarray:
        """Outputs after each of some steps under inputs that change."""
        rows = []
        for k in range(first, first + samples):
            assert self.put(pwm_l=1e4 * np.sin(k), pwm_r=8e3 * np.cos(2 * k)) == OK
            assert self.step(k) == OK, self.said
            rows.append(self.get("omega_l", "omega_r"))
        return np.array(rows)


@pytest.fixture(scope="module", params=FOLDERS)
def library(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Library:
    folder = tmp_path_factory.mktemp(request.param)
    package = write_package(robot_model(), folder / "plant", formats=[request.param])
    return Library(package / request.param / "plant.fmu", folder / "unit")


def test_calls_in_the_wrong_order_say_so_and_change_nothing(library: Library) -> None:
    one, other = library.instance(), library.instance().begin()
    number = (ctypes.c_double * 1)()
    omega = [library.places["omega_l"]]
    assert one.step(0) == ERROR
    assert one.call("ExitInitializationMode") == ERROR
    assert one.call("Terminate") == ERROR
    assert one.values("Get", omega, number) == ERROR
    assert one.enter() == OK
    assert one.enter() == ERROR
    assert one.step(0) == ERROR
    assert one.call("ExitInitializationMode") == OK
    assert one.call("ExitInitializationMode") == ERROR
    assert one.put(start_0=1.0) == ERROR
    assert "fixed parameter" in one.said[-1]
    assert one.put(omega_l=1.0) == ERROR
    assert one.put(pwm_l=float("nan")) == ERROR
    assert one.put(pwm_l=float("inf")) == ERROR
    for length in (0.0, -STEP, 0.5 * STEP, np.sqrt(2.0) * STEP, float("nan"), 1e300):
        assert one.step(0, length) == ERROR, length
    assert one.step(3) == ERROR
    assert "the last one ended" in one.said[-1]
    # what was refused left nothing behind
    assert np.array_equal(one.run(0, 5), other.run(0, 5))
    assert one.call("Terminate") == OK
    assert one.get("omega_l") == other.get("omega_l")
    assert one.step(5) == ERROR
    assert one.put(pwm_l=1.0) == ERROR


def test_places_that_do_not_exist_are_errors(library: Library) -> None:
    one, number = library.instance().begin(), (ctypes.c_double * 2)()
    for at in (len(library.places) + 1, 2**31, 2**32 - 1, library.places["start_settled"]):
        assert one.values("Get", [at], number) == ERROR, at
        assert one.values("Set", [at], number) == ERROR, at
    assert one.values("Get", [0], (ctypes.c_int * 1)(), "Boolean") == ERROR
    assert one.values("Get", [0], None) == ERROR
    assert one.values("Get", [], None) == OK
    nobody = Instance(library, None, [], None)
    assert nobody.put(pwm_l=0.0) == ERROR
    assert nobody.step(0) == ERROR
    assert nobody.call("Reset") == ERROR


def test_a_unit_of_another_guid_is_not_made(library: Library) -> None:
    refused = library.instance("{another}")
    assert refused.handle is None
    assert "modelDescription.xml" in refused.said[-1]


def test_reset_begins_anew_and_instances_share_nothing(library: Library) -> None:
    one, other = library.instance().begin(), library.instance().begin()
    first = one.run(0, 6)
    other.put(pwm_l=-5e3)
    for k in range(4):
        assert other.step(k) == OK
    one.call("Reset")
    assert np.array_equal(one.begin().run(0, 6), first)


def test_a_state_that_was_kept_is_taken_up_again(library: Library) -> None:
    one, other = library.instance().begin(), library.instance().begin()
    name = "FMUstate" if library.second else "FMUState"
    write = "DeSerialize" if library.second else "Deserialize"
    one.run(0, 4)
    kept = ctypes.c_void_p()
    assert one.call(f"Get{name}", ctypes.byref(kept)) == OK
    expected = one.run(4, 5)
    assert one.call(f"Set{name}", kept) == OK
    assert np.array_equal(one.run(4, 5), expected)
    size = ctypes.c_size_t()
    assert one.call(f"Serialized{name}Size", kept, ctypes.byref(size)) == OK
    bytes_of = (ctypes.c_char * size.value)()
    assert one.call(f"Serialize{name}", kept, bytes_of, size) == OK
    assert one.call(f"Free{name}", ctypes.byref(kept)) == OK
    assert kept.value is None
    assert one.call(f"Set{name}", kept) == ERROR
    assert other.call(f"{write}{name}", bytes_of, size, ctypes.byref(kept)) == OK
    assert other.call(f"Set{name}", kept) == OK
    assert np.array_equal(other.run(4, 5), expected)
    assert other.call(f"Free{name}", ctypes.byref(kept)) == OK
    short = ctypes.c_size_t(size.value - 1)
    assert other.call(f"{write}{name}", bytes_of, short, ctypes.byref(kept)) == ERROR
    assert other.call(f"{write}{name}", bytes(size.value), size, ctypes.byref(kept)) == ERROR


def test_a_parameter_may_change_between_two_steps(library: Library) -> None:
    model = robot_model()
    theta = model.theta.copy()
    theta[0] *= 1.5
    (name,) = (
        v.name for v in library.about.modelVariables if v.start == repr(float(model.theta[0]))
    )
    one = library.instance().begin()
    state, changed = model.plant().initial_state(), replace(model, theta=theta).plant()
    plant, rows = model.plant(), []
    result = one.run(0, 3)
    assert one.put(**{name: theta[0]}) == OK
    result = np.vstack([result, one.run(3, 3)])
    for k in range(6):
        now = plant if k < 3 else changed
        u = np.array([1e4 * np.sin(k), 8e3 * np.cos(2 * k)])
        state, _ = now.step(state, u)
        rows.append(now.readout(state, u))
    assert result == pytest.approx(np.array(rows), rel=1e-12)


def test_a_start_in_the_middle_of_motion(library: Library) -> None:
    long, settled = library.instance().begin(), library.instance()
    assert long.put(pwm_l=9e3, pwm_r=6e3) == OK
    assert long.step(0, 4000 * STEP) == OK  # over 100 of the slowest time constants
    assert settled.put(pwm_l=9e3, pwm_r=6e3) == OK
    assert settled.switch("start_settled", True) == OK
    settled.begin()
    moving = long.get("omega_l", "omega_r")
    assert min(moving) > 1.0
    assert settled.get("omega_l", "omega_r") == pytest.approx(moving, rel=1e-12)
    states = [n for n in library.places if n.startswith("state_")]
    taken_up = library.instance()
    for name, value in zip(states, long.get(*states), strict=True):
        assert taken_up.put(**{name.replace("state", "start"): value}) == OK
    taken_up.begin()
    for k in range(5):
        for instance, first in ((long, 4000), (taken_up, 0)):
            assert instance.put(pwm_l=-3e3, pwm_r=2e3) == OK
            assert instance.step(first + k) == OK
        assert taken_up.get("omega_l") == pytest.approx(long.get("omega_l"), rel=1e-12)
