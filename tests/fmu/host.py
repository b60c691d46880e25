"""A small host on top of fmpy: one instance, its messages, values by name."""

from __future__ import annotations

import os
import shutil
import zipfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave

from latin_fmu.compiled import library

COMPILED = pytest.mark.skipif(
    library.target() != "linux-x86_64" or library.loaded() is None, reason="no library of kernels here"
)
KINDS = ["python", pytest.param("compiled", marks=COMPILED)]
"""FMUs with Python and compiled ones."""


def hosts_folder() -> Path | None:
    """Where ``install_hosts.sh`` put other hosts; None where none is named."""
    folder = os.environ.get("LATIN_FMU_HOSTS")
    return Path(folder) if folder else None


_FOLDERS = TemporaryDirectory(prefix="extracted_fmus_")


@cache
def _extracted(fmu: Path, modified: int) -> tuple[Path, Any]:
    """Files of an FMU, and its description."""
    del modified
    folder = mkdtemp(dir=_FOLDERS.name)
    return Path(fmpy.extract(str(fmu), unzipdir=folder)), fmpy.read_model_description(str(fmu))


def extracted(fmu: Path, folder: Path) -> tuple[list[str], dict[str, int]]:
    """Unpack an FMU for a host in C: library, resources as a URI, GUID; value references."""
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    description = fmpy.read_model_description(str(fmu))
    model = folder / "binaries" / "linux64" / f"{description.coSimulation.modelIdentifier}.so"
    references = {v.name: v.valueReference for v in description.modelVariables}
    return [str(model), (folder / "resources").as_uri(), description.guid], references


class Host:
    """An instance of an FMU in a folder, which leads to one extraction for all instances, or has its own (``alone``);
    ``early``: steps may end before their end (FMI 3)."""

    def __init__(
        self, fmu: Path, folder: Path, name: str = "instance", early: bool = False, alone: bool = False
    ) -> None:
        self.early = early
        self.messages: list[tuple[int, str, str]] = []
        extracted, self.description = _extracted(fmu, fmu.stat().st_mtime_ns)
        if alone:
            shutil.copytree(extracted, folder)
        else:
            folder.symlink_to(extracted)
        self.folder = folder
        self.three = self.description.fmiVersion.startswith("3")
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.outputs = [v.name for v in self.description.modelVariables if v.causality == "output" and not v.dimensions]
        kind: Any = FMU3Slave if self.three else FMU2Slave
        self.fmu = kind(
            guid=self.description.guid,
            unzipDirectory=str(self.folder),
            instanceName=name,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )
        try:
            self._instantiate()
        except Exception as error:
            raise RuntimeError(f"{error}: {self.messages}") from error

    def _instantiate(self) -> None:
        if self.three:
            self.fmu.instantiate(loggingOn=True, logMessage=self._three_hears, earlyReturnAllowed=self.early)
        else:
            self._callbacks = fmi2CallbackFunctions()
            self._callbacks.logger = fmi2CallbackLoggerTYPE(self._two_hears)
            self._callbacks.allocateMemory = defaultCallbacks.allocateMemory
            self._callbacks.freeMemory = defaultCallbacks.freeMemory
            self.fmu.instantiate(callbacks=self._callbacks, loggingOn=True)

    def _three_hears(self, _environment, status, category, message) -> None:
        self.messages.append((status, (category or b"").decode(), message.decode()))

    def _two_hears(self, _environment, _instance, status, category, message) -> None:
        self.messages.append((status, (category or b"").decode(), message.decode()))

    def reference(self, name: str) -> int:
        return self.variables[name].valueReference

    def set(self, **values: Any) -> None:
        """Names with ``__`` for the dots."""
        for key, value in values.items():
            name = key.replace("__", ".")
            kind = self.variables[name].type
            getattr(self.fmu, f"set{kind}")([self.reference(name)], value if isinstance(value, list) else [value])

    def read(self, names: Sequence[str] | None = None) -> np.ndarray:
        names = self.outputs if names is None else names
        references = [self.reference(n) for n in names]
        return np.array(self.fmu.getFloat64(references) if self.three else self.fmu.getReal(references))

    def array(self, name: str, size: int) -> np.ndarray:
        return np.array(self.fmu.getFloat64([self.reference(name)], nValues=size))

    def prepare(self, start_time: float = 0.0, tolerance: float | None = None) -> None:
        """Enter initialization mode."""
        if self.three:
            self.fmu.enterInitializationMode(startTime=start_time, tolerance=tolerance)
        else:
            self.fmu.setupExperiment(startTime=start_time, tolerance=tolerance)
            self.fmu.enterInitializationMode()

    def start(self, start_time: float = 0.0, tolerance: float | None = None) -> None:
        self.prepare(start_time, tolerance)
        self.fmu.exitInitializationMode()

    def status(self, function: Callable[..., Any], *arguments: Any) -> int:
        """Status of a call: 0 OK, 1 warning, 2 discard, 3 error."""
        try:
            function(*arguments)
        except FMICallException as error:
            return int(error.status)
        return 0

    def step(self, t: float, h: float) -> bool:
        """Whether the step was made; its status is in ``last``."""
        self.last = self.status(self.fmu.doStep, t, h)
        return self.last == 0

    def save(self) -> Any:
        return self.fmu.getFMUState() if self.three else self.fmu.getFMUstate()

    def restore(self, state: Any) -> None:
        (self.fmu.setFMUState if self.three else self.fmu.setFMUstate)(state)

    def to_bytes(self, state: Any) -> bytes:
        return bytes(self.fmu.serializeFMUState(state) if self.three else self.fmu.serializeFMUstate(state))

    def from_bytes(self, block: bytes) -> Any:
        return self.fmu.deserializeFMUState(block) if self.three else self.fmu.deSerializeFMUstate(block)

    def close(self) -> None:
        self.fmu.freeInstance()
        if self.folder.is_symlink():
            self.folder.unlink()
        else:
            shutil.rmtree(self.folder, ignore_errors=True)
