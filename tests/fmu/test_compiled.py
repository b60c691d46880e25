"""The compiled FMU: no Python, the numbers of a session, failures as statuses, states bit for bit."""

from __future__ import annotations

import ctypes
import json
import random
import struct
import subprocess
import zipfile
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from fmpy.fmi1 import FMICallException

import fmu_build.build
from fmu_build.build import build_fmu, compiled_files
from fmu_build.checks import validate
from fmu_build.compiled import libraries
from latin_fmu import load_scene, open_results, solve
from latin_fmu.aot import linking
from latin_fmu.cli import main
from latin_fmu.cosim import c_runtime
from latin_fmu.cosim.input_table import with_laws
from latin_fmu.cosim.session import Session
from latin_fmu.cosim.settings import Settings
from latin_fmu.cosim.table_file import HEADER, checksum
from latin_fmu.errors import InputError
from latin_fmu.scene.laws import TableLaw
from latin_fmu.scene.schema import Scene
from latin_fmu.scene.settings import NoAcceleration
from tests.cosim.scenes import bar, blocks

from .host import COMPILED, Host, extracted

DT = 0.2e-6
LIMIT = 1e-9  # of the peak
PLAIN = NoAcceleration(type="none")
pytestmark = COMPILED


def scene(**changes: Any) -> Scene:
    """The two blocks, with energies."""
    return blocks(**changes)


@pytest.fixture
def fmus(compiled_fmus) -> dict[str, Path]:
    return compiled_fmus


def ran(
    program: Path, *arguments: object, lines: str = "", environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """A host in an empty environment, or this one."""
    command = [str(program), *map(str, arguments)]
    return subprocess.run(
        command, input=lines, capture_output=True, text=True, env=environment or {}, timeout=300, check=False
    )


# -- what it consists of ------------------------------------------------------------------------------------------
def test_the_library_needs_the_c_library_alone(fmus, tmp_path):
    extracted(fmus["2"], tmp_path)
    for content in (path.read_bytes() for path in (tmp_path / "binaries" / "linux64").iterdir()):
        linking.check(content, linking.C_LIBRARY | linking.FUNCTIONS)
        assert needed(content) <= {"libc.so.6", "libm.so.6"}
    inside = sorted(path.name for path in (tmp_path / "resources").rglob("*"))
    assert inside == ["image.bin", "results.nc", "variables.bin"]
    assert (tmp_path / "modelDescription.xml").read_text().count('needsExecutionTool="false"') == 1


def needed(content: bytes) -> set[str]:
    """Libraries that an ELF library names."""
    start, size, count = struct.unpack_from("<Q", content, 40)[0], *struct.unpack_from("<HH", content, 58)
    sections = [struct.unpack_from("<IIQQQQIIQQ", content, start + i * size) for i in range(count)]
    dynamic = next(section for section in sections if section[1] == 6)
    names = sections[dynamic[6]][4]
    entries = [struct.unpack_from("<QQ", content, dynamic[4] + at) for at in range(0, dynamic[5], 16)]
    return {content[names + at : content.index(b"\0", names + at)].decode() for tag, at in entries if tag == 1}


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_it_is_valid(fmus, fmi):
    assert validate(fmus[fmi]) == []


def test_the_same_scene_gives_the_same_bytes(fmus):
    files = compiled_files(scene(), "2")
    with zipfile.ZipFile(fmus["2"]) as archive:
        inside = {name: archive.read(name) for name in archive.namelist() if "ls-ref" not in name}
    assert inside == files


def test_the_archive_of_the_crushing_is_small(tmp_path):
    crushing = load_scene(Path(__file__).parents[2] / "models" / "two_specimen_crushing" / "scene.toml")
    assert build_fmu(crushing, tmp_path / "crushing.fmu", "3").stat().st_size < 5_000_000


def test_a_library_without_these_functions_is_not_used(monkeypatch):
    monkeypatch.setattr(c_runtime, "digest", lambda: "of other C files")
    with pytest.raises(InputError, match="the library of compiled kernels is missing here; install a wheel"):
        libraries()
    for portable in (False, True):
        with pytest.raises(InputError) as caught:
            libraries(portable)
        named = str(caught.value).partition("(of ")[2].partition(" those")[0].split(", ")
        assert {name.endswith("-portable") for name in named} == {portable}


@pytest.mark.parametrize(
    ("solver", "limit"),
    [({}, 1e-3), ({"acceleration": PLAIN, "max_iterations": 2000}, LIMIT)],
    ids=["relaxed", "plain"],
)
def test_a_time_step_that_stalls_is_made_by_relaxation(tmp_path, solver, limit):
    """Without acceleration nothing stalls; with it three time steps do, and are made anew, to the tolerance."""
    given = load_scene(Path(__file__).parents[2] / "models" / "gripped_bar" / "scene.toml")
    given = given.model_copy(update={"solver": given.solver.model_copy(update=solver)})
    with closing(Host(build_fmu(given, tmp_path / "bar.fmu", "2"), tmp_path / "fmu")) as host:
        host.start()
        assert all(host.step(0.1 * i, 0.1) for i in range(50)), host.messages
        sensor, names = solve(given).sensors["end"], [f"sensor.end.displacement[{i}]" for i in (1, 2, 3)]
        assert host.read(names) == pytest.approx(sensor.displacement[-1], abs=limit * np.abs(sensor.displacement).max())


def test_each_platform_has_its_folder(monkeypatch):
    """FMI 2 has none for AArch64, and an FMU without a library is refused."""
    here = ("linux-x86_64", "windows-x86_64", "linux-aarch64", "darwin-aarch64")
    monkeypatch.setattr(fmu_build.build, "libraries", lambda _: dict.fromkeys(here, b"code"))
    folders = {
        fmi: {name for name in compiled_files(scene(), fmi) if name.startswith("binaries/")} for fmi in ("2", "3")
    }
    assert folders["2"] == {"binaries/linux64/blocks.so", "binaries/win64/blocks.dll"}
    assert folders["3"] == {
        "binaries/x86_64-linux/blocks.so",
        "binaries/x86_64-windows/blocks.dll",
        "binaries/aarch64-linux/blocks.so",
        "binaries/aarch64-darwin/blocks.dylib",
    }
    monkeypatch.setattr(fmu_build.build, "libraries", lambda _: {"linux-aarch64": b"code"})
    with pytest.raises(InputError, match="no platform for the libraries that are here"):
        compiled_files(scene(), "2")


def test_the_command(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(scene().text())
    assert main(["fmu", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "a.fmu")]) == 0
    assert "valid" in capsys.readouterr().out
    assert main(["fmu", str(tmp_path / "scene.toml"), "--portable", "--model-exchange"]) != 0
    reduced = ["fmu", str(tmp_path / "scene.toml"), "--modes", "6", "-o", str(tmp_path / "b.fmu")]
    assert main(reduced) == 0
    assert "crush.peak_force" in capsys.readouterr().out
    with zipfile.ZipFile(tmp_path / "b.fmu") as archive:
        assert "crush.peak_force" in archive.read("documentation/index.html").decode()
    assert main(["explain", str(tmp_path / "scene.toml"), "--json", "--fmu", "6"]) == 0
    predicted = json.loads(capsys.readouterr().out)["compiled_fmu_bytes"]
    with zipfile.ZipFile(tmp_path / "b.fmu") as archive:  # the reference run is made with the FMU alone
        reference = sum(member.compress_size for member in archive.infolist() if "ls-ref" in member.filename)
    assert predicted + reference == pytest.approx((tmp_path / "b.fmu").stat().st_size, rel=0.02)
    assert main(["explain", str(tmp_path / "scene.toml"), "--fmu", "-3"]) != 0
    assert "1 or more" in capsys.readouterr().err
    assert main([*reduced[:3], "0", *reduced[4:]]) != 0
    assert "1 or more" in capsys.readouterr().err


# -- a host in C ------------------------------------------------------------------------------------------------------
def test_a_host_in_c_gets_the_forces_of_the_run(fmus, programs, tmp_path):
    """In an empty environment; with every fourth step taken back: the same bits."""
    files, references = extracted(fmus["2"], tmp_path / "a b")
    inputs = f"{references['load.press.value']},{references['load.press.rate']}"
    names = [f"interface.crush.force[{i}]" for i in (1, 2, 3)]
    outputs = ",".join(str(references[name]) for name in names)
    given = scene()
    values = [0.25 + 0.1 * i for i in range(given.time.n_step + 1)]
    rates = [*(np.diff(values) / DT), 0.0]
    rows = [f"{value!r} {float(rate)!r}" for value, rate in zip(values, rates, strict=True)]
    printed = []
    for back in ("", "back "):
        steps = [f"{back if i % 4 == 3 else ''}{DT!r} {row}" for i, row in enumerate(rows[:-1])]
        done = ran(programs["steps"], *files, inputs, outputs, lines="\n".join([rows[0], *steps]))
        assert done.returncode == 0, done.stderr
        printed.append(done.stdout)
    assert printed[0] == printed[1]
    force = np.array([[float.fromhex(word) for word in line.split()] for line in printed[0].splitlines()])
    law = TableLaw(type="table", times=[0.0, given.time.end], values=[values[0], values[-1]])
    whole = solve(with_laws(given, {"press": law})).interfaces["crush"].force()
    assert np.abs(force - whole).max() <= LIMIT * np.abs(whole).max()


@pytest.mark.parametrize("length", [0.06, 0.37, 2.6])
def test_a_host_in_c_may_cut_time_steps(fmus, programs, tmp_path, length):
    """To the end, with a short last step; every third step taken back: the same bits."""
    files, references = extracted(fmus["2"], tmp_path)
    inputs = f"{references['load.press.value']},{references['load.press.rate']}"
    outputs = ",".join(str(references[name]) for name in ("interface.crush.normalForce", "innerTime"))
    times = np.append(np.arange(0.0, 30.0, length), 30.0) * DT
    printed = []
    for back in ("", "back "):
        steps = [
            f"{back if i % 3 == 2 else ''}{h!r} {0.1 * (i % 7)!r} 0.0" for i, h in enumerate(np.diff(times).tolist())
        ]
        done = ran(programs["steps"], *files, inputs, outputs, lines="\n".join(["0.25 0.0", *steps]))
        assert done.returncode == 0, done.stderr
        printed.append(done.stdout)
    assert printed[0] == printed[1]
    assert float.fromhex(printed[0].split()[-1]) == pytest.approx(30 * DT)


def test_functions_of_another_version_are_not_taken(fmus, programs, compiler, tmp_path):
    """A library loaded before, for all to see, has functions of the same names that end the process."""
    files, references = extracted(fmus["2"], tmp_path / "fmu")
    names = ("kernels_entries_call_0", "latin_fmu_fits", "latin_fmu_open", "latin_fmu_step")
    assert all(hasattr(ctypes.CDLL(files[0]), name) for name in names)
    source = tmp_path / "other.c"
    source.write_text("#include <stdlib.h>\n" + "".join(f"void {name}(void) {{ abort(); }}\n" for name in names))
    other = tmp_path / "other.so"
    subprocess.run([*compiler, "-shared", "-fPIC", str(source), "-o", str(other)], check=True)
    inputs = f"{references['load.press.value']},{references['load.press.rate']}"
    outputs = str(references["interface.crush.normalForce"])
    lines = "\n".join(["0.25 0.0", *(f"{DT!r} {0.25 + 0.1 * i!r} 0.0" for i in range(5))])
    alone, beside = (
        ran(programs["steps"], *files, inputs, outputs, lines=lines, environment=environment)
        for environment in ({}, {"LD_PRELOAD": str(other)})
    )
    assert beside.returncode == 0, beside.stderr
    assert beside.stdout == alone.stdout != ""


# -- numbers ------------------------------------------------------------------------------------------------------
def equal(host: Host, session: Session) -> None:
    """All outputs, each against the largest of its unit."""
    units = {v.name: v.unit for v in session.table if v.causality == "output" and v.name in host.variables}
    assert len(units) == 55
    largest = dict.fromkeys(units.values(), 0.0)
    for name, unit in units.items():
        largest[unit] = max(largest[unit], abs(session.value(name)))
    for name, number in zip(units, host.read(list(units)), strict=True):
        assert abs(number - session.value(name)) <= LIMIT * largest[units[name]], name


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_steps_of_any_whole_number_of_time_steps(fmi, tmp_path):
    """Loads with rates and without, by every rule of interpolation, over more time steps than one call makes."""
    long = scene(time={"end": 80 * DT, "instants": 80})
    fmu = build_fmu(long, tmp_path / "long.fmu", fmi)
    for rule in (0, 1, 2, 3):
        host, session = Host(fmu, tmp_path / str(rule)), Session(long, Settings(interpolation=rule))
        host.set(inputInterpolation=rule, load__press__value=0.3)
        session.set_load("press", 0.3, 0.0)
        host.start()
        session.initialize()
        equal(host, session)
        t = 0.0
        for i, n in enumerate([1, 3, 1, 70, 2, 2]):
            value, rate = 0.4 + 0.1 * i, 1e4 if i == 4 else 0.0
            session.set_load("press", value, rate)
            host.set(load__press__value=value, load__press__rate=rate)
            assert host.step(t, n * DT), host.messages
            assert session.step(t, n * DT)
            t += n * DT
        equal(host, session)
        host.close()


# -- refusals -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("fmi", ["2", "3"])
def test_what_cannot_be_is_refused_with_a_sentence(opened, fmi):
    host = opened(fmi)
    assert not host.step(0.0, DT)
    assert "DoStep is not allowed in the state Instantiated" in host.messages[-1][2]
    host.set(timeStep=DT)
    assert host.status(lambda: host.set(timeStep=2 * DT)) == 3
    assert "timeStep = 4e-07 was not set: it is fixed at 2e-07" in host.messages[-1][2]
    host.start(tolerance=1e-7)
    assert "the tolerance 1e-07 of the importer has no effect" in host.messages[-1][2]
    saved = host.save()
    again = "is not allowed in the state stepFailed" if fmi == "2" else "the same step was already discarded"
    for t, h, level, words in [
        (0.0, 1e7 * DT, 2, "at most 1e+06 are allowed: use shorter steps"),
        (0.0, 1e7 * DT, 3, again),
        (0.0, float("nan"), 3, "is not a finite number"),
        (0.0, -DT, 3, "greater than 0"),
        (DT, DT, 3, "the step starts at"),
    ]:
        assert not host.step(t, h)
        assert host.last == level
        assert words in host.messages[-1][2]
        if words == again:
            host.restore(saved)
    host.set(load__press__value=float("inf"))
    assert not host.step(0.0, DT)
    assert host.last == 2
    host.restore(saved)
    host.set(load__press__value=0.5)
    assert host.step(0.0, DT)
    number = host.variables["mode"].type
    assert host.status(getattr(host.fmu, f"get{number}"), [9999]) == 3
    assert "there is no variable with the value reference 9999" in host.messages[-1][2]


def test_damaged_and_foreign_files_are_refused(fmus, tmp_path):
    """The beginning of the results is read where results are asked for, before the simulation."""
    for name in ("image.bin", "results.nc", "variables.bin"):
        with zipfile.ZipFile(fmus["2"]) as archive:
            files = {member: archive.read(member) for member in archive.namelist()}
        content = bytearray(files[f"resources/{name}"])
        content[len(content) // 2] ^= 1
        broken = tmp_path / f"{name}.fmu"
        with zipfile.ZipFile(broken, "w") as archive:
            for member, data in {**files, f"resources/{name}": bytes(content)}.items():
                archive.writestr(member, data)
        if name == "results.nc":
            host = Host(broken, tmp_path / name)
            host.set(resultsFile=str(tmp_path / "never.nc"))
            host.prepare()
            assert host.status(host.fmu.exitInitializationMode) == 3
            assert f"{name} is damaged" in host.messages[-1][2]
            continue
        with pytest.raises(RuntimeError, match=rf"{name} is damaged"):
            Host(broken, tmp_path / name)


def test_windows_and_threads_are_left_to_the_program(tmp_path):
    """The FMU makes windows of one instant in the thread that calls."""
    host = Host(build_fmu(scene(solver={"window": 5, "threads": 2}), tmp_path / "a.fmu"), tmp_path / "a")
    session = Session(scene())
    host.start()
    session.initialize()
    assert host.step(0.0, 5 * DT)
    assert session.step(0.0, 5 * DT)
    equal(host, session)
    host.close()


# -- states -------------------------------------------------------------------------------------------------------
def test_damaged_states_are_refused(opened, fmi):
    """Random flips and cuts; then the right checksum with wrong sizes and with numbers that are not finite."""
    host = opened(fmi)
    host.start()
    assert host.step(0.0, 3 * DT)
    block, before = host.to_bytes(host.save()), host.read()
    generator = random.Random(17)
    damaged = [block[: generator.randrange(len(block))] for _ in range(20)] + [block + b"\0" * 8, b""]
    for _ in range(60):
        at = generator.randrange(len(block))
        damaged.append(block[:at] + bytes([block[at] ^ 1 << generator.randrange(8)]) + block[at + 1 :])
    words = len(block) // 8
    for at in [*range(3, 9), *range(12, 31), *generator.sample(range(60, words), 60)]:
        wrong = struct.pack("<d", float("nan")), struct.pack("<q", -1)  # as an integer beyond all sizes
        damaged += [resealed(block[: 8 * at] + bits + block[8 * at + 8 :]) for bits in wrong]
    damaged.append(resealed(block[:-8], length=words - 1))
    for copy in damaged:
        assert host.status(host.from_bytes, copy) == 3
        assert "the state cannot be used: " in host.messages[-1][2]
    assert np.array_equal(host.read(), before)
    host.restore(host.from_bytes(block))
    assert host.step(3 * DT, DT)


def resealed(block: bytes, length: int | None = None) -> bytes:
    """A state with the checksum of its content."""
    body = (struct.pack("<Q", length) if length else block[16:24]) + block[24:]
    return block[:8] + struct.pack("<Q", checksum(body)) + body


def test_a_state_of_another_fmu_is_refused(opened, tmp_path):
    host = opened("2")
    host.start()
    other = Host(build_fmu(bar(), tmp_path / "bar.fmu", "2"), tmp_path / "bar")
    other.start()
    with pytest.raises(FMICallException):
        other.from_bytes(host.to_bytes(host.save()))
    assert "it belongs to another FMU" in other.messages[-1][2]
    other.close()


def test_any_sequence_of_rollbacks_is_the_straight_run(opened, fmi):
    straight, other = opened(fmi), opened(fmi)
    generator, t = random.Random(4), 0.0
    for host in (straight, other):
        host.start()
    for i in range(12):
        state = other.save()
        other.set(load__press__value=3.0 * generator.random())
        other.step(t, generator.randint(1, 3) * DT * generator.choice([1.0, 1.5]))
        other.restore(other.from_bytes(other.to_bytes(state)) if i % 2 else state)
        other.set(load__press__value=1e300)
        assert not other.step(t, 3 * DT)
        assert other.last == 2
        if fmi == "2":
            other.restore(state)  # in FMI 3 nothing has changed
        n = generator.randint(1, 4)
        for host in (straight, other):
            host.set(load__press__value=0.2 * i)
            assert host.step(t, n * DT), host.messages
        t += n * DT
        assert np.array_equal(straight.read(), other.read())
    assert other.to_bytes(other.save()) == straight.to_bytes(straight.save())
    fresh = opened(fmi)  # not initialized
    fresh.restore(fresh.from_bytes(other.to_bytes(other.save())))
    assert other.step(t, 2 * DT)
    assert fresh.step(t, 2 * DT)
    assert np.array_equal(fresh.read(), other.read())
    other.fmu.reset()
    fresh.fmu.reset()
    other.start(1.0)
    fresh.start(1.0)
    assert fresh.step(1.0, 3 * DT), fresh.messages
    assert other.step(1.0, 3 * DT)
    assert fresh.step(1.0 + 3 * DT, DT), fresh.messages
    fresh.fmu.reset()
    other.fmu.reset()
    other.start()
    fresh.start()
    assert other.to_bytes(other.save()) == fresh.to_bytes(fresh.save())


def test_the_header_of_the_table_is_that_of_the_c_files():
    text = (c_runtime.HERE / "runtime.h").read_text()
    names = text.split("enum {")[1].split("}")[0].replace("\n", " ").split(",")
    assert [name.strip().removeprefix("T_").lower() for name in names] == [*HEADER, "header"]


# -- results --------------------------------------------------------------------------------------------------------
def same_results(path: Path, run: xr.DataTree) -> int:
    """Compare a file of a compiled FMU with the results of the run, each against the largest of its unit in its group;
    number of arrays over time."""
    count = 0
    with open_results(path) as tree:
        assert tree.attrs["scene_name"] == run.attrs["scene_name"]
        for group in tree.subtree:
            largest: dict[str, float] = {}
            for known in run[group.path].to_dataset().variables.values():
                if known.dtype.kind == "f":
                    unit = known.attrs.get("units", "")
                    largest[unit] = max(largest.get(unit, 0.0), float(np.abs(known.values).max()))
            for name, values in group.to_dataset(inherit=False).variables.items():
                expected = run[group.path][name]
                assert values.dims == expected.dims, (group.path, name)
                assert values.attrs.get("units") == expected.attrs.get("units"), (group.path, name)
                own, known = values.values, expected.values
                if "time" in values.dims:
                    count += 1
                if own.dtype.kind == "f":
                    unit = largest[values.attrs.get("units", "")]
                    assert np.abs(own - known).max() <= LIMIT * unit, (group.path, name)
                else:
                    assert (own == known).all(), (group.path, name)
    return count


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_the_results_are_those_of_the_run(fmi, tmp_path):
    """In steps of several time steps with a rollback between, and of prescribed mode; same names, units and numbers."""
    long = scene()
    fmu = build_fmu(long, tmp_path / "blocks.fmu", fmi)
    loaded = with_laws(long, {"press": TableLaw(times=(0.0, 1.0), values=(0.7, 0.7))})
    solved = solve(loaded)
    solved.save(tmp_path / "run.nc")
    n = round(long.time.end / DT)
    with open_results(tmp_path / "run.nc") as run:
        for mode in (0, 1):
            host, target = Host(fmu, tmp_path / str(mode)), tmp_path / f"results {mode} µ.nc"
            host.set(mode=mode, resultsFile=str(target), load__press__value=0.7, endTime=long.time.end)
            host.start()
            assert host.step(0.0, 3 * DT), host.messages
            state = host.save()
            host.set(load__press__value=0.7 if mode else 0.1)
            assert host.step(3 * DT, 4 * DT), host.messages
            host.restore(state)
            host.set(load__press__value=0.7)
            t = 3 * DT
            while t < long.time.end - 0.5 * DT:
                h = min(7 * DT, long.time.end - t)
                assert host.step(t, h), host.messages
                t += h
            host.fmu.terminate()
            assert same_results(target, run) == 22
            assert len(open_results(target)["energy/time"]) == n + 1
            assert not list(tmp_path.glob("*.part"))


def test_results_are_of_the_past_of_the_state_that_was_restored(fmus, tmp_path):
    """Another branch has overwritten what was recorded before the state: its rows are not mixed with those after it."""
    forces = {}
    for branch in (True, False):
        host, target = Host(fmus["3"], tmp_path / str(branch)), tmp_path / f"{branch}.nc"
        host.set(resultsFile=str(target), load__press__value=0.7)
        host.start()
        start = host.save()
        assert host.step(0.0, 10 * DT), host.messages
        saved = host.save()
        if branch:
            host.restore(start)
            host.set(load__press__value=0.1)
            assert host.step(0.0, 15 * DT), host.messages
            host.restore(saved)
            host.set(load__press__value=0.7)
        assert host.step(10 * DT, 5 * DT), host.messages
        host.fmu.terminate()
        with open_results(target) as tree:
            forces[branch] = dict(zip(tree["energy/time"].values, tree["interfaces/crush/force"].values, strict=True))
        assert bool([text for *_, text in host.messages if "begins at 2e-06 s" in text]) == branch
        host.close()
    assert len(forces[False]) == 16
    assert len(forces[True]) == 6
    assert all((forces[True][t] == forces[False][t]).all() for t in forces[True])


def test_results_begin_where_a_state_of_another_instance_was_restored(opened, tmp_path):
    """What lies before was not made by this instance; a folder that is not there is an error with a sentence."""
    first, second = opened("3"), opened("3")
    for host in (first, second):
        host.set(resultsFile=str(tmp_path / "late.nc"), load__press__value=0.5)
        host.start()
    assert first.step(0.0, 5 * DT)
    second.restore(second.from_bytes(first.to_bytes(first.save())))
    assert second.step(5 * DT, 2 * DT), second.messages
    second.fmu.terminate()
    with open_results(tmp_path / "late.nc") as tree:
        assert tree["energy/time"].values == pytest.approx(DT * np.arange(5, 8))
    assert "late.nc begins at 1e-06 s" in second.messages[-1][2]
    lost = opened("3")
    lost.set(resultsFile=str(tmp_path / "nowhere" / "lost.nc"))
    lost.prepare()
    assert lost.status(lost.fmu.exitInitializationMode) == 3
    assert "lost.nc cannot be written: give a path" in lost.messages[-1][2]
    folder = opened("3")
    folder.set(resultsFile=str(tmp_path))
    folder.prepare()
    assert folder.status(folder.fmu.exitInitializationMode) == 3
