"""Adapters of an FMU (FMI 2 and 3): the functions that the exporter's library calls, as methods.

They run inside the host and hand every call to an FMI instance of the solver or of a reduced model. None of them may
raise: the library would free the instance, and the next call of the host would use freed memory. The library runs the
entry module twice per instance, and hosts instantiate an FMU only to look at it: loading and instantiation do little.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import importlib
import importlib.util
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

CATEGORIES = {0: "logAll", 1: "logStatusWarning", 2: "logStatusDiscard", 3: "logStatusError"}


class Adapter:
    """Base of the adapters, mixed into the class of the exporter before it.

    Attributes
    ----------
    package : root package inside the FMU. needed : packages the host must have. fmi_instance : takes the calls.
    held : spare references to the namespace of the entry script: the library of pythonfmu 0.7.0 releases one too many
        per instance, and a second instance would use freed memory.
    """

    package = ""
    needed: ClassVar[tuple[str, ...]] = ()
    held: ClassVar[list[dict[str, Any]]] = []

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.held.append(vars(sys.modules[type(self).__module__]))
        self.folder = str(self.resources)  # type: ignore[attr-defined]
        pin_library(self.folder)
        relocate(self.package, self.folder)
        missing = [name for name in self.needed if name not in sys.modules and importlib.util.find_spec(name) is None]
        if missing:
            raise ImportError(
                f"this FMU needs the Python packages {', '.join(missing)}, which {sys.executable} does not have: "
                "see documentation/externalDependencies.txt"
            )
        self.fmi_instance = self._open()

    def _open(self) -> Any:
        raise NotImplementedError

    def _module(self, name: str) -> Any:
        return importlib.import_module(f"{self.package}.latin_fmu.{name}")

    def _content(self, name: str) -> bytes:
        return Path(self.folder, name).read_bytes()

    def log_message(self, level: int, message: str) -> None:
        """Queue a message for the host; the exporter's library takes its text for a printf format."""
        self.log(message.replace("%", "%%"), level, CATEGORIES[level])  # type: ignore[attr-defined]

    def exit_initialization_mode(self) -> None:
        """End the initialization; a failure is logged."""
        self.fmi_instance.initialize()

    # -- variables ------------------------------------------------------------------------------------------------
    def real_values(self, references: list[int]) -> list[float]:
        """Values of real variables by value reference; elements of arrays in row-major order."""
        return list(self.fmi_instance.get(references))

    def set_values(self, references: list[int], values: list[Any]) -> None:
        """Set variables by value reference."""
        self.fmi_instance.set(references, values)

    # -- states: the exporters call these in FMI 2 and FMI 3 --------------------------------------------------------
    def _get_fmu_state(self) -> Any:
        return self.fmi_instance.get_state()

    def _set_fmu_state(self, state: Any) -> None:
        if state is None:
            self.log_message(3, "a state that could not be saved cannot be restored")
        else:
            self.fmi_instance.set_state(state)

    @staticmethod
    def _fmu_state_to_bytes(state: Any) -> bytes:
        return bytes(state or b"")

    @classmethod
    def _fmu_state_from_bytes(cls, block: bytes) -> Any:
        return bytes(block)


class CoSimulationAdapter(Adapter):
    """Adapter to a ``FmiInstance`` of ``latin_fmu.cosim``."""

    needed = ("numpy", "scipy", "numba", "meshio", "pydantic", "xarray", "netCDF4", "threadpoolctl")

    def _open(self) -> Any:
        table = self._module("cosim.variable").table_from(self._content("variables.json").decode())
        scene = os.path.join(self.folder, "scene", "scene.toml")
        instance = self._module("cosim.fmi_instance")
        return instance.FmiInstance(table, lambda: self._module("reader").load_scene(scene), self.log_message)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance by one communication step; False where the step is discarded."""
        return bool(self.fmi_instance.step(current_time, step_size))

    def terminate(self) -> None:
        """End the simulation; the results file is written where one is named."""
        self.fmi_instance.terminate()

    def whole_values(self, references: list[int]) -> list[int]:
        """Values of integer variables by value reference."""
        return [int(value) for value in self.fmi_instance.get(references)]

    def get_string(self, references: list[int]) -> list[str]:
        """Values of string variables by value reference."""
        return list(self.fmi_instance.get_texts(references))

    def set_string(self, references: list[int], values: list[str]) -> None:
        """Set string variables by value reference."""
        self.fmi_instance.set_texts(references, values)


class Fmi2Adapter(CoSimulationAdapter):
    """Functions of FMI 2.0, mixed into ``Fmi2Slave``."""

    get_real, get_integer = CoSimulationAdapter.real_values, CoSimulationAdapter.whole_values
    set_real = set_integer = set_boolean = CoSimulationAdapter.set_values

    def setup_experiment(self, start_time: float, _stop_time: float | None, tolerance: float | None) -> None:
        """Take start time and tolerance; the stop time is not needed."""
        self.fmi_instance.setup(start_time, tolerance)

    def get_boolean(self, references: list[int]) -> list[bool]:
        """Values of Boolean variables by value reference."""
        return [bool(value) for value in self.real_values(references)]


class Fmi3Adapter(CoSimulationAdapter):
    """Functions of FMI 3.0, mixed into ``Fmi3Slave``; it drops start time, stop time and tolerance."""

    get_float64, get_int32 = CoSimulationAdapter.real_values, CoSimulationAdapter.whole_values
    set_float64 = set_int32 = set_uint64 = CoSimulationAdapter.set_values

    def get_uint64(self, references: list[int]) -> list[Any]:
        """Values of array sizes by value reference."""
        return [ctypes.c_uint64(value) for value in self.whole_values(references)]


# -- Model Exchange -----------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class DiscreteStates:
    """Answer to an event under the names that the library reads (the exporter's own class has others)."""

    terminateSimulation: bool  # noqa: N815
    nextEventTimeDefined: bool  # noqa: N815
    nextEventTime: float  # noqa: N815
    discreteStatesNeedUpdate: bool = False  # noqa: N815
    valuesOfContinuousStatesChanged: bool = True  # noqa: N815  unchanged, but some hosts restart only if True
    nominalContinuousStatesChanged: bool = False  # noqa: N815


class ModelExchangeAdapter(Adapter):
    """Functions of FMI 3.0 Model Exchange, mixed into ``Fmi3SlaveBase``; it drops start time and tolerance.

    ``fmi_instance`` is a ``ReducedModelInstance`` of ``latin_fmu.model_exchange``.
    """

    needed = ("numpy", "pydantic")
    get_float64, set_float64 = Adapter.real_values, Adapter.set_values

    def _open(self) -> Any:
        system = self._module("model_exchange.system")
        reduced = system.ReducedSystem.from_bytes(self._content("reduced.bin"))
        names = system.Names.from_text(self._content("variables.json").decode())
        return self._module("model_exchange.fmi_instance").ReducedModelInstance(reduced, names, self.log_message)

    def terminate(self) -> None:
        """End the simulation; no file is written."""

    def set_time(self, time: float) -> None:
        """Set the time of the next evaluations, s."""
        self.fmi_instance.set_time(time)

    def get_number_of_continuous_states(self) -> int:
        """Number of continuous states."""
        return int(self.fmi_instance.n_state)

    def set_continuous_states(self, values: list[float]) -> None:
        """Set all continuous states."""
        self.fmi_instance.set_states(values)

    def get_continuous_states(self) -> list[float]:
        """Values of the continuous states."""
        return list(self.fmi_instance.y.tolist())

    def get_continuous_state_derivatives(self) -> list[float]:
        """Time derivatives of the continuous states."""
        return list(self.fmi_instance.derivatives())

    def get_nominals_of_continuous_states(self, _size: int) -> list[float]:
        """Nominal values of the continuous states."""
        return list(self.fmi_instance.nominals())

    def get_number_of_event_indicators(self) -> int:
        """Number of event indicators."""
        return int(self.fmi_instance.n_indicator)

    def get_event_indicators(self) -> list[float]:
        """Values of the event indicators."""
        return list(self.fmi_instance.indicators())

    def update_discrete_states(self) -> DiscreteStates:
        """Update contact states and time laws at an event."""
        update = self.fmi_instance.update()
        next_event = update.next_event
        return DiscreteStates(update.terminate, next_event is not None, next_event or 0.0)


# -- the process of the host --------------------------------------------------------------------------------------
def pin_library(resources: str) -> None:
    """Keep the exporter's library in memory until the process ends, and finalize it before (Linux).

    Its own thread may still run when the host unloads it. A library kept to the end of the process releases the
    interpreter twice: as a static object, and in its unload function, which then writes into freed memory ("corrupted
    double-linked list"). The unload function, called once while the interpreter ends, leaves nothing to release.
    """
    if not hasattr(os, "RTLD_NODELETE"):
        return
    binaries = Path(resources).parent / "binaries"
    for library in (*binaries.glob("linux64/*.so"), *binaries.glob("x86_64-linux/*.so")):
        if str(library) in _pinned:
            continue
        with contextlib.suppress(OSError, AttributeError):  # the host moved the binaries
            pinned = ctypes.CDLL(str(library), mode=os.RTLD_NOW | os.RTLD_NODELETE)
            _pinned.add(str(library))
            atexit.register(pinned.finalizePythonInterpreter)


_pinned: set[str] = set()  # libraries, by path


def relocate(package: str, resources: str) -> None:
    """Let loaded packages find their modules in this FMU where the folder they came from was deleted.

    A host that extracts the same FMU twice shares its modules and may delete the first folder. Package names are
    digests of their contents: equal names have equal modules.
    """
    for name, module in list(sys.modules.items()):
        if name != package and not name.startswith(f"{package}."):
            continue
        path = getattr(module, "__path__", None)
        if path is not None and not any(os.path.isdir(folder) for folder in path):
            path.insert(0, os.path.join(resources, *name.split(".")))
    importlib.invalidate_caches()
