"""What the FMI 2 and FMI 3 adapters share: opening the parts that travel in the FMU, and the log.

Runs inside the host. At module level and at instantiation it does next to nothing: the exporter runs the module
twice per instance, and hosts instantiate to look.
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
NEEDED = ("numpy", "scipy", "numba", "meshio", "pydantic", "xarray", "netCDF4", "threadpoolctl")


class Adapter:
    """Mixed into the class of the exporter, before it.

    ``package`` is the root package inside the FMU. ``held`` are spare references to the namespace of the entry
    script: the library of pythonfmu 0.7.0 gives one back too many per instance, and the second instance would
    find freed memory.
    """

    package = ""
    needed: ClassVar[tuple[str, ...]] = NEEDED
    held: ClassVar[list[dict[str, Any]]] = []

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.held.append(vars(sys.modules[type(self).__module__]))
        pin_library(self.resources)  # type: ignore[attr-defined]
        relocate(self.package, self.resources)  # type: ignore[attr-defined]
        missing = [name for name in self.needed if name not in sys.modules and importlib.util.find_spec(name) is None]
        if missing:
            raise ImportError(
                f"this FMU needs the Python packages {', '.join(missing)}, which {sys.executable} does not have: "
                "see documentation/externalDependencies.txt"
            )
        self.participant = self._open()

    def _open(self) -> Any:
        resources = self.resources  # type: ignore[attr-defined]
        core = f"{self.package}.latin_fmu"
        table = importlib.import_module(f"{core}.cosim.variable")
        participant = importlib.import_module(f"{core}.cosim.fmi_instance")

        def scene() -> Any:
            reader = importlib.import_module(f"{core}.scene.reader")
            return reader.load_scene(os.path.join(resources, "scene", "scene.toml"))

        with open(os.path.join(resources, "variables.json"), encoding="utf-8") as file:
            rows = table.table_from(file.read())
        return participant.Participant(rows, scene, self.tell)

    def tell(self, level: int, message: str) -> None:
        """Queue a message; the library of the exporter takes its text for a printf format."""
        text = message.replace("%", "%%")
        self.log(text, self.status(level), CATEGORIES[level])  # type: ignore[attr-defined]

    def status(self, level: int) -> Any:
        """The level as the exporter counts it."""
        return level

    # -- states: the same two functions in FMI 2 and FMI 3 ---------------------------------------------------------
    def _get_fmu_state(self) -> Any:
        return self.participant.save()

    def _set_fmu_state(self, state: Any) -> None:
        if state is None:
            self.tell(3, "a state that could not be saved cannot be restored")
        else:
            self.participant.load(state)

    @staticmethod
    def _fmu_state_to_bytes(state: Any) -> bytes:
        return b"" if state is None else state.blob

    @classmethod
    def _fmu_state_from_bytes(cls, block: bytes) -> Any:
        module = importlib.import_module(f"{cls.package}.latin_fmu.cosim.fmi_instance")
        return module.SavedState(bytes(block))


def pin_library(resources: str) -> None:
    """Keep the exporter's library in memory once the host unloads it, and let it end in good order (Linux).

    It starts a thread of its own, which may still run inside it when it is unloaded. Kept to the end of the process, it
    gives back its hold on the interpreter twice: first as a static object, then from its unload function, which writes
    into memory already freed ("corrupted double-linked list", after all is done). Called once before, while the
    interpreter ends, that function leaves nothing to give back.
    """
    if not hasattr(os, "RTLD_NODELETE"):
        return
    binaries = Path(resources).parent / "binaries"
    for library in (*binaries.glob("linux64/*.so"), *binaries.glob("x86_64-linux/*.so")):
        if str(library) in _pinned:
            continue
        with contextlib.suppress(OSError, AttributeError):  # a host that moved the binaries: nothing is lost
            pinned = ctypes.CDLL(str(library), mode=os.RTLD_NOW | os.RTLD_NODELETE)
            _pinned.add(str(library))
            atexit.register(pinned.finalizePythonInterpreter)


_pinned: set[str] = set()  # libraries, by path


def relocate(package: str, resources: str) -> None:
    """Let packages already loaded find their modules here, when the folder they came from is gone.

    A host that extracts the same FMU twice shares its modules and may delete the first folder. Names are made from
    contents, so that what is found here is the same.
    """
    for name, module in list(sys.modules.items()):
        if name != package and not name.startswith(f"{package}."):
            continue
        path = getattr(module, "__path__", None)
        if path is not None and not any(os.path.isdir(folder) for folder in path):
            path.insert(0, os.path.join(resources, *name.split(".")))
    importlib.invalidate_caches()


# -- What the adapters for co-simulation share: the life cycle, and setting numbers and strings.
class CoSimulationAdapter(Adapter):
    """Functions the exporter's library calls, handed on to the participant. None raises."""

    def exit_initialization_mode(self) -> None:
        """Build; a failure is logged, and every step refused."""
        self.participant.initialize()

    def do_step(self, current_time: float, step_size: float) -> bool:
        """False is a discard."""
        return bool(self.participant.step(current_time, step_size))

    def terminate(self) -> None:
        """Write results, where asked for."""
        self.participant.terminate()

    def get_string(self, references: list[int]) -> list[str]:
        """Strings."""
        return as_long(self.participant.get_texts(references), len(references), "")

    def set_string(self, references: list[int], values: list[str]) -> None:
        """Strings."""
        self.participant.set_texts(references, values)

    def _numbers(self, references: list[int]) -> list[Any]:
        return as_long(self.participant.get(references), self.participant.size(references), 0.0)

    def _set_numbers(self, references: list[int], values: list[Any]) -> None:
        self.participant.set(references, values)


def as_long(found: Any, size: int, fill: Any) -> list[Any]:
    """As many values as the library reads: all found, or ``fill`` where reading failed."""
    values = list(found)
    return values if len(values) == size else [fill] * size


# -- FMI 2.0 adapter: the functions the exporter's library calls, handed on to the participant.
class Fmi2Adapter(CoSimulationAdapter):
    """Mixed into ``Fmi2Slave``. Every function takes and returns lists; none raises."""

    def setup_experiment(self, start_time: float, _stop_time: float | None, tolerance: float | None) -> None:
        """Start time and tolerance; the stop time is not needed."""
        self.participant.setup(start_time, tolerance)

    def get_real(self, references: list[int]) -> list[float]:
        """Reals."""
        return self._numbers(references)

    def get_integer(self, references: list[int]) -> list[int]:
        """Integers."""
        return [int(value) for value in self._numbers(references)]

    def get_boolean(self, references: list[int]) -> list[bool]:
        """Booleans."""
        return [bool(value) for value in self._numbers(references)]

    def set_real(self, references: list[int], values: list[float]) -> None:
        """Reals."""
        self._set_numbers(references, values)

    def set_integer(self, references: list[int], values: list[int]) -> None:
        """Integers."""
        self._set_numbers(references, values)

    def set_boolean(self, references: list[int], values: list[bool]) -> None:
        """Booleans."""
        self._set_numbers(references, values)


# -- FMI 3.0 adapter: the functions the exporter's library calls, handed on to the participant.
class Fmi3Adapter(CoSimulationAdapter):
    """Mixed into ``Fmi3Slave``. The exporter drops start time, stop time and tolerance."""

    def get_float64(self, references: list[int]) -> list[float]:
        """Reals and arrays of reals."""
        return self._numbers(references)

    def get_int32(self, references: list[int]) -> list[int]:
        """Integers."""
        return [int(value) for value in self._numbers(references)]

    def get_uint64(self, references: list[int]) -> list[Any]:
        """Sizes."""
        return [ctypes.c_uint64(int(value)) for value in self._numbers(references)]

    def set_float64(self, references: list[int], values: list[float]) -> None:
        """Reals and arrays of reals."""
        self._set_numbers(references, values)

    def set_int32(self, references: list[int], values: list[int]) -> None:
        """Integers."""
        self._set_numbers(references, values)

    def set_uint64(self, references: list[int], values: list[int]) -> None:
        """Sizes."""
        self._set_numbers(references, values)


# -- FMI 3.0 Model Exchange adapter: the functions the exporter's library calls, handed on to the reduced model. Runs
# inside the host. None of the functions may raise: the exporter frees the instance then, and the next call of the
# host would meet freed memory.
@dataclass(frozen=True)
class DiscreteStates:
    """What the library reads after an event, under the names it looks for (the exporter's own class has others)."""

    terminateSimulation: bool  # noqa: N815
    nextEventTimeDefined: bool  # noqa: N815
    nextEventTime: float  # noqa: N815
    discreteStatesNeedUpdate: bool = False  # noqa: N815
    valuesOfContinuousStatesChanged: bool = True  # noqa: N815  they have not, but some hosts restart only then
    nominalContinuousStatesChanged: bool = False  # noqa: N815


class ModelExchangeAdapter(Adapter):
    """Mixed into ``Fmi3SlaveBase``. The exporter drops start time, stop time and tolerance."""

    needed: ClassVar[tuple[str, ...]] = ("numpy", "pydantic")

    def _open(self) -> Any:
        resources = self.resources  # type: ignore[attr-defined]
        home = f"{self.package}.latin_fmu.model_exchange"
        instance, system = (importlib.import_module(f"{home}.{name}") for name in ("fmi_instance", "system"))
        with open(os.path.join(resources, "reduced.bin"), "rb") as file:
            reduced = system.ReducedSystem.from_bytes(file.read())
        with open(os.path.join(resources, "variables.json"), encoding="utf-8") as file:
            found = system.Names.from_text(file.read())
        return instance.ExchangeModel(reduced, found, self.tell)

    def exit_initialization_mode(self) -> None:
        """Parameters are fixed."""
        self.participant.initialize()

    def terminate(self) -> None:
        """Nothing is left to do."""

    # -- variables ------------------------------------------------------------------------------------------------
    def get_float64(self, references: list[int]) -> list[float]:
        """Numbers."""
        found: list[float] = self.participant.get(references)
        return found

    def set_float64(self, references: list[int], values: list[float]) -> None:
        """Numbers."""
        self.participant.set(references, values)

    # -- continuous time ------------------------------------------------------------------------------------------
    def set_time(self, time: float) -> None:
        """Time, s."""
        self.participant.set_time(time)

    def get_number_of_continuous_states(self) -> int:
        """How many states there are."""
        return int(self.participant.n_state)

    def set_continuous_states(self, values: list[float]) -> None:
        """States."""
        self.participant.set_states(values)

    def get_continuous_states(self) -> list[float]:
        """States."""
        found: list[float] = self.participant.y.tolist()
        return found

    def get_continuous_state_derivatives(self) -> list[float]:
        """Their derivatives."""
        found: list[float] = self.participant.derivatives()
        return found

    def get_nominals_of_continuous_states(self, _size: int) -> list[float]:
        """Their expected sizes."""
        found: list[float] = self.participant.nominals()
        return found

    # -- events ---------------------------------------------------------------------------------------------------
    def get_number_of_event_indicators(self) -> int:
        """How many indicators there are."""
        return int(self.participant.n_indicator)

    def get_event_indicators(self) -> list[float]:
        """Indicators."""
        found: list[float] = self.participant.indicators()
        return found

    def update_discrete_states(self) -> DiscreteStates:
        """Contact states and time laws after an event."""
        update = self.participant.update()
        knot = update.next_event
        return DiscreteStates(update.terminate, knot is not None, knot or 0.0)

    # -- states of the FMU ------------------------------------------------------------------------------------------
    @staticmethod
    def _fmu_state_to_bytes(state: Any) -> bytes:
        return state or b""

    @classmethod
    def _fmu_state_from_bytes(cls, block: bytes) -> Any:
        return bytes(block)
