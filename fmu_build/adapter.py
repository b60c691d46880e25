"""Adapters of an FMU: the methods that the library of the FMU calls, one per function of the FMI.

They run inside the host and hand every call to an FMI instance of the solver or of a reduced model. A method returns a
status of the FMI, the highest level of the messages of the call, plus ``PENDING`` where messages wait. Hosts
also instantiate an FMU only to read its variables: loading and instantiation do little.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.metadata
import importlib.util
import itertools
import json
import os
import re
import secrets
import sys
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

OK = 0
WARNING = 1
DISCARD = 2
ERROR = 3
PENDING = 256  # added to a status where messages wait
SPACE = uuid.UUID("7d1b3c52-6c0e-5f0a-9a43-2f4b8e1d90aa")  # of the tokens made from contents
DIGESTS = "digests.json"  # SHA-256 of the files of the folder ``resources``, by path


class Messages:
    """Messages of an instance that wait for the host, and the status that they give a call."""

    def __init__(self) -> None:
        self._messages: list[tuple[int, str]] = []

    def _log(self) -> Callable[[int, str], None]:
        """Keeps messages for the host; it does not hold the adapter, so that no cycle of references arises."""
        messages = self._messages
        return lambda level, text: messages.append((level, text))

    def messages(self) -> list[tuple[int, str]]:
        """Levels and texts of the messages that wait; they wait no longer."""
        waiting = self._messages.copy()
        self._messages.clear()
        return waiting

    def _status(self) -> int:
        """Status of a call: the highest level of its messages; a warning leaves it OK."""
        if not self._messages:
            return OK
        level = max(level for level, _ in self._messages)
        return PENDING + (OK if level == WARNING else level)

    def _refused(self, text: str) -> int:
        self._messages.append((ERROR, text))
        return self._status()


class Opened(Messages):
    """An FMU whose files and packages are those that it needs.

    Parameters
    ----------
    resources : folder of the extracted FMU. name : of the instance. token : given by the host, from the model
        description.

    Attributes
    ----------
    needed : packages the host must have, with their least versions.

    Raises
    ------
    ImportError : a package is missing or too old. ValueError : a file of the FMU, or the token, is another one.
    """

    needed: ClassVar[Mapping[str, str]] = {}

    def __init__(self, resources: str, name: str, token: str) -> None:
        del name
        super().__init__()
        self.folder = os.path.normpath(resources)
        self.package = __name__.partition(".")[0]
        check_contents(Path(self.folder), token)
        relocate(self.package, self.folder)
        check_packages(self.needed)
        self._array = importlib.import_module("numpy").frombuffer

    def _module(self, name: str) -> Any:
        return importlib.import_module(f"{self.package}.latin_fmu.{name}")

    def _content(self, name: str) -> bytes:
        return Path(self.folder, name).read_bytes()


class KeptStates(Opened):
    """States of an instance: the host holds a handle, the bytes are kept here.

    Attributes
    ----------
    fmi_instance : takes the calls.
    """

    states: ClassVar[dict[int, Any]] = {}  # by handle, of all instances
    handles: ClassVar[Any] = itertools.count(secrets.randbits(40) + 1)  # of another FMU or run: none of these
    fmi_instance: Any

    def __init__(self, resources: str, name: str, token: str) -> None:
        super().__init__(resources, name, token)
        self._own_states: set[int] = set()

    def close(self) -> int:
        """Free the instance: its states, and what its parts hold of one another."""
        for handle in self._own_states:
            self.states.pop(handle, None)
        self.fmi_instance.close()
        return OK

    def get_state(self, handle: memoryview, phase: int) -> int:
        """Keep the present state under the handle the host gives, where it is known, else under a new one. ``phase`` :
        state of the state machine of the FMI, kept with it."""
        self.fmi_instance.phase = phase
        saved = self.fmi_instance.get_state()
        if saved is not None:
            self._keep(saved, handle)
        return self._status()

    def _keep(self, saved: Any, handle: memoryview) -> None:
        place = self._array(handle, "i8")
        # a handle that another instance has given is not overwritten
        if int(place[0]) in self._own_states:
            number = int(place[0])
        else:
            number = next(self.handles)
        self.states[number] = saved
        self._own_states.add(number)
        place[0] = number

    def _known(self, handle: int) -> bool:
        if handle not in self.states:
            self._refused("the importer passes a state that this FMU did not return, or that was freed")
        return handle in self.states

    def set_state(self, handle: int, phase: memoryview) -> int:
        """Restore the state of a handle; write that of the state machine of the FMI."""
        if self._known(handle):
            self.fmi_instance.set_state(self.states[handle])
            self._array(phase, "i8")[0] = self.fmi_instance.phase
        return self._status()

    def free_state(self, handle: int) -> int:
        """Forget the state of a handle."""
        if self._known(handle):
            del self.states[handle]
            self._own_states.discard(handle)
        return self._status()

    def state_size(self, handle: int, size: memoryview) -> int:
        """Write the number of bytes of a serialized state."""
        if self._known(handle):
            self._array(size, "i8")[0] = len(self.fmi_instance.to_bytes(self.states[handle]))
        return self._status()

    def state_to_bytes(self, handle: int, target: memoryview) -> int:
        """Write a state as bytes."""
        if self._known(handle):
            block = self.fmi_instance.to_bytes(self.states[handle])
            if len(block) != target.nbytes:
                return self._refused(f"the importer provides {target.nbytes} bytes for a state of {len(block)} bytes")
            target[:] = block
        return self._status()

    def state_from_bytes(self, block: bytes, handle: memoryview) -> int:
        """Keep the state of serialized bytes under a new handle; damaged bytes are refused."""
        saved = self.fmi_instance.from_bytes(block)
        if saved is not None:
            self._keep(saved, handle)
        return self._status()


class Adapter(KeptStates):
    """Base of the adapter: life cycle and numbers.

    Parameters
    ----------
    resources, name, token : as for ``Opened``.
    """

    def __init__(self, resources: str, name: str, token: str) -> None:
        super().__init__(resources, name, token)
        self.fmi_instance = self._open()

    def _open(self) -> Any:
        raise NotImplementedError

    def reset(self) -> int:
        """Return to the state after instantiation."""
        self.fmi_instance.close()
        self.fmi_instance = self._open()
        return self._status()

    def setup(self, _start_time: float, _tolerance: float) -> int:
        """Start time and tolerance have no effect on the equations."""
        return OK

    def initialize(self) -> int:
        """End the initialization."""
        self.fmi_instance.initialize()
        return self._status()

    def terminate(self) -> int:
        """End the simulation."""
        return self._status()

    # -- variables ------------------------------------------------------------------------------------------------
    def get_numbers(self, references: memoryview, values: memoryview) -> int:
        """Write numbers by value reference; elements of arrays in row-major order, the first one alone for a host that
        reads one number per variable because it has no arrays."""
        numbers = self._array(references, "u4")
        read = self.fmi_instance.get(numbers)
        # one number each where there are arrays among them
        if values.nbytes == 8 * len(numbers) < 8 * len(read):
            read = [self.fmi_instance.get([number])[0] for number in numbers]
        if 8 * len(read) != values.nbytes:
            return self._refused(f"the importer reads {values.nbytes // 8} values of variables with {len(read)} values")
        self._array(values)[:] = read
        if self._messages:
            return self._status()
        return OK

    def directional_derivative(
        self, _unknowns: memoryview, _knowns: memoryview, _seed: memoryview, _values: memoryview
    ) -> int:
        """Write a directional derivative."""
        return self._refused("this FMU has no directional derivatives")

    def get_texts(self, _references: memoryview, _texts: list[bytes]) -> int:
        """Append the strings of variables."""
        return self._refused("this FMU has no strings")

    def set_texts(self, _references: memoryview, _texts: list[bytes]) -> int:
        """Set the strings of variables."""
        return self._refused("this FMU has no strings")


class ModelExchangeAdapter(Adapter):
    """Adapter to a ``ReducedModelInstance`` of ``latin_fmu.model_exchange``."""

    needed: ClassVar[Mapping[str, str]] = {"numpy": "2.0", "pydantic": "2.10"}

    def _open(self) -> Any:
        system = self._module("model_exchange.equations")
        reduced = system.ReducedSystem.from_bytes(self._content("reduced.bin"))
        names = system.Names.from_text(self._content("variables.json").decode())
        return self._module("model_exchange.fmi_instance").ReducedModelInstance(reduced, names, self._log())

    def set_numbers(self, references: memoryview, values: memoryview) -> int:
        """Set variables by value reference; an input that is not finite is logged, and stops the integrator as NaN."""
        done = self.fmi_instance.set(self._array(references, "u4").tolist(), self._array(values).tolist())
        if done and self.fmi_instance.variables.fixed:
            return self._status() & PENDING
        return self._status()

    def set_time(self, time: float) -> int:
        """Set the time of the next evaluations, s."""
        self.fmi_instance.set_time(time)
        return self._status()

    def number_of_states(self, count: memoryview) -> int:
        """Write the number of continuous states."""
        return self._write(count, [self.fmi_instance.names.n_state])

    def number_of_indicators(self, count: memoryview) -> int:
        """Write the number of event indicators."""
        return self._write(count, [self.fmi_instance.names.n_indicator])

    def set_continuous_states(self, values: memoryview) -> int:
        """Set all continuous states."""
        self.fmi_instance.set_states(self._array(values))
        return self._status()

    def get_continuous_states(self, values: memoryview) -> int:
        """Write the continuous states."""
        return self._write(values, self.fmi_instance.y)

    def get_derivatives(self, values: memoryview) -> int:
        """Write the time derivatives of the continuous states."""
        return self._write(values, self.fmi_instance.derivatives())

    def get_nominals(self, values: memoryview) -> int:
        """Write the nominal values of the continuous states."""
        return self._write(values, self.fmi_instance.equations.nominals())

    def get_event_indicators(self, values: memoryview) -> int:
        """Write the event indicators."""
        return self._write(values, self.fmi_instance.indicators())

    def update_discrete_states(self, event: memoryview) -> int:
        """Update contact states and time laws at an event; write whether the simulation ends, whether the time of a
        next event is known, and this time, s."""
        update = self.fmi_instance.update()
        following = update.next_event
        return self._write(event, [update.terminate, following is not None, following or 0.0])

    def _write(self, target: memoryview, values: Any) -> int:
        self._array(target)[:] = values
        return self._status() & PENDING  # NaN stops an integrator; some ignore a status in its callbacks


class CoSimulationAdapter(Opened):
    """Adapter to the ``ImageMaker`` of ``latin_fmu.cosim``: all else of an FMU for co-simulation is in C."""

    needed: ClassVar[Mapping[str, str]] = {
        "numpy": "2.0",
        "scipy": "1.15",
        "pydantic": "2.10",
        "xarray": "2024.10",
        "netCDF4": "1.7.2",
        "threadpoolctl": "3.5",
    }

    def __init__(self, resources: str, name: str, token: str) -> None:
        super().__init__(resources, name, token)
        scene, reader = os.path.join(self.folder, "scene", "scene.toml"), f"{self.package}.latin_fmu.reader"
        log = self._log()
        self._maker = self._module("cosim.image_maker").ImageMaker(
            lambda: importlib.import_module(reader).load_scene(scene), lambda text: log(WARNING, text)
        )

    def make(self, numbers: memoryview, starts: memoryview, accuracy: float, address: memoryview) -> int:
        """Write the address of the image for these values of the variables, and amplitudes of the inputs at the
        start; ``accuracy`` : that the host wants, 0 where it says nothing."""
        arguments = self._array(numbers).tolist(), accuracy, self._array(starts).tolist() if starts.nbytes else []
        return self._done(lambda: self._array(address, "i8").__setitem__(0, self._maker.make(*arguments)))

    def table_of_file(self, path: bytes, rows: list[bytes]) -> int:
        """Append the histories in a netCDF file as a table of text."""
        name = path.decode(errors="surrogateescape")
        return self._done(lambda: rows.append(self._maker.history_table(name).encode()))

    def _done(self, call: Callable[[], None]) -> int:
        try:
            call()
        except self._module("errors").LatinError as error:
            return self._refused(str(error))
        return self._status()

    def close(self) -> int:
        """Free the images."""
        self._maker.close()
        return OK


# -- checks at instantiation --------------------------------------------------------------------------------------
def check_packages(needed: Mapping[str, str]) -> None:
    """Compare the packages of this Python with those needed; a package that is loaded counts as it is.

    Raises
    ------
    ImportError : names those that are missing or too old, and the Python.
    """
    wrong = []
    for name, least in needed.items():
        version = _version(name)
        if version is None:
            wrong.append(f"{name} >= {least} (missing)")
        elif _parts(version) < _parts(least):
            wrong.append(f"{name} >= {least} (here {version})")
    if wrong:
        python = f"Python {sys.version.split()[0]} in {sys.prefix}"
        raise ImportError(
            f"this FMU needs the packages {', '.join(wrong)}; {python} does not have them: "
            "see documentation/externalDependencies.txt"
        )


def _version(name: str) -> str | None:
    """Version of a package, of the loaded module if there is one; None where it is missing."""
    # in this order: ``find_spec`` raises for a loaded module without a spec
    if name not in sys.modules and importlib.util.find_spec(name) is None:
        return None
    loaded = getattr(sys.modules.get(name), "__version__", None)
    if loaded is not None:
        return str(loaded)
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return str(getattr(importlib.import_module(name), "__version__", "0"))


def _parts(version: str) -> tuple[int, ...]:
    """The leading numbers of a version."""
    # what follows the numbers ("rc1", "+local") does not count
    match = re.match(r"\d+(\.\d+)*", version)
    if match:
        return tuple(int(part) for part in match[0].split("."))
    return (0,)


def check_contents(resources: Path, token: str) -> None:
    """Compare the files of an FMU with their digests, and these with the token of the model description.

    Raises
    ------
    ValueError : names the first file that is missing or was changed.
    """
    try:
        listed = Path(resources, DIGESTS).read_bytes()
    except OSError:
        raise ValueError(f"the FMU is incomplete: resources/{DIGESTS} cannot be read; extract it again") from None
    # FMI 2 writes it in braces
    if token.strip("{}") != token_of(listed):
        raise ValueError("the model description and the resources belong to different FMUs: extract the FMU again")
    for path, digest in json.loads(listed).items():
        try:
            content = Path(resources, path).read_bytes()
        except OSError:
            content = b""
        if hashlib.sha256(content).hexdigest() != digest:
            raise ValueError(f"resources/{path} is missing or was changed: extract the FMU again, or make it again")


def token_of(listed: bytes) -> str:
    """Token of an FMU from the digests of its files."""
    return str(uuid.uuid5(SPACE, hashlib.sha256(listed).hexdigest()))


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
