"""What the FMI 2 and FMI 3 adapters share: opening the parts that travel in the FMU, and the log.

Runs inside the host. At module level and at instantiation it does next to nothing: the exporter runs the module
twice per instance, and hosts instantiate to look.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import importlib.util
import os
import sys
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
