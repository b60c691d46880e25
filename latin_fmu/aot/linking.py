"""Link object file and C files to a library for a target by the compiler of ``ziglang``; allowed symbols.

The C files are a stub, which kernels need, and the runtime of co-simulation (``cosim.c_runtime``).
Undefined symbols of an object file and of a library are compared to the lists of those that they may need.
"""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from ..cosim import c_runtime


@dataclass(frozen=True)
class Target:
    """An operating system and processor.

    Attributes
    ----------
    triple : LLVM's name. cpu : the least processor the code runs on (generic: every one of AArch64). zig : the name by
    which zig links.
    """

    triple: str
    cpu: str
    zig: str


TARGETS: Final[Mapping[str, Target]] = MappingProxyType(
    {
        "linux-x86_64": Target("x86_64-unknown-linux-gnu", "x86-64-v3", "x86_64-linux-gnu.2.17"),
        "linux-aarch64": Target("aarch64-unknown-linux-gnu", "generic", "aarch64-linux-gnu.2.17"),
        "windows-x86_64": Target("x86_64-w64-windows-gnu", "x86-64-v3", "x86_64-windows-gnu"),
        "darwin-aarch64": Target("arm64-apple-macosx11.0.0", "apple-m1", "aarch64-macos.11.0"),
        # for compiled FMUs (``latin-fmu fmu --portable``): x86-64 processors from 2009 on
        "linux-x86_64-portable": Target("x86_64-unknown-linux-gnu", "x86-64-v2", "x86_64-linux-gnu.2.17"),
        "windows-x86_64-portable": Target("x86_64-w64-windows-gnu", "x86-64-v2", "x86_64-windows-gnu"),
    }
)


_SYMBOL_TABLES = (2, 11)  # of an object file, of a library
_WEAK = 2

# What the C library of every target has.
C_LIBRARY: Final = frozenset({"memset", "memcpy", "memmove", "malloc", "free", "abort", "hypot", "log10"})

# What the functions of the FMI use of it beside.
FUNCTIONS: Final = frozenset(
    [
        *("__ctype_b_loc", "__ctype_tolower_loc", "bcmp", "calloc", "fclose", "floor", "fopen"),
        *("__xstat", "fread", "fseek", "ftell", "fwrite", "localeconv", "memchr", "memcmp", "stat"),
        *("realloc", "remove", "rename", "rint", "sched_yield", "snprintf", "strchr"),
        *("strcmp", "strcpy", "strcspn", "strlen", "strncmp", "strpbrk", "strspn"),
        *("strtod", "vsnprintf"),
    ]
)

# What stub.c defines: memory of kernels that allocate, error paths that are never reached, the end of a time slice.
STUB: Final = frozenset(
    [
        "NRT_Allocate",
        "NRT_Free",
        "NRT_MemInfo_alloc",
        "NRT_MemInfo_alloc_aligned",
        "NRT_MemInfo_call_dtor",
        "PyErr_SetString",
        "PyExc_RuntimeError",
        "PyObject_Hash",
        "PyTuple_Pack",
        "PyUnicode_FromKindAndData",
        "latin_fmu_yield",
    ]
)


class ForbiddenSymbolError(Exception):
    """A kernel needs something that the library does not have."""


def check(content: bytes, allowed: Iterable[str] = C_LIBRARY | STUB) -> None:
    """Compare the undefined symbols of an ELF object to those allowed.

    Raises
    ------
    ForbiddenSymbolError : names them.
    """
    wrong = sorted(set(undefined(content)) - set(allowed))
    if wrong:
        raise ForbiddenSymbolError(
            f"the kernels need {', '.join(wrong)}; allowed: {', '.join(sorted(allowed))}; a kernel raises, prints, "
            "allocates or calls a function of Python or NumPy that has no compiled form in the library, or a C file "
            "calls another function of the C library"
        )


def undefined(content: bytes) -> Iterator[str]:
    """Names of the undefined symbols, weak ones apart, of a 64-bit little-endian ELF object or library.

    Raises
    ------
    ValueError : another kind of file.
    """
    if content[:6] != b"\x7fELF\x02\x01":
        raise ValueError("no 64-bit little-endian ELF object")
    # e_shoff; e_shentsize and e_shnum
    start, size, count = struct.unpack_from("<Q", content, 40)[0], *struct.unpack_from("<HH", content, 58)
    # name, type, flags, address, offset, size, link, ...: a table of symbols is linked to its names
    sections = [struct.unpack_from("<IIQQQQIIQQ", content, start + i * size) for i in range(count)]
    for section in sections:
        if section[1] not in _SYMBOL_TABLES:
            continue
        offset = section[4]
        length = section[5]
        names = sections[section[6]]
        for at in range(offset, offset + length, 24):
            # Elf64_Sym: st_name, st_info with the binding in its upper half, st_other, st_shndx with 0 for undefined
            name, kind, _, index = struct.unpack_from("<IBBH", content, at)
            if index == 0 and name and kind >> 4 != _WEAK:
                first = names[4] + name
                yield content[first : content.index(b"\0", first)].decode()


_STUB: Final = Path(__file__).with_name("stub.c")


class LinkError(Exception):
    """The linker refused; its message."""


def link(content: bytes, manifest: str, target: Target, library: Path) -> None:
    """Write the library; ``manifest`` : the text in it that identifies its sources (``compiled.library.manifest``).

    Raises
    ------
    LinkError : the compiler is not there, or a symbol is undefined.
    """
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        output, source = Path(folder) / library.name, Path(folder) / "manifest.c"
        (Path(folder) / "kernels.o").write_bytes(content)
        export = "__declspec(dllexport)" if "windows" in target.zig else '__attribute__((visibility("default")))'
        text = manifest.replace("\n", "\\n")
        texts = {"latin_fmu_manifest": text, "latin_fmu_functions": c_runtime.digest()}
        lines = [f'{export} const char {name}[] = "{value}";\n' for name, value in texts.items()]
        source.write_text("".join(lines), encoding="utf-8")
        command = [
            sys.executable,
            "-m",
            "ziglang",
            "cc",
            "-target",
            target.zig,
            "-shared",
            "-O3",
            "-std=gnu99",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-fno-math-errno",
            "-fvisibility=hidden",
            "-s",
            *(("-DLATIN_FMU_WIDE",) if target.cpu == "x86-64-v3" else ()),
            "-o",
            str(output),
            str(Path(folder) / "kernels.o"),
            str(_STUB),
            str(source),
            *(str(path) for path in c_runtime.sources() if path.suffix == ".c"),
            *(() if "windows" in target.zig else ("-lm",)),
            # calls inside it stay inside it, whatever library of another version a host has loaded for all to see
            *(("-Wl,--no-undefined", "-Wl,-Bsymbolic") if "linux" in target.zig else ()),
            # the name by which others would link it, and not the path where it is made
            *((f"-Wl,-install_name,@rpath/{library.name}",) if "macos" in target.zig else ()),
        ]
        cache = str(library.parent / "zig")  # nothing is written into the user's home
        environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        if done.returncode:
            raise LinkError(f"{' '.join(command[1:4])} for {target.zig}: {done.stderr.strip()}")
        if "linux" in target.zig:
            # those of the stub are defined now
            check(output.read_bytes(), C_LIBRARY | FUNCTIONS)
        os.replace(output, library)  # whole or not at all
