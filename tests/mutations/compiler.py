"""Process that compiles changed kernels of a copy of the package: ``python compiler.py``, in that copy.

It lowers all kernels once. For each request, ``{"file": ..., "function": ...}`` on a line, a child of it takes the
function from the file as it is now, lowers it and what calls it, optimises and links the library anew; the result is a
line of JSON, empty where the library is there, else the message of the compiler. A third of the time of a whole build.
"""

from __future__ import annotations

import ast
import json
import os
import sys
from importlib import import_module
from pathlib import Path
from types import CodeType
from typing import Any, Final

from latin_fmu import aot
from latin_fmu.aot import linking, lowering
from latin_fmu.compiled import library
from latin_fmu.compiled.declare import Kernel

TARGET: Final = linking.TARGETS[aot.host() or ""]
BUILT: Final = library.PACKAGE.parent / "build" / library.file_name(library.target())


def package_modules() -> list[Any]:
    """Modules of the package that are loaded."""
    return [module for name, module in sorted(sys.modules.items()) if name.startswith("latin_fmu.")]


def kernels() -> list[Kernel]:
    """All kernels of the package, each once."""
    every = {id(v): v for module in package_modules() for v in vars(module).values() if isinstance(v, Kernel)}
    return list(every.values())


def _names(code: CodeType) -> set[str]:
    inner = [_names(c) for c in code.co_consts if isinstance(c, CodeType)]
    return set(code.co_names).union(*inner)


def callers(changed: Kernel) -> list[Kernel]:
    """A kernel and all that call it, at any depth."""
    every = kernels()
    calls = {
        id(k): {
            id(v) for name in _names(k.py_func.__code__) if isinstance(v := k.py_func.__globals__.get(name), Kernel)
        }
        for k in every
    }
    reached = {id(changed)}
    while more := {i for i, called in calls.items() if called & reached} - reached:
        reached |= more
    return [k for k in every if id(k) in reached]


def replaced(file: str, function: str) -> Kernel | None:
    """Put a function of a file, as it is now, in the place of the loaded one; None where it is no kernel."""
    module = import_module(".".join(("latin_fmu", *Path(file).with_suffix("").parts)))
    old = vars(module).get(function)
    if not isinstance(old, Kernel):
        return None
    path = library.PACKAGE / file
    wanted = [n for n in ast.parse(path.read_bytes()).body if isinstance(n, ast.FunctionDef) and n.name == function]
    exec(compile(ast.Module(wanted, []), str(path), "exec", dont_inherit=True), vars(module))
    new: Kernel = vars(module)[function]
    new.shared = old.shared
    for other in package_modules():
        for name, value in list(vars(other).items()):
            if value is old:
                setattr(other, name, new)
    return new


def emitted(front: lowering.FrontEnd) -> bytes:
    """Object file of all kernels; those compiled before are not compiled again."""
    modules, exported = lowering.lower(front, aot.declared())
    whole = lowering.joined(modules, exported, aot.shared())
    lowering.optimise(whole, TARGET)
    content = lowering.emit(whole, TARGET)
    linking.check(content)
    return content


def link(content: bytes) -> None:
    """The library, with the digest of the sources as they are now."""
    sources = library.sources_of(library.PACKAGE)
    manifest = "\n".join([*(s.as_posix() for s in sources), library.digest_of(library.PACKAGE, sources)])
    linking.link(content, manifest, TARGET, BUILT)


def served(front: lowering.FrontEnd, whole: bytes, file: str, function: str) -> str:
    """Library with a changed function; what is wrong with it, empty where nothing is."""
    try:
        new = replaced(file, function)
        if new is not None:
            for kernel in callers(new):
                front.dispatchers.forget(kernel)
        link(whole if new is None else emitted(front))
    except Exception as error:  # numba and LLVM raise many kinds
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        return f"{type(error).__name__}: {' '.join(lines[:3])}"[:200]
    return ""


def main() -> None:
    """Lower everything, then serve requests from standard input."""
    front = lowering.start()
    whole = emitted(front)
    link(whole)
    answer = sys.stdout
    answer.write(json.dumps("") + "\n")
    answer.flush()
    for line in sys.stdin:
        request = json.loads(line)
        reading, writing = os.pipe()
        if (child := os.fork()) == 0:
            os.write(writing, served(front, whole, **request).encode())
            os._exit(0)
        os.close(writing)
        with os.fdopen(reading, "rb") as pipe:
            said = pipe.read().decode()
        ended = os.waitpid(child, 0)[1]
        answer.write(json.dumps(said or (f"the compiler ends with {ended}" if ended else "")) + "\n")
        answer.flush()


if __name__ == "__main__":
    main()
