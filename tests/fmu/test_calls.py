"""Every function of the FMI in every state: allowed where the standard says so, an error with the name of the state
elsewhere, which changes nothing."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import pytest

from .host import Host

H = 0.2e-6

# FMI 2.0.4, table of section 4.2.4: Instantiated, initialization Mode, step Complete, step Failed, Terminated, Error.
TWO = {
    "SetDebugLogging": "IMCFTE",
    "Reset": "IMCFTE",
    "SetupExperiment": "I",
    "EnterInitializationMode": "I",
    "ExitInitializationMode": "M",
    "Terminate": "CF",
    "GetReal": "MCFTE",
    "GetInteger": "MCFTE",
    "GetBoolean": "MCFTE",
    "GetString": "MCFTE",
    "SetReal": "IMC",
    "SetInteger": "IMC",
    "SetBoolean": "IMC",
    "SetString": "IMC",
    "GetFMUstate": "IMCFTE",
    "SetFMUstate": "IMCFTE",
    "FreeFMUstate": "IMCFTE",
    "SerializedFMUstateSize": "IMCFTE",
    "SerializeFMUstate": "IMCFTE",
    "DeSerializeFMUstate": "IMCFTE",
    "GetDirectionalDerivative": "MCFTE",
    "DoStep": "C",
    "GetStatus": "CFT",
    "GetRealStatus": "CFT",
    "GetBooleanStatus": "CFT",
}
# FMI 3.0, 2.3 and 4.2: Instantiated, Konfiguration mode, initialization Mode, Step mode, Terminated, Error, for
# which FMI 3 has no name. Without event mode.
THREE = {
    "SetDebugLogging": "IKMSTE",
    "Reset": "IKMSTE",
    "EnterConfigurationMode": "I",
    "ExitConfigurationMode": "K",
    "EnterInitializationMode": "I",
    "ExitInitializationMode": "M",
    "EnterEventMode": "",
    "EnterContinuousTimeMode": "",
    "EvaluateDiscreteStates": "",
    "SetTime": "",
    "Terminate": "S",
    **{f"Get{kind}": "IKMSTE" for kind in ("Float32", "Float64", "Int32", "UInt64", "Boolean", "String")},
    **{f"Set{kind}": "IKMS" for kind in ("Float32", "Float64", "Int32", "UInt64", "Boolean", "String")},
    "GetFMUState": "IKMSTE",
    "SetFMUState": "IKMSTE",
    "FreeFMUState": "IKMSTE",
    "SerializedFMUStateSize": "IKMSTE",
    "SerializeFMUState": "IKMSTE",
    "DeserializeFMUState": "IKMSTE",
    "GetDirectionalDerivative": "MSTE",
    "DoStep": "S",
}
NAMES = {"I": "Instantiated", "K": "Configuration", "M": "Initialization", "C": "stepComplete", "F": "stepFailed"}
NAMES |= {"S": "Step Mode", "T": "Terminated", "E": "error"}
ANOTHER_REASON = ("GetDirectionalDerivative", "ExitInitializationMode", "Terminate")  # nothing to derive; a failed step


@pytest.fixture
def host(made, fmi, tmp_path) -> Iterator[Host]:
    one = Host(made[fmi], tmp_path / "instance")
    yield one
    one.close()


def to(host: Host, state: str) -> None:
    """Bring an instance that was just made, or reset, to a state."""
    if state == "K":
        host.fmu.enterConfigurationMode()
    if state in "IK":
        return
    host.prepare()
    if state == "E":
        host.set(mode=7)
        assert host.status(host.fmu.exitInitializationMode) == 3
    elif state != "M":
        host.fmu.exitInitializationMode()
        assert host.step(0.0, H)
        if state == "F":
            host.set(load__press__value=1e300)
            assert not host.step(H, H)
            assert host.last == 2
        if state == "T":
            host.fmu.terminate()


def functions(host: Host) -> Iterator[tuple[str, str, Callable[[Any], int]]]:
    """Name, allowed states, and a call with an instance that is good where it is allowed."""
    mark, table = ("fmi3", THREE) if host.three else ("fmi2", TWO)
    memory, size, flag = (ctypes.create_string_buffer(64) for _ in range(3))
    names = {"String": "historyFile", "Int32": "mode", "Integer": "mode", "Boolean": "mode", "UInt64": "window.size"}
    real, zero, text = ctypes.c_double(0.5), ctypes.c_double(0.0), ctypes.c_char_p(b"")

    def variable(kind: str) -> list[Any]:
        reference = (ctypes.c_uint32 * 1)(host.reference(names.get(kind, "load.press.value")))
        return [reference, ctypes.c_size_t(1)]

    def values(name: str) -> list[Any]:
        kind = name[3:]
        small = {"Float32": ctypes.c_float(0.5), "Float64": real, "Real": real, "String": text}
        given = memory if name.startswith("Get") else ctypes.byref(small.get(kind, ctypes.c_int64(0)))
        if name == "SetUInt64":
            given = ctypes.byref(ctypes.c_uint64(31))
        return [*variable(kind), given, *([ctypes.c_size_t(1)] if host.three else [])]

    saved = ctypes.c_void_p()
    tate = "State" if host.three else "state"
    arguments: Mapping[str, list[Any]] = {
        "SetDebugLogging": [ctypes.c_int(0), ctypes.c_size_t(0), None],
        "SetupExperiment": [ctypes.c_int(0), zero, zero, ctypes.c_int(0), zero],
        "DoStep": [ctypes.c_double(H), ctypes.c_double(H), ctypes.c_int(1)],
        "GetStatus": [ctypes.c_int(0), memory],
        "GetRealStatus": [ctypes.c_int(2), memory],
        "GetBooleanStatus": [ctypes.c_int(3), memory],
        "SetTime": [zero],
        "GetDirectionalDerivative": [*variable("Real"), *variable("Real"), ctypes.byref(real), memory],
    }
    if host.three:
        one = ctypes.c_size_t(1)
        arguments = {
            **arguments,
            "EnterInitializationMode": [ctypes.c_bool(False), zero, zero, ctypes.c_bool(False), zero],
            "DoStep": [*arguments["DoStep"], flag, flag, flag, memory],
            "GetDirectionalDerivative": [*variable("Real"), *variable("Real"), ctypes.byref(real), one, memory, one],
        }

    def call(name: str, instance: Any) -> int:
        function = host.fmu.dll[f"{mark}{name}"]
        if f"FMU{tate}" not in name:
            given = values(name) if name[:3] in ("Get", "Set") and name not in arguments else arguments.get(name, [])
            return int(function(instance, *given))
        get, free = (host.fmu.dll[f"{mark}{what}FMU{tate}"] for what in ("Get", "Free"))
        saved.value = None
        if name.startswith("GetFMU") or instance is None:
            many = [ctypes.byref(saved), size, size, size]
            return int(function(instance, *many))
        assert get(instance, ctypes.byref(saved)) == 0
        count = ctypes.c_size_t()
        assert host.fmu.dll[f"{mark}SerializedFMU{tate}Size"](instance, saved, ctypes.byref(count)) == 0
        block = ctypes.create_string_buffer(count.value)
        assert host.fmu.dll[f"{mark}SerializeFMU{tate}"](instance, saved, block, count) == 0
        another = ctypes.c_void_p()
        by_name = {
            "Set": [saved],
            "Free": [ctypes.byref(saved)],
            "SerializedFMU": [saved, ctypes.byref(count)],
            "SerializeFMU": [saved, block, count],
            "De": [block, count, ctypes.byref(another)],
        }
        status = int(function(instance, *next(given for key, given in by_name.items() if name.startswith(key))))
        if saved.value:
            free(instance, ctypes.byref(saved))
        return status

    for name, states in table.items():
        yield name, states, lambda instance, name=name: call(name, instance)


def test_functions_by_states(host, fmi):
    """The state machine itself is part of what a state of the FMU restores."""
    instance = ctypes.c_void_p(getattr(host.fmu.component, "value", host.fmu.component))
    for state in "IKMSTE" if host.three else "IMCFTE":
        host.fmu.reset()
        to(host, state)
        saved = host.save()
        for name, allowed, call in functions(host):
            before = len(host.messages)
            status = call(instance)
            said = " ".join(text for _, _, text in host.messages[before:])
            if state in allowed:
                assert "is not allowed in the state" not in said, (state, name, said)
                good = status < 2 or name in ANOTHER_REASON or "is fixed after initialization" in said
                assert good, (state, name, said)
            else:
                assert status == 3, (state, name)
                assert f"fmi{fmi}{name} is not allowed in the state {NAMES[state]}" in said, (state, name, said)
            host.restore(saved)


def test_an_instance_that_is_none(host):
    for name, _, call in functions(host):
        assert call(None) == 3, name


def test_what_is_out_of_order_changes_nothing(host):
    """The clock does not go back, a second end is an error, and the run goes on as if nothing had been called."""
    host.start()
    host.set(load__press__value=0.7)
    assert host.step(0.0, H)
    before = host.to_bytes(host.save())
    late = host.fmu.enterInitializationMode if host.three else host.fmu.setupExperiment
    assert host.status(lambda: late(startTime=5.0)) == 3
    assert host.status(host.fmu.exitInitializationMode) == 3
    assert host.to_bytes(host.save()) == before
    assert host.step(H, H), host.messages
    host.fmu.terminate()
    assert host.status(host.fmu.terminate) == 3
    assert "is not allowed in the state Terminated" in host.messages[-1][2]


def test_what_is_refused_is_an_error_and_nothing_is_set(host):
    host.start()
    kind = "Float64" if host.three else "Real"
    names = ["load.press.value", "interface.crush.force[1]"]
    references = [host.reference(name) for name in names]
    assert host.status(getattr(host.fmu, f"set{kind}"), references, [0.9, 1.0]) == 3
    assert "interface.crush.force[1] is calculated and was not set" in host.messages[-1][2]
    assert host.read(names[:1]) == 0.25
    assert host.status(lambda: host.set(endTime=1.0)) == 3
    assert host.status(lambda: host.set(historyFile="x")) == 3
    assert "historyFile is fixed after initialization and was not set" in host.messages[-1][2]
    assert host.step(0.0, H)
