"""Messages name fields of the library, which the command line shows as options that exist."""

import ast
import re
import shlex
from dataclasses import fields
from inspect import signature
from pathlib import Path
from typing import Any

import pytest
import typer
from command_line import Capture, robot_log, run
from named_fields import MARKED, messages
from sysid_cli import reading
from sysid_cli.app import app
from sysid_cli.field_options import Line, every_command, fields_in, options_of, with_options
from sysid_cli.options import group

import sysid
from sysid.data.excitation import DESIGNS
from sysid.data.io import read_file
from sysid.data.preparation import Preparation
from sysid.errors import SysidError, argument
from sysid.estimation.assessment.findings import Policy
from sysid.export.verification.verify import verify

ROOT = Path(__file__).resolve().parents[2]
GROUP: Any = typer.main.get_command(app)
LINE = Line(GROUP)
OPTIONS = {
    name: {word for p in command.params for word in p.opts}
    for name, command in every_command(GROUP).items()
}
EVERYWHERE = {
    "--debug",
    "--help",
    "--help-all",
    "--quiet",
    *(o for p in GROUP.params for o in p.opts),
}
"""Options of the root, and flags that every line may hold."""

SHOWN_BY = {
    "cli/reading.py": ("inspect", "fit", "diagnose"),  # those that compose all of it
    "cli/report.py": ("fit",),  # the line that makes a model again
    "cli/bag_contents.py": ("inspect", "fit"),  # the line to paste is a fit
    "cli/mission_options.py": ("diagnose",),
    "cli/missions": ("simulate",),
    "cli/vehicles/fit_vehicle.py": ("fit-vehicle",),
    "cli/fit_options.py": ("fit",),
    "cli/live": ("fit",),
    "cli/targets.py": ("simulate", "plan"),
    "cli/structures.py": ("fit",),
    "cli/optimal.py": ("excite",),
}
"""Module or folder of the command line → the commands whose messages it writes."""

WITH_COMMAND = re.compile(r"sysid ((?:bench )?[\w-]+)(?:(?!sysid)[^`\n])*?(--[a-z][a-z-]+)")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")

NO_MESSAGES = {
    "sysid/export/c/templates/CMakeLists.txt": "lines to type where the C code is built",
    "sysid/export/c/templates/report.md": "the page of the C code: lines to type where it is built",
    "sysid/export/verification/ros_nodes.py": "options of cmake and rosmaster, which it starts",
    "sysid/plant/templates/README.md": "the page of a package: lines to type where it is used",
    "sysid/report/movement.py": "variables of CSS are written like options",
    "sysid/report/templates/style.css.j2": "variables of CSS are written like options",
}
"""Files of the library that may hold what looks like an option, and why."""


def named_options() -> list[tuple[str, str, str]]:
    """(place, option, command) of every option a message of the command line names."""
    found = []
    for path in sorted((ROOT / "cli").rglob("*.py")):
        module = path.relative_to(ROOT).as_posix()
        folder = path.parent.name.removeprefix("test")
        name = next((n for n in (path.stem, f"{folder} {path.stem}") if n in OPTIONS), "")
        own = (name,) if name else SHOWN_BY.get(str(Path(module).parent))
        shown = SHOWN_BY.get(module, own)
        for line, text in messages(path):
            if module == "cli/reading.py" and OPTION.fullmatch(text):
                continue  # declared there, for the commands that compose it
            said = {option: command for command, option in WITH_COMMAND.findall(text)}
            for option in set(OPTION.findall(text)) - EVERYWHERE:
                place = f"{module}:{line}"
                assert option in said or shown, f"{place} names {option}: which commands show it?"
                commands = (said[option],) if option in said else shown or ()
                found += [(place, option, command) for command in commands]
    return found


def named_fields() -> list[tuple[str, str]]:
    """(place, field) of every field a message of the library names."""
    found = []
    for path in sorted((ROOT / "sysid").rglob("*.py")):
        module = path.relative_to(ROOT).as_posix()
        for line, text in messages(path):
            for marked in MARKED.findall(text):
                given = fields_in(marked)
                assert given, f"{module}:{line}: `{marked}` is no argument of a call"
                found += [(f"{module}:{line}", name) for name, _ in given]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "argument":
                found += [(f"{module}:{node.lineno}", str(k.arg)) for k in node.keywords]
    return found


def arguments_of_scripts() -> set[str]:
    """Every argument of the façade's functions and classes of options."""
    verbs = (sysid.fit, sysid.identify, sysid.compare, sysid.diagnose, sysid.tune, sysid.load_plant,
             sysid.forecast, sysid.look,
             sysid.inertia_of_logs, sysid.inertia_of_period, sysid.Hanging,
             sysid.fit_vehicle, sysid.bench_power, sysid.LiveFit, verify)  # fmt: skip
    options = (sysid.ReadOptions, sysid.FitOptions, Policy, Preparation, sysid.MotorOptions)
    return {p for verb in verbs for p in signature(verb).parameters} | {
        f.name for cls in options for f in fields(cls)
    }


def test_the_library_names_no_option() -> None:
    wrong = []
    for path in sorted((ROOT / "sysid").rglob("*")):
        module = path.relative_to(ROOT).as_posix()
        if path.is_file() and path.suffix != ".pyc" and module not in NO_MESSAGES:
            lines = enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
            wrong += [f"{module}:{n}: {line}" for n, line in lines if OPTION.search(line)]
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
def test_every_field_a_message_names_is_an_option_and_an_argument() -> None:
    every = named_fields()
    assert len(every) > 120
    known = set().union(*(options_of(command) for command in every_command(GROUP).values()))
    wrong = [f"{place}: no command has an option of {name}" for place, name in every
             if name not in known]  # fmt: skip
    wrong += [f"{place}: no script can give {name}" for place, name in every
              if name not in arguments_of_scripts()]  # fmt: skip
    assert not wrong, "\n".join(wrong)


def test_every_option_a_message_names_is_one_of_the_command_that_shows_it() -> None:
    every = named_options()
    assert len(every) > 40
    wrong = [
        f"{place}: sysid {command} has no {option}"
        for place, option, command in every
        if option not in OPTIONS.get(command, set())
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("command", "text", "shown"),
    [
        ("fit", "give `ts`", "give --ts"),
        ("fit", "`ts=SECONDS`.", "--ts SECONDS."),
        ("fit", "`inputs='u', outputs=['a b', 'c']`", "--input u --output 'a b,c'"),
        ("fit", "`units={'t': 'ms', 'y [x]': 'V'}`", "--unit t=ms --unit 'y [x]=V'"),
        ("fit", "`unwrap={'enc': 4096.0}`, `unwrap={'enc': None}`",
         "--unwrap enc=4096, --unwrap enc=none"),
        ("fit", "`structure_options['terms']`: no", "--option terms: no"),
        ("fit", "`structure_options={'torque_constant': G}`", "--option torque_constant=G"),
        ("fit", "`stable=True` or `focus='simulation'`", "--stable or --focus simulation"),
        ("compare", "with `stable=True`, `split=0.7`",
         "with `sysid fit --stable`, `sysid fit --split 0.7`"),
        ("compare", "`validation=LOG, criterion='fit'`", "--val LOG --criterion fit"),
        ("models", "`ts`", "`sysid inspect --ts`"),
        ("fit", "`sysid fit`, `c`, `ts =`, `ts[`, `goal`, `f(ts)`",
         "`sysid fit`, `c`, `ts =`, `ts[`, `goal`, `f(ts)`"),
    ],
)  # fmt: skip
def test_fields_become_options_of_the_running_command(command: str, text: str, shown: str) -> None:
    running = GROUP.commands[command]
    with running.make_context(command, [], resilient_parsing=True, obj=LINE):
        assert with_options(text) == shown


@pytest.mark.parametrize(
    "given",
    [
        {"inputs": ["u 1", "u2"], "outputs": "y's", "time": "t [s]"},
        {"units": {"t": "ms", "speed (km/h)": "counts=20/rev"}, "ts": 0.02, "pwm_max": 255.0},
        {"unwrap": {"a": 65536.0, "b": None}, "speed_of": ["a", "b"], "held": "keep"},
        {"join_offset": -1.5, "resample": "fill", "delimiter": ";", "decimal": ","},
    ],
)
def test_what_a_message_tells_a_script_and_a_person_is_the_same(given: dict[str, Any]) -> None:
    inspect = GROUP.commands["inspect"]
    with inspect.make_context("inspect", [], resilient_parsing=True, obj=LINE):
        words = shlex.split(with_options(argument(**given)))
    typed = inspect.make_context("inspect", ["log.csv", *words]).params
    options = group(reading.Reading)
    own = {p.name: typed[p.name] for p in options.parameters()}
    assert options.built(own) == sysid.ReadOptions(**given)


@pytest.mark.parametrize(
    ("reads", "fits", "line"),
    [
        ({"inputs": "v"}, {}, ["--input", "v"]),
        ({"units": {"z": "rpm"}}, {}, ["--unit", "z=rpm"]),
        ({"resample": "maybe"}, {}, ["--resample", "maybe"]),
        ({"ts": -1.0}, {}, ["--ts", "-1"]),
        ({"held": "half"}, {}, ["--held", "half"]),
        ({}, {"orders": "na=x"}, ["--structure", "arx", "--orders", "na=x"]),
        ({}, {"split": 2.0}, ["--split", "2"]),
        ({}, {"structures": ["narmax"], "options": {"degree": "99"}},
         ["--structure", "narmax", "--option", "degree=99"]),
        ({}, {"structures": ["oe"], "options": {"degree": "9"}},
         ["--structure", "oe", "--option", "degree=9"]),
        ({}, {"structures": ["narmax"], "orders": "na=1 nb=1 nk=1", "options": {"terms": "y(t-1"}},
         ["--structure", "narmax", "--orders", "na=1 nb=1 nk=1", "--option", "terms=y(t-1"]),
    ],
)  # fmt: skip
def test_an_error_names_the_argument_in_a_script_and_the_option_on_the_line(
    tmp_path: Path, capsys: Capture, reads: dict[str, Any], fits: dict[str, Any], line: list[str]
) -> None:
    log = robot_log(tmp_path / "log.csv", 60)
    options = sysid.FitOptions(structure_options=fits.get("options", {}))

    def scripted() -> None:
        record = sysid.read_log(log, sysid.ReadOptions(**reads))
        sysid.identify(record, **(fits | {"options": options}))

    with pytest.raises(SysidError) as refused:
        scripted()
    assert "--" not in str(refused.value)
    named = {name for m in MARKED.findall(str(refused.value)) for name, _ in fields_in(m)}
    assert named & ({*reads} | {"structure_options" if n == "options" else n for n in fits})
    shown = run(capsys, "fit", log, *line, "--workspace", tmp_path / "w")
    assert shown.code in (1, 2)
    assert "`" not in shown.err
    with GROUP.commands["fit"].make_context("fit", [], resilient_parsing=True, obj=LINE):
        assert " ".join(shown.err.split()) == " ".join(with_options(str(refused.value)).split())


def test_a_document_and_a_table_show_options_too(tmp_path: Path, capsys: Capture) -> None:
    """A log without a time: the finding is stored with its field and shown with the option."""
    log = robot_log(tmp_path / "log.csv", 60)
    text = "\n".join(row.partition(",")[2] for row in log.read_text().splitlines())
    log.write_text(text + "\n")
    advice = [f.advice for f in read_file(log).findings]
    assert advice == ["Give the sample time in seconds with `ts`."]
    document = run(capsys, "inspect", log, "--json").document
    (shown,) = (f["advice"] for f in document["findings"] if f["code"] == "sample-time")
    assert shown == "Give the sample time in seconds with --ts."
    assert shown in " ".join(run(capsys, "inspect", log).out.split())


@pytest.mark.parametrize("design", DESIGNS)
def test_every_argument_of_a_schedule_is_an_option(design: str) -> None:
    wanted = {*signature(DESIGNS[design]).parameters} - {"names"}
    known = options_of(every_command(GROUP)["excite"]).keys()
    assert wanted - known <= {"rotate", "tries"}  # --tracks opposite; not for users


def test_options_in_the_documentation_exist() -> None:
    """Inline code such as `--split`: an option of some command, of pytest, git or a script."""
    others = re.compile(r"^(python|gate\.py|\.venv|make|cc|pip|git|pytest|datasets)")
    known = set().union(*OPTIONS.values()) | EVERYWHERE
    wrong = []
    for page in (*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"):
        if page.name in ("gate.md", "0037-one-word-on-the-line.md"):
            continue  # options of a script, and former ones
        for code in re.findall(r"`([^`\n]+)`", page.read_text(encoding="utf-8")):
            if not others.match(code):
                wrong += [f"{page.name}: {o}" for o in OPTION.findall(code) if o not in known]
    assert not wrong, wrong
