"""FMUs run with fmpy: co-simulation step by step, Model Exchange with CVode, and as a peer of a master."""

from __future__ import annotations

import shutil
import zipfile
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from latin_fmu.cosim.settings import StepReport, refused
from latin_fmu.cosim.variable import input_of, input_variable
from latin_fmu.errors import InputError, Problem

Columns = Mapping[str, Sequence[float]]
_MOST_BYTES, _MOST_XML = 4_000_000_000, 200_000_000  # unpacked
_WARNING = 1  # status of the FMI, 2 and 3
_MOST_TIMES, _SMALL = 200, 100_000_000  # what is larger than this may be so many times as large as it is packed


def described(path: str | Path) -> Any:
    """Model description of an FMU whose archive can be unpacked safely.

    Raises InputError where there is no such file, it is no FMU, or its archive has members that are missing, there
    twice, too large, damaged, or named as if they lay outside of the folder they are unpacked to.
    """
    if not Path(path).is_file():
        raise InputError([Problem(str(path), "no such file")], "the FMU cannot be opened")
    try:
        with zipfile.ZipFile(path) as archive:
            problem = _archive_problem(archive.infolist())
            if not problem:
                # after the limits of size: this reads every member
                if (damaged := archive.testzip()) is not None:
                    raise zipfile.BadZipFile(f"the member {damaged[:80]!r} is damaged")
                return fmpy.read_model_description(str(path))
    except Exception as error:  # zipfile and fmpy raise many kinds and bare exceptions
        problem = f"not a valid FMU: {' '.join(str(error).split())[:300] or type(error).__name__}"
    raise InputError([Problem(str(path), problem)], "the FMU cannot be opened")


def _archive_problem(members: Sequence[zipfile.ZipInfo]) -> str:
    """What is wrong with the members of an archive before any is unpacked, empty where nothing is."""
    names = [member.filename for member in members]
    if "modelDescription.xml" not in names:
        return "not a valid FMU: it has no modelDescription.xml"
    # the last one would be unpacked over the first
    if len(set(names)) < len(names):
        return "not a valid FMU: several members have the same name"
    for name in names:
        parts = name.replace("\\", "/").split("/")
        if (
            ".." in parts
            or not name
            or name.startswith("/")
            or "\\" in name
            or ":" in name
            # names of files have 255 bytes at most
            or max(map(len, parts)) > 200
        ):
            return f"not a valid FMU: a member is named {name[:80]!r}, outside of the folder it is unpacked to"
    sizes = {member.filename: member.file_size for member in members}
    if sum(sizes.values()) > _MOST_BYTES or sizes["modelDescription.xml"] > _MOST_XML:
        return f"not a valid FMU: unpacked it has {sum(sizes.values())} bytes"
    for member in members:
        # small members may be packed to any share
        if member.file_size > max(_SMALL, _MOST_TIMES * member.compress_size):
            packed = f"{member.file_size} bytes from {member.compress_size}"
            return f"not a valid FMU: the member {member.filename[:80]!r} would unpack to {packed}"
    return ""


def _experiment(description: Any) -> tuple[float, float, float]:
    """End and step of the default experiment, s, and its tolerance; numbers that suit many models where it has none."""
    experiment = description.defaultExperiment
    stop, step, tolerance = (
        float(getattr(experiment, name, None) or 0.0) for name in ("stopTime", "stepSize", "tolerance")
    )
    stop = stop or 1.0
    return stop, step or stop / 50, tolerance or 1e-6


class Drive:
    """One instance of an FMU.

    Parameters
    ----------
    path : the FMU. start : values of inputs and parameters before initialization. inputs : columns over ``time``.

    Attributes
    ----------
    outputs : names of the scalar outputs. complaint : last message of the FMU when a step was refused, else "".
    warnings : messages that the FMU has logged as warnings.
    """

    def __init__(self, path: str | Path, start: Mapping[str, Any] | None = None, inputs: Columns | None = None) -> None:
        self.warnings: list[str] = []
        self._folder = ""
        self.description = described(path)
        if self.description.coSimulation is None:
            raise InputError([Problem(str(path), "not an FMU for co-simulation")], "the FMU cannot be opened")
        self._by_name = {v.name: v for v in self.description.modelVariables}
        self._references = {v.name: int(v.valueReference) for v in self.description.modelVariables}
        self._inputs = dict(inputs or {})
        self._time = list(self._inputs.pop("time", []))
        self._check([*(start or {}), *self._inputs])
        self.outputs = [v.name for v in self.description.modelVariables if v.causality == "output" and not v.dimensions]
        self.stop_time, self.step_size, _ = _experiment(self.description)
        self.complaint, self._message = "", ""
        self.three = self.description.fmiVersion.startswith("3")
        try:
            self._folder = str(fmpy.extract(str(path)))
            self._fmu = self._instance()
        except Exception as error:  # fmpy raises bare exceptions
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = ""
            raise InputError([Problem(str(path), self._message or str(error))], "the FMU cannot be opened") from None
        for name, value in (start or {}).items():
            self.set(name, value)

    def _check(self, names: Sequence[str]) -> None:
        problems = [Problem(name, "no variable of this name") for name in names if name not in self._by_name]
        if problems:
            raise InputError(problems, "the FMU does not have these variables")

    def _instance(self) -> Any:
        kind: Callable[..., Any] = FMU3Slave if self.three else FMU2Slave
        fmu = kind(
            guid=self.description.guid,
            unzipDirectory=self._folder,
            instanceName=self.description.modelName,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )
        if self.three:
            fmu.instantiate(loggingOn=True, logMessage=lambda _e, status, _c, text: self._keep(status, text))
            return fmu
        from fmpy.fmi2 import defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

        functions = fmi2CallbackFunctions()
        functions.logger = fmi2CallbackLoggerTYPE(lambda _e, _i, status, _c, text: self._keep(status, text))
        for name in ("allocateMemory", "freeMemory"):
            setattr(functions, name, getattr(defaultCallbacks, name))
        self._functions = functions  # the library keeps a pointer to it
        fmu.instantiate(callbacks=functions, loggingOn=True)
        return fmu

    def _keep(self, status: int, text: bytes | str) -> None:
        # FMI 2: its texts are formats of printf
        self._message = (text.decode(errors="replace") if isinstance(text, bytes) else text).replace("%%", "%")
        if status == _WARNING:
            self.warnings.append(self._message)

    def set(self, name: str, value: Any) -> None:
        """Set a variable by name."""
        variable = self._by_name[name]
        reference = [variable.valueReference]
        kind = variable.type
        whole, text = kind in ("Integer", "Int32", "UInt64"), kind == "String"
        try:
            number = str(value) if text else float(value)
            if whole and number != int(number):
                raise ValueError
        except (ValueError, OverflowError):
            if whole:
                allowed = "an integer"
            else:
                allowed = f"a value of type {kind}"
            raise InputError([Problem(name, "not a number", str(value)[:80], allowed)]) from None
        getattr(self._fmu, f"set{kind}")(reference, [int(number) if whole else number])

    def read(self, names: Sequence[str]) -> list[float]:
        """Values of real variables, read at once."""
        return self.read_references([self._references[name] for name in names])

    def reference(self, name: str) -> int:
        """Value reference of a variable."""
        return self._references[name]

    def read_references(self, references: Sequence[int]) -> list[float]:
        """Values of real variables by value reference."""
        return list(self._fmu.getFloat64(references) if self.three else self._fmu.getReal(references))

    def _give(self, t: float, h: float) -> None:
        """Inputs at the start of a step; rates follow from values where no column gives them."""
        for name, column in self._inputs.items():
            value = self._at(column, t)
            self.set(name, value)
            source, what = input_of(name)
            rate = input_variable(source, "rate")
            if what == "value" and rate in self._by_name and rate not in self._inputs:
                # over the whole step: rows of the table within it are passed over
                self.set(rate, (self._at(column, t + h) - value) / h)

    def _at(self, column: Sequence[float], t: float) -> float:
        # right: at an instant that is there twice, a jump, its later value
        i = bisect_right(self._time, t)
        if i == 0 or i == len(self._time):
            return float(column[0 if i == 0 else -1])
        a, b = self._time[i - 1], self._time[i]
        return float(column[i - 1] + (column[i] - column[i - 1]) * (t - a) / (b - a))

    def initialize(self) -> None:
        """Initialize the instance at time 0."""
        if not self.three:
            self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()

    def advance(self, t: float, h: float) -> bool:
        """Make one step; False, with ``complaint``, where it is refused."""
        self._message = ""
        try:
            self._fmu.doStep(t, h)
        except Exception as error:  # fmpy raises its own for every status but OK
            self.complaint = self._message or str(error)
            return False
        return True

    def run(self, step: float, stop: float, over: Callable[[], bool] = lambda: False) -> Iterator[list[float]]:
        """Time and outputs after initialization and after every step; ends early where a step is refused, and where
        ``over`` says so before one."""
        if not (step > 0.0 and stop > 0.0):
            raise InputError([Problem("--step, --stop", "must be > 0", f"{step}, {stop}")])
        if self._inputs:
            self._give(0.0, step)
        try:
            self.initialize()
        except FMICallException as error:
            self.complaint = self._message or str(error)
            return
        yield [0.0, *self.read(self.outputs)]
        # at least one step; its size is adapted so that the last one ends at ``stop``
        n = max(1, round(stop / step))
        for i in range(n):
            if over():
                break
            t, end = stop * i / n, stop * (i + 1) / n  # no sum of steps: no round-off adds up
            self._give(t, end - t)
            if not self.advance(t, end - t):
                return
            yield [end, *self.read(self.outputs)]
        self.terminate()

    def terminate(self) -> None:
        """End the simulation; the FMU writes its results file where one is named."""
        self._fmu.terminate()

    def close(self) -> None:
        """Free the instance and remove what was extracted."""
        if self._folder:
            self._fmu.freeInstance()
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = ""


class Integration:
    """One run of a Model Exchange FMU with CVode, with the methods of ``Drive``.

    Parameters
    ----------
    path : the FMU. start : values of inputs and parameters. inputs : columns over ``time``, linear in between.

    Attributes
    ----------
    outputs : names of the outputs. complaint : why a run ended early, else "". warnings : none are kept.
    """

    def __init__(self, path: str | Path, start: Mapping[str, Any] | None = None, inputs: Columns | None = None) -> None:
        self._path, self._start, self._inputs = str(path), dict(start or {}), dict(inputs or {})
        description = described(self._path)
        names = {v.name for v in description.modelVariables}
        unknown = [n for n in (*self._start, *self._inputs) if n not in names and n != "time"]
        if unknown:
            raise InputError([Problem(n, "no variable of this name") for n in unknown], "the FMU cannot be integrated")
        self._rest = {v.name: float(v.start or 0.0) for v in description.modelVariables if v.causality == "input"}
        self.outputs = [v.name for v in description.modelVariables if v.causality == "output"]
        self.stop_time, self.step_size, self._tolerance = _experiment(description)
        self.complaint, self.warnings = "", list[str]()

    def run(self, step: float, stop: float, over: Callable[[], bool] = lambda: False) -> Iterator[list[float]]:
        """Time and outputs every ``step``; ends early where the integrator cannot go on, and where ``over`` says so."""
        if not (step > 0.0 and stop > 0.0):
            raise InputError([Problem("--step, --stop", "must be > 0", f"{step}, {stop}")])
        rows: list[list[float]] = []
        messages: list[str] = []

        def keep(_time: float, recorder: Any) -> bool:
            # what was recorded stays where the integrator fails later
            rows[:] = [list(row) for row in recorder.rows]
            return not over()

        try:
            result = fmpy.simulate_fmu(
                self._path,
                stop_time=stop,
                output_interval=step,
                relative_tolerance=self._tolerance,
                start_values=self._start,
                input=self._signals(),
                output=self.outputs,
                step_finished=keep,
                record_events=False,
                logger=lambda _e, _s, _c, text: messages.append(text.decode(errors="replace")),
            )
            rows = [list(row) for row in result]
        except Exception as error:  # fmpy and CVode raise bare exceptions
            self.complaint = (messages or [str(error)])[-1].replace("%%", "%")
        yield from rows

    def _signals(self) -> Any:
        """All inputs over time; fmpy needs every one: those without a column keep their start value."""
        if not self._inputs:
            return None
        columns = {"time": self._inputs["time"]}
        for name, start in self._rest.items():
            columns[name] = self._inputs.get(name, [self._start.get(name, start)] * len(columns["time"]))
        return np.array(list(zip(*columns.values(), strict=True)), dtype=[(name, float) for name in columns])

    def close(self) -> None:
        """Close the run; nothing stays open."""


def opened(
    path: str | Path, start: Mapping[str, Any] | None = None, inputs: Columns | None = None
) -> Drive | Integration:
    """An FMU for co-simulation to be stepped, or one for Model Exchange to be integrated.

    Raises InputError where it is neither, or lacks one of the variables.
    """
    description = described(path)
    # one that is both is stepped: it brings its own solver
    exchange = description.modelExchange is not None and description.coSimulation is None
    if exchange:
        return Integration(path, start, inputs)
    return Drive(path, start, inputs)


class FmuPeer(Drive):
    """An FMU for co-simulation as a peer of ``latin_fmu.cosim.WaveformMaster``, initialized at once.

    start : values of inputs and parameters before initialization.
    """

    def __init__(self, path: str | Path, start: Mapping[str, Any] | None = None) -> None:
        super().__init__(path, start)
        self.initialize()

    def set_load(self, name: str, value: float, rate: float = 0.0) -> None:
        """Amplitude of a load at the start of the next step and its rate, 1/s."""
        references = [self._references[input_variable(name, what)] for what in ("value", "rate")]
        (self._fmu.setFloat64 if self.three else self._fmu.setReal)(references, [value, rate])

    def value(self, name: str) -> float:
        """Value of a scalar output."""
        return self.read([name])[0]

    def step(self, t: float, h: float) -> StepReport:
        """Advance from t by h, s."""
        if self.advance(t, h):
            return StepReport(True)
        return refused(self.complaint)

    def snapshot(self) -> bytes:
        """Get the state as bytes."""
        state = self._call("getFMUState")
        try:
            return bytes(self._call("serializeFMUState", state))
        finally:
            self._call("freeFMUState", state)

    def restore(self, blob: bytes) -> None:
        """Set a state that ``snapshot`` returned."""
        state = self._call("deserializeFMUState", blob)
        self._call("setFMUState", state)
        self._call("freeFMUState", state)

    def _call(self, name: str, *arguments: Any) -> Any:
        """A function of the FMI by its name in FMI 3; FMI 2 spells some names otherwise."""
        if not self.three:
            name = name.replace("FMUState", "FMUstate").replace("deserialize", "deSerialize")
        return getattr(self._fmu, name)(*arguments)
