"""Mutants of the numerical sources: one wrong sign, operand, bound, constant or index each, drawn with a seed.

Every arithmetic operation, comparison and index in the functions of some folders is a site; a site has one mutant for
each change that applies to it. Not changed: annotations, docstrings, decorators, asserts, and what only words a
message (f-strings and the arguments of ``raise``).
"""

from __future__ import annotations

import ast
import copy
import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FOLDERS = ("kernels", "laws", "interface", "time_scheme", "propagator", "assembly", "joined", "statics", "checks")
KINDS = ("arithmetic", "term", "operands", "comparison", "constant", "index")
_SWAPPED: dict[type, type] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}


@dataclass(frozen=True)
class Mutant:
    """One changed expression.

    Attributes
    ----------
    file : below ``latin_fmu``. function : the one that holds it, with its class. kind : of ``KINDS``.
    before, after : text of the expression, or of an assignment such as ``a += b``. line, column, end : where it stands
        (end: line and column).
    """

    file: str
    function: str
    kind: str
    before: str
    after: str
    line: int
    column: int
    end: tuple[int, int]

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What names the mutant in a table of survivors: no line numbers."""
        return self.file, self.function, self.before, self.after

    def applied(self, source: str) -> str:
        """The source with this one change; columns count bytes, as in ``ast``."""
        lines = source.encode().splitlines(keepends=True)
        first, last = self.line - 1, self.end[0] - 1
        after = self.after if self.before.count("=") and "= " in self.before else f"({self.after})"
        whole = lines[first][: self.column] + after.encode() + lines[last][self.end[1] :]
        return b"".join([*lines[:first], whole, *lines[last + 1 :]]).decode()


def _fields(node: ast.AST) -> Iterator[ast.AST]:
    """Children that are computed: no annotations, docstrings, decorators, asserts or messages."""
    if isinstance(node, ast.JoinedStr | ast.Raise | ast.Assert | ast.Import | ast.ImportFrom):
        return
    skipped = {"annotation", "returns", "decorator_list", "bases", "keywords" if isinstance(node, ast.ClassDef) else ""}
    for name, value in ast.iter_fields(node):
        if name not in skipped:
            yield from (item for item in (value if isinstance(value, list) else [value]) if isinstance(item, ast.AST))


def _expressions(node: ast.AST, function: str = "") -> Iterator[tuple[str, ast.AST]]:
    """Every node inside a function, with the name of the function."""
    for child in _fields(node):
        name = function
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            name = f"{function}.{child.name}".lstrip(".")
        if isinstance(child, ast.arguments):
            continue
        if function:
            yield function, child
        yield from _expressions(child, name)


def _changed(node: ast.AST, field: str, value: object) -> ast.AST:
    other = copy.deepcopy(node)
    setattr(other, field, value)
    return other


def _number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def _one_more(node: ast.expr) -> ast.expr:
    assert isinstance(node, ast.Constant)
    return ast.Constant(node.value + 1)  # type: ignore[operator]


def _whole(node: ast.AST) -> bool:
    """Whether a product in a kernel is an offset or a count: names and whole numbers, nothing read from an array."""
    parts = list(ast.walk(node))
    if any(isinstance(part, ast.Subscript | ast.Call) for part in parts):
        return False
    constants = [part.value for part in parts if isinstance(part, ast.Constant)]
    return all(type(value) is int for value in constants) and (
        bool(constants) or any(isinstance(part, ast.Attribute) for part in parts)
    )


def _operation(node: ast.BinOp, kernels: bool) -> Iterator[tuple[str, ast.AST]]:
    swapped = _SWAPPED.get(type(node.op))
    if swapped is ast.Div and kernels and _whole(node):
        swapped = ast.FloorDiv  # a quotient as an index would not compile
    if swapped is not None:
        yield "arithmetic", _changed(node, "op", swapped())
    if isinstance(node.op, ast.Add | ast.Sub):
        yield "term", node.left
    if isinstance(node.op, ast.Add):
        yield "term", node.right
    if isinstance(node.op, ast.Sub):
        yield "operands", ast.BinOp(node.right, node.op, node.left)
    for side in ("left", "right"):
        if _number(getattr(node, side)):
            yield "constant", _changed(node, side, _one_more(getattr(node, side)))


def _comparison(node: ast.Compare) -> Iterator[tuple[str, ast.AST]]:
    for number, op in enumerate(node.ops):
        swapped = _SWAPPED.get(type(op))
        if swapped is None:  # is, in
            continue
        yield "comparison", _changed(node, "ops", [*node.ops[:number], swapped(), *node.ops[number + 1 :]])
        if _number(node.comparators[number]):
            right = [*node.comparators]
            right[number] = _one_more(right[number])
            yield "constant", _changed(node, "comparators", right)


def _whole_constant(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) is int


def _places(index: ast.expr, names: bool) -> Iterator[tuple[ast.expr, bool]]:
    """Expressions of an index that are numbers, and whether it is the upper bound of a slice; ``names``: names too."""
    if isinstance(index, ast.Tuple):
        for item in index.elts:
            yield from _places(item, names)
    elif isinstance(index, ast.Slice):
        if index.lower is not None:
            yield index.lower, False
        if index.upper is not None:
            yield index.upper, True
    elif isinstance(index, ast.BinOp | ast.Name if names else ast.BinOp) or _whole_constant(index):
        yield index, False


def _indices(node: ast.Subscript, kernels: bool) -> Iterator[tuple[ast.expr, ast.AST]]:
    """One more and one less; no longer slices of kernels, which read their elements by number: nothing would change."""
    for place, upper in _places(node.slice, kernels):
        for op in (ast.Sub(),) if kernels and upper else (ast.Add(), ast.Sub()):
            yield place, ast.BinOp(place, op, ast.Constant(1))


def sites(source: str, file: str) -> list[list[Mutant]]:
    """Mutants of a source file, those of one expression together.

    source : the text. file : its path below the package.
    """
    kernels = "@kernel" in source or "@entry" in source or "@ordered_kernel" in source
    result: list[list[Mutant]] = []

    def mutant(function: str, kind: str, old: ast.expr | ast.stmt, new: ast.AST) -> Mutant:
        end = (old.end_lineno or 0, old.end_col_offset or 0)
        return Mutant(file, function, kind, ast.unparse(old), ast.unparse(new), old.lineno, old.col_offset, end)

    for function, node in _expressions(ast.parse(source)):
        found: list[Mutant] = []
        if isinstance(node, ast.BinOp):
            found = [mutant(function, kind, node, new) for kind, new in _operation(node, kernels)]
        elif isinstance(node, ast.Compare):
            found = [mutant(function, kind, node, new) for kind, new in _comparison(node)]
        elif isinstance(node, ast.AugAssign) and type(node.op) in _SWAPPED:
            found = [mutant(function, "arithmetic", node, _changed(node, "op", _SWAPPED[type(node.op)]()))]
        elif isinstance(node, ast.Subscript):
            found = [mutant(function, "index", old, new) for old, new in _indices(node, kernels)]
        if found:
            result.append(found)
    return result


@cache
def all_sites(package: Path) -> list[list[Mutant]]:
    """Sites of every module in ``FOLDERS``."""
    files = [path for folder in FOLDERS for path in sorted((package / folder).glob("*.py"))]
    return [
        site for path in files for site in sites(path.read_text(encoding="utf-8"), path.relative_to(package).as_posix())
    ]


def drawn(package: Path, seed: int) -> Iterator[Mutant]:
    """Mutants of different lines, one after the other: sites drawn without preference, then one change of each.

    The order is that of a digest of seed, file, function and expression. A change of the sources therefore moves only
    the mutants of the expressions that it changes; line numbers do not count.
    """
    times: Counter[tuple[str, ...]] = Counter()
    ranked: list[tuple[bytes, Mutant]] = []
    for site in all_sites(package):
        of = site[0].file, site[0].function, *(f"{mutant.before} {mutant.after}" for mutant in site)
        times[of] += 1  # the same expression may stand in a function more than once
        digest = hashlib.sha256("\n".join([str(seed), str(times[of]), *of]).encode()).digest()
        ranked.append((digest, site[digest[-1] % len(site)]))
    lines: set[tuple[str, int]] = set()
    for _, mutant in sorted(ranked, key=lambda pair: pair[0]):
        if (mutant.file, mutant.line) not in lines:
            lines.add((mutant.file, mutant.line))
            yield mutant
