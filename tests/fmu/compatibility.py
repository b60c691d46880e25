"""Writes docs/fmu_compatibility.md: FMUs in the hosts that are installed here, and what checkers find.

    LATIN_FMU_HOSTS=~/fmi-hosts python -m tests.fmu.compatibility

The FMU of two blocks is run in every host of ``install_hosts.sh`` and its output compared with a session of the solver;
the shipped models are run in FMPy and compared with the reference run that they carry. What is not installed is written
as not run.
"""

from __future__ import annotations

import argparse
import io
import json
import platform
import re
import shlex
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import fromstring

import fmpy
import numpy as np

import latin_fmu
from fmu_build.build import build_fmu, build_model_exchange
from fmu_build.checks import validate, with_inputs
from fmu_build.drive import Drive
from fmu_build.reference import FOLDER, reference_of
from latin_fmu.cosim import Session, Settings
from tests.cosim.scenes import blocks
from tests.scenes import MINUTES

from .host import hosts_folder

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "fmu_compatibility.md"
STEP, N, INPUT, VALUE, OUTPUT = 1e-6, 4, "load.press.value", 0.6, "interface.crush.force[3]"
TUNED: tuple[str, float] = ("interface.crush.friction_coefficient", 0.05)
"""A tunable parameter, and what it is set to after N / 2 steps."""
CLOSE = 1e-9
"""Largest difference that passes, relative to the peak of an output over all its components."""
EXCHANGE = 0.02
"""The same of the impulse of a reduced model for Model Exchange."""
KINDS = ("with Python", "compiled")
VERSIONS: tuple[Literal["2", "3"], ...] = ("2", "3")

HOSTS = (
    ("libcosimpy", "libcosimpy", "common", ("2",)),
    ("ecospy", "ecospy", "common", ("2", "3")),
    ("pathsim-fmi", "pathsim", "common", ("2", "3")),
    ("cofmupy", "cofmupy", "cofmupy", ("2", "3")),
    ("gemseo-fmu", "gemseo", "gemseo", ("2", "3")),
    ("OMSimulator", "omsimulator", "common", ("2",)),
    ("fmuloader", "fmuloader", "common", ("3",)),
)
"""Distribution, X of its script ``hosts/with_X.py``, environment, versions of the FMI."""
LATE = {"pathsim": "; every output is a step late there: it is read after the step that begins at its time"}
"""What a host does with outputs, by its script."""
TUNING = ("libcosimpy", "ecospy", "pathsim", "omsimulator", "fmuloader")
"""Scripts of hosts that set parameters after the start."""
FRICTION = 0.2
"""The coefficient of friction of the scene of the two blocks."""

TESTED = (
    ("a host in C (`tests/fmu/host.c`)", "2.0", "with Python", "test_c_host.py"),
    (
        "hosts in C, empty environment (`tests/fmu/steps.c`)",
        "2.0",
        "compiled",
        "test_compiled.py -k 'in_c or cycles or failure_is'",
    ),
    ("libcosimpy, two FMUs joined by wave ports", "2.0", "with Python", "test_ports.py -k libcosim"),
    ("fmucontainer of two FMUs, in FMPy", "2.0", "with Python", "test_hosts.py -k container"),
    ("OMSimulator, SSP of two FMUs that are connected", "2.0", "with Python", "test_hosts.py -k ssp_in_omsimulator"),
    ("pathsim-fmi (Runge-Kutta)", "3.0", "model exchange", "test_model_exchange.py -m slow -k another_host"),
)
"""Importer, versions of the FMI, kind, tests that run it."""

NOT_HERE = (
    ("fmusim 0.8 (Modelica Association)", "2.0, 3.0", "compiled", "not run: its sources need packages of Rust"),
    (
        "fmuloader 0.1.2rc0",
        "2.0",
        "both",
        "not run: it requires functions of model exchange of each FMU (`findings/fmuloader_needs_model_exchange.sh`)",
    ),
    ("fmusim 0.0.39 (Reference FMUs)", "2.0, 3.0", "both", "not run: runs of less than 1e-5 s have no step there"),
    ("OMSimulator 3.0.0", "3.0", "both", "not run: it ends with the reference FMU Dahlquist of FMI 3, too"),
    (
        "preCICE with fmiprecice 0.2.1",
        "2.0, 3.0",
        "both",
        "not run: pyprecice 3.4.0 has no wheel, and is not built without an installed libprecice",
    ),
    ("Simulink", "2.0, 3.0", "both", "not run: commercial"),
)
"""Importers for which there is no script, and why."""
STALLS = {"gripped_bar/scene": 1e-3}
"""Models whose acceleration stalls in some time steps: a compiled FMU makes these anew, a session goes on from its best
iterate, so that they agree to the tolerance of the iteration."""

HEAD = """\
<!-- written by: python -m tests.fmu.compatibility -->

# FMU compatibility

Exporter: latin_fmu {version}. Printed by `python -m tests.fmu.compatibility` on {system}, CPython {python}, with
the hosts of `tests/fmu/install_hosts.sh` that were installed.

- **passed**: instantiated, an input set, stepped, an output read, which is that of the solver without the FMI to
  {close:g} of its peak (model exchange: the impulse within {exchange:g}). A number of tests instead: they make
  failures, rollback, cycles of instances, connections.
- **failed**: another number, or an error, which is given.
- **not run**: not installed on the machine that wrote this page, or as it says.

[Join it to your tool](join_your_tool.md) has a section on each kind of tool.

## Importers

"""
PARAMETERS = """
## A parameter changed under way

`{name}` is set to {value:g} after {n} steps, and all outputs compared with a session whose
friction is changed at the same time. Not tried: cofmupy, gemseo-fmu.

"""
MODELS = """
## Shipped models

In FMPy {version}, every load an input: the inputs of the reference run that an FMU carries are set, its outputs
compared. The numbers are the largest difference of an output, relative to its peak. Not run: `bolted_beam`,
`electronics_box`, `thin_beam`: they take minutes to make. The acceleration of `gripped_bar` stalls in some steps, which
a compiled FMU makes anew with relaxation 1/2, and a session continues: there the number is relative to the largest
output of the unit, of quantities with a unit, and the limit is {stalls:g}.

"""
CHECKERS = """
## Checkers

"""


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(cells)} |\n".replace(" --- ", "---") for cells in lines)


@cache
def expected(tuned: bool = False) -> tuple[float, ...]:
    """The output after each step, of the solver, with the parameter changed under way where it is ``tuned``."""
    session, rows = Session(blocks(), Settings(keep=False)), []
    session.set_load("press", VALUE)
    session.initialize()
    for i in range(N):
        if tuned and i == N // 2:
            session.parameters[TUNED[0]] = TUNED[1]
        assert session.step(i * STEP, STEP)
        rows.append(session.value(OUTPUT))
    return tuple(rows)


def judged(off: float, limit: float = CLOSE) -> str:
    """The result of a run in words, by its difference."""
    return "passed" if off <= limit else f"failed: off by {off:.1g}"


def installed(environment: str, distribution: str) -> tuple[Path | None, str]:
    """Python of an environment and version of a distribution there; None and the pinned version where it is missing."""
    pins = dict(re.findall(r"([\w-]+)==([\d.]+)", Path(__file__).with_name("install_hosts.sh").read_text()))
    folder = hosts_folder()
    python = None if folder is None else folder / environment / "bin" / "python"
    if python is None or not python.exists():
        return None, pins[distribution]
    ask = f"import importlib.metadata as m; print(m.version({distribution!r}))"
    done = subprocess.run([str(python), "-c", ask], capture_output=True, text=True, check=False)
    return (python, done.stdout.strip()) if done.returncode == 0 else (None, pins[distribution])


def in_host(python: Path, script: Path, fmu: Path, tuned: bool = False) -> str:
    """Run the FMU of the two blocks in a host of its own process."""
    given = [str(fmu), str(STEP), str(N), INPUT, str(VALUE), OUTPUT, *(map(str, TUNED) if tuned else ())]
    command = [str(python), str(script), *given]
    done = subprocess.run(command, capture_output=True, text=True, cwd=fmu.parent, timeout=300, check=False)
    rows = [line for line in done.stdout.splitlines() if re.fullmatch(r"\[[-+\d.e, ]+\]", line)]
    if done.returncode or not rows:
        said = (done.stderr or done.stdout).strip().splitlines() or [f"status {done.returncode}"]
        return f"failed: {said[-1][:120]}"
    first = 1 if script.stem.removeprefix("with_") in LATE else 0
    got, wanted = np.array(json.loads(rows[-1])[: N - first]), np.array(expected(tuned)[first:])
    return judged(float(np.abs(got - wanted).max() / np.abs(wanted).max()))


def by_tests(words: str) -> str:
    """The result of a run of tests of this folder."""
    file, *options = shlex.split(words)
    path = str(Path(__file__).with_name(file))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", path, *options]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=900, check=False)
    counts = {word: int(number) for number, word in re.findall(r"(\d+) (passed|failed|skipped|error)", done.stdout)}
    if "failed" in counts or "error" in counts:
        return f"failed: {counts.get('failed', 0) + counts.get('error', 0)} tests"
    return f"passed: {counts['passed']} tests" if "passed" in counts else "not run"


def columns(content: bytes) -> dict[str, list[float]]:
    """Columns of a table by name."""
    numbers = np.loadtxt(io.BytesIO(content), delimiter=",", skiprows=1, ndmin=2)
    return dict(zip(content.decode().splitlines()[0].split(","), numbers.T.tolist(), strict=True))


def in_fmpy(fmu: Path, stalls: bool = False) -> float:
    """Largest difference of an output from the reference run that an FMU carries, relative to its peak; of a model that
    ``stalls`` relative to the largest output of its unit, numbers of points and iterations left out."""
    with zipfile.ZipFile(fmu) as archive:
        files = {Path(name).name: archive.read(name) for name in archive.namelist() if name.startswith(FOLDER)}
    (experiment,) = fromstring(next(content for name, content in files.items() if name.endswith(".exp")))
    given = {child.tag: columns(files[child.attrib["source"]]) for child in experiment}
    wanted, off = given["References"], 0.0
    with closing(Drive(fmu, None, given.get("Stimuli"))) as drive:
        size, stop = (float(experiment.attrib[name]) for name in ("stepSize", "stopTime"))
        rows = np.array(list(drive.run(size, stop)))
        got = dict(zip(["time", *drive.outputs], rows.T, strict=True))
    if drive.complaint:
        raise RuntimeError(drive.complaint)
    at = np.searchsorted(got["time"], np.array(wanted["time"]) * (1.0 - 1e-9))
    units = {v.name: v.unit for v in fmpy.read_model_description(str(fmu)).modelVariables}
    if stalls:
        parts = [name for name in wanted if name != "time" and units[name] not in (None, "1")]
        largest = dict.fromkeys((units[name] for name in parts), 0.0)
        for name in parts:
            largest[units[name]] = max(largest[units[name]], float(np.abs(wanted[name]).max()))
        return max(float(np.abs(got[name][at] - wanted[name]).max()) / largest[units[name]] for name in parts)
    for name, column in wanted.items():
        kind = "energy." if name.startswith("energy.") else name.partition("[")[0]
        scale = max(np.abs(other).max() for n, other in wanted.items() if n.startswith(kind))
        off = max(off, float(np.abs(got[name][at] - column).max() / max(scale, np.finfo(float).tiny)))
    return off


def exchanged(folder: Path) -> str:
    """The crushing as a reduced model, in CVode: the impulse of its contact against that of the solver."""
    scene, name = latin_fmu.load_scene(ROOT / "models" / "two_specimen_crushing" / "scene.toml"), "crush.impulse[3]"
    session = Session(scene, Settings(keep=False))
    session.initialize()
    assert session.step(0.0, scene.time.end)
    result = fmpy.simulate_fmu(str(build_model_exchange(scene, folder / "reduced.fmu")), stop_time=scene.time.end)
    wanted = session.value(f"interface.{name}")
    return judged(abs(result[f"interface.{name}"][-1] - wanted) / abs(wanted), EXCHANGE)


def importers(folder: Path, fmus: Mapping[tuple[str, str], Path]) -> Iterator[tuple[str, ...]]:
    """Rows of the table of importers."""
    own = f"FMPy {version('fmpy')}"
    for (fmi, kind), fmu in fmus.items():
        yield own, f"{fmi}.0", kind, judged(in_fmpy(fmu))
    yield f"{own} (CVode)", "3.0", "model exchange", exchanged(folder)
    for distribution, script, environment, versions in HOSTS:
        python, number = installed(environment, distribution)
        for (fmi, kind), fmu in fmus.items():
            if fmi in versions:
                path = Path(__file__).parent / "hosts" / f"with_{script}.py"
                result = "not run" if python is None else in_host(python, path, fmu) + LATE.get(script, "")
                yield f"{distribution} {number}", f"{fmi}.0", kind, result
    for name, fmi, kind, words in TESTED:
        yield name, fmi, kind, by_tests(words)
    yield from NOT_HERE


def tuned_in_fmpy(fmu: Path) -> str:
    """The parameter changed under way by a table of inputs of FMPy."""
    rows = np.array(
        [(i * STEP, VALUE, TUNED[1] if i >= N // 2 else FRICTION) for i in range(N + 1)],
        dtype=[(name, float) for name in ("time", INPUT, TUNED[0])],
    )
    run = fmpy.simulate_fmu(str(fmu), stop_time=N * STEP, output_interval=STEP, input=rows, output=[OUTPUT])
    got, wanted = run[OUTPUT][1:], np.array(expected(tuned=True))
    return judged(float(np.abs(got - wanted).max() / np.abs(wanted).max()))


def tuned_hosts(fmus: Mapping[tuple[str, str], Path]) -> Iterator[tuple[str, ...]]:
    """Rows of the table of the parameter."""
    for (fmi, kind), fmu in fmus.items():
        yield f"FMPy {version('fmpy')}", f"{fmi}.0", kind, tuned_in_fmpy(fmu)
    for distribution, script, environment, versions in HOSTS:
        if script not in TUNING:
            continue
        python, number = installed(environment, distribution)
        for (fmi, kind), fmu in fmus.items():
            if fmi in versions:
                path = Path(__file__).parent / "hosts" / f"with_{script}.py"
                result = "not run" if python is None else in_host(python, path, fmu, tuned=True)
                yield f"{distribution} {number}", f"{fmi}.0", kind, result


def models(folder: Path, files: Sequence[Path]) -> Iterator[tuple[str, ...]]:
    """Rows of the table of models; the FMUs stay in the folder."""
    for file in files:
        name = f"{file.parent.name}/{file.stem}"
        inputs = with_inputs(latin_fmu.load_scene(file), ["all"])
        carried = {kind: reference_of(inputs.scene, inputs.laws).files for kind in KINDS}
        results = []
        for fmi in VERSIONS:
            for kind in KINDS:
                target = folder / f"{name.replace('/', '_')} {fmi} {kind}.fmu"
                try:
                    stalls = kind == "compiled" and name in STALLS
                    fmu = build_fmu(inputs.scene, target, fmi, carried[kind], python=kind != "compiled")
                    off = in_fmpy(fmu, stalls)
                    limit = STALLS[name] if stalls else CLOSE
                    results.append(f"passed ({off:.1g})" if off <= limit else judged(off))
                except Exception as error:  # the page says what went wrong with one, and goes on
                    results.append(f"failed: {str(error).splitlines()[0][:120]}")
        yield name, *results


def by_vdmcheck(fmus: Sequence[Path]) -> tuple[str, str, str]:
    """The row of vdmcheck, whose programs ``install_hosts.sh`` writes."""
    name, folder = "vdmcheck 1.1.3 (rules of FMI 2.0 and 3.0)", hosts_folder()
    if folder is None or not (folder / "vdmcheck").is_dir():
        return name, str(len(fmus)), "not run"
    wrong = []
    for fmu in fmus:
        fmi = fmpy.read_model_description(str(fmu), validate=False).fmiVersion[0]
        command = ["sh", str(folder / "vdmcheck" / f"vdmcheck{fmi}.sh"), str(fmu)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        if done.stdout.split() != ["true"]:
            wrong.append(f"{fmu.stem}: {' '.join((done.stdout or done.stderr).split())[:120]}")
    return name, str(len(fmus)), f"failed: {wrong[0]}" if wrong else "passed"


def checkers(fmus: Sequence[Path]) -> Iterator[tuple[str, ...]]:
    """Rows of the table of checkers."""
    found = [problem for fmu in fmus for problem in validate(fmu)]
    result = "passed" if not found else f"failed: {found[0][:120]}"
    yield f"FMPy {version('fmpy')} `validate_fmu`, XML schemas of FMI 2.0.5 and 3.0.2", str(len(fmus)), result
    yield by_vdmcheck([fmu for fmu in fmus if fmu.stem.startswith(("blocks", "reduced"))])
    python, number = installed("common", "fmu-manipulation-toolbox")
    name = f"fmu-manipulation-toolbox {number} `fmutool -check`"
    if python is None:
        yield name, str(len(fmus)), "not run"
        return
    wrong = []
    for fmu in fmus:
        command = [str(python.with_name("fmutool")), "-input", str(fmu), "-check"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        said = done.stdout + done.stderr
        if "ERROR" in said or "No semantic error" not in said:
            wrong.append(fmu.stem)
    yield name, str(len(fmus)), "passed" if not wrong else f"failed: {', '.join(wrong)}"


def page(folder: Path, files: Sequence[Path]) -> str:
    """Run all and write the page."""
    fmus = {
        (fmi, kind): build_fmu(blocks(), folder / f"blocks {fmi} {kind}.fmu", fmi, python=kind != "compiled")
        for fmi in VERSIONS
        for kind in KINDS
    }
    facts = {"version": latin_fmu.__version__, "system": f"{platform.system()}, {platform.machine()}"}
    text = HEAD.format(**facts, python=platform.python_version(), close=CLOSE, exchange=EXCHANGE)
    text += table(("importer and version", "FMI", "kind", "result"), list(importers(folder, fmus)))
    text += PARAMETERS.format(name=TUNED[0], value=TUNED[1], n=N // 2)
    text += table(("importer and version", "FMI", "kind", "result"), list(tuned_hosts(fmus)))
    columns_ = [f"FMI {fmi}.0, {kind}" for fmi in VERSIONS for kind in KINDS]
    text += MODELS.format(version=version("fmpy"), stalls=max(STALLS.values())) + table(
        ("model", *columns_), list(models(folder, files))
    )
    made = sorted(folder.glob("*.fmu"))
    return text + CHECKERS + table(("checker", "FMUs", "result"), list(checkers(made)))


def main() -> None:
    """Write the page, or print that of some models."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("model", nargs="*", type=Path, help="scenes; printed, not written (default: shipped models)")
    given = parser.parse_args().model
    shipped = [path for path in sorted((ROOT / "models").glob("*/*.toml")) if path.parent.name not in MINUTES]
    with tempfile.TemporaryDirectory() as folder:
        text = page(Path(folder), given or shipped)
    if given:
        sys.stdout.write(text)
    else:
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
