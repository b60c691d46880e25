"""Lowered kernels to one object file: joined, optimised once, emitted for a target."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import llvmlite.binding as llvm

_ENVIRONMENT: Final = "_ZN08NumbaEnv"


@dataclass(frozen=True)
class Target:
    """An operating system and processor.

    Attributes
    ----------
    triple : LLVM's name. cpu, features : the least processor the code runs on. zig : the name by which zig links.
    """

    triple: str
    cpu: str
    zig: str


TARGETS: Final[Mapping[str, Target]] = MappingProxyType(
    {
        "linux-x86_64": Target("x86_64-unknown-linux-gnu", "x86-64-v3", "x86_64-linux-gnu.2.17"),
        "linux-aarch64": Target("aarch64-unknown-linux-gnu", "neoverse-n1", "aarch64-linux-gnu.2.17"),
        "windows-x86_64": Target("x86_64-w64-windows-gnu", "x86-64-v3", "x86_64-windows-gnu"),
        "darwin-aarch64": Target("arm64-apple-macosx11.0.0", "apple-m1", "aarch64-macos.11.0"),
    }
)


def machine(target: Target) -> Any:
    """LLVM's machine for a target: position independent, all optimisations."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu, opt=3, reloc="pic", codemodel="default"
    )


def joined(modules: Iterable[Any], exported: Iterable[str], shared: Iterable[str] = ()) -> Any:
    """One module of all, with only the exported functions visible; functions whose names begin as ``shared`` says are
    not inlined."""
    names, kept = set(exported), tuple(shared)
    whole = llvm.parse_assembly("")
    for module in modules:
        for function in module.functions:  # several modules hold the same helpers of numba
            if not function.is_declaration and function.name not in names:
                function.linkage = "weak_odr"
        whole.link_in(module, preserve=True)
    for function in whole.functions:  # counts of references are null tests where arrays come from outside
        if function.name in ("NRT_incref", "NRT_decref") and not function.is_declaration:
            function.add_function_attribute("alwaysinline")
    for item in (*whole.functions, *whole.global_variables):
        if not item.is_declaration and item.name not in names:
            # numba's pointers to Python's objects: internal ones would be taken for the null that they are here, and
            # a kernel that uses Python would become one that fails
            if kept and item.name.startswith(kept):
                item.add_function_attribute("noinline")
            item.linkage = "linkonce_any" if item.name.startswith(_ENVIRONMENT) else "internal"
    return whole


def optimise(module: Any, target: Target) -> None:
    """LLVM's passes, with loops and straight-line code vectorised for the processor of the target."""
    tm = machine(target)
    module.triple, module.data_layout = target.triple, str(tm.target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization, options.slp_vectorization = True, True
    passes = llvm.create_pass_builder(tm, options)
    manager = passes.getModulePassManager()
    manager.run(module, passes)


def emit(module: Any, target: Target) -> bytes:
    """Object file of a module; the module itself is used up."""
    tm = machine(target)
    module.triple, module.data_layout = target.triple, str(tm.target_data)
    return bytes(tm.emit_object(module))
