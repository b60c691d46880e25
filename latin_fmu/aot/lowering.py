"""Kernels to LLVM code by numba's front end, joined, optimised and emitted as one object file.

numba optimises and loads a kernel at every level of calls. Here its code generator is replaced, in the process of a
build only, by one that keeps the code of each kernel as it is. All of them are joined, optimised once, and emitted as
an object file for a target.

numba counts the references to an array, and the count at zero frees it. A function that neither makes an array nor is
given one by a function that it calls holds references of its callers alone. These outlast the call, and what it adds to
counts it takes off again: it counts nothing here. A third of the machine code were tests of null pointers for that.

Kernels count indices from the first entry of an array and take slices of what is there, without a step. numba's code
for indices from the end, and for slices beyond the ends, is left out: in loops over some ten numbers it costs as much
as they do, and it keeps others from being vectorised.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import llvmlite.binding as llvm
import numba
from llvmlite import ir
from numba import types
from numba.core import codegen
from numba.core.itanium_mangler import mangle
from numba.core.registry import cpu_target
from numba.core.runtime.nrtdynmod import compile_nrt_functions
from numba.cpython import slicing
from numba.np.arrayobj import make_array, populate_array
from numba.np.numpy_support import from_dtype

from ..compiled.declare import Argument, Block, Bundle, Entry, Scalar, Signature
from .dispatchers import Dispatchers
from .linking import Target

_ENVIRONMENT: Final = "_ZN08NumbaEnv"
_NUMBERS: Final = {"i8": types.int64, "f8": types.float64, "b1": types.boolean, "f4": types.float32}
_WORD, _STATUS = ir.IntType(64), ir.IntType(32)
_GROUP: Final = 24  # modules, of five hundred
_COUNTS: Final = ("NRT_incref", "NRT_decref")


class _Library(codegen.JITCodeLibrary):
    """The code of one kernel, neither optimised nor loaded."""

    def add_ir_module(self, ir_module: Any) -> None:
        if not _gives_arrays(ir_module):
            _leave_out_counts(ir_module)
        super().add_ir_module(ir_module)

    def add_llvm_module(self, ll_module: Any) -> None:
        self._final_module.link_in(ll_module)

    def finalize(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        return 1  # numba requires an address to make a Python function of; it is never called

    @property
    def has_dynamic_globals(self) -> bool:
        return False

    def collect(self, libraries: dict[int, _Library]) -> None:
        """Add this one and those it calls to the known ones, by their identity."""
        if id(self) in libraries:  # a kernel is reached over as many ways as there are chains of calls to it
            return
        libraries[id(self)] = self
        for other in self._linking_libraries:
            if isinstance(other, _Library):  # numba's run time of this process is another
                other.collect(libraries)

    @property
    def code(self) -> Any:
        """LLVM module of this function."""
        return self._final_module


class _Codegen(codegen.JITCPUCodegen):
    """Code generator of a process that builds a library."""

    _library_class = _Library

    def _add_module(self, module: Any) -> None:
        pass

    def set_env(self, env_name: str, env: Any) -> None:
        pass


class _Declaration:
    """``declare_function`` of numba's context, which marks functions whose result holds counted memory."""

    def __init__(self, context: Any) -> None:
        self._of_numba, self._models = context.declare_function, context.data_model_manager

    def __call__(self, module: Any, description: Any) -> Any:
        function = self._of_numba(module, description)
        if isinstance(description.restype, types.Generator):  # numba does not free what one holds between its calls
            raise TypeError(f"{description.qualname} yields; a kernel returns, or fills an array that it is given")
        function.gives_array = self._models[description.restype].contains_nrt_meminfo()
        return function


def _short_name(name: str, _arguments: Any, *, uid: int, **_tags: Any) -> str:
    """Name of a version of a kernel: by a number, not by the types of its arguments, a kilobyte for each record."""
    return str(mangle(name, (), uid=uid))


def _gives_arrays(module: Any) -> bool:
    """Whether a function of a module, or one that it calls, returns memory: an array, or a pointer of numba's run time.
    A call by a pointer may do so."""
    for function in module.functions:
        if getattr(function, "gives_array", False) or isinstance(function.return_value.type, ir.PointerType):
            return True
    return any(not isinstance(call.callee, ir.Function) for block in _blocks(module) for call in _calls(block))


def _leave_out_counts(module: Any) -> None:
    for block in _blocks(module):
        counts = {id(call) for call in _calls(block) if call.callee.name in _COUNTS}
        block.instructions = [item for item in block.instructions if id(item) not in counts]


def _blocks(module: Any) -> Iterator[Any]:
    return (block for function in module.functions for block in function.blocks)


def _calls(block: Any) -> Iterator[Any]:
    return (item for item in block.instructions if isinstance(item, ir.CallInstr))


def _from_the_first(_builder: Any, index: Any, _size: Any) -> Any:
    """An index as it is (``slicing.fix_index``)."""
    return index


def _up_to_the_end(builder: Any, part: Any, size: Any) -> None:
    """A slice up to the end of the array where it has no end of its own (``slicing.fix_slice``)."""
    part.stop = builder.select(builder.icmp_signed("<", part.stop, size), part.stop, size)


def _without_step(_context: Any, _builder: Any, kind: Any, _part: Any) -> None:
    """Refuse slices with a step (``slicing.guard_invalid_slice``)."""
    if kind.has_step:
        raise TypeError("a kernel takes a slice with a step; index its entries instead")


@dataclass(frozen=True)
class FrontEnd:
    """numba in a process that builds a library.

    Attributes
    ----------
    context : its target context. dispatchers : what it makes of the kernels.
    """

    context: Any
    dispatchers: Dispatchers


def start() -> FrontEnd:
    """Replace numba's code generator in this process, its rules of indices and of counts, and its names."""
    slicing.fix_index, slicing.fix_slice = _from_the_first, _up_to_the_end
    slicing.guard_invalid_slice = _without_step
    context = cpu_target.target_context
    context._internal_codegen = _Codegen("latin_fmu")
    context.declare_function, context.mangler = _Declaration(context), _short_name
    return FrontEnd(context, Dispatchers())


def numba_type(argument: Argument) -> Any:
    """numba's type of a declared argument."""
    if isinstance(argument, Scalar):
        return _NUMBERS[argument.code]
    if isinstance(argument, Block):
        return types.Array(from_dtype(argument.dtype), argument.ndim, "C")
    assert isinstance(argument, Bundle)
    return types.BaseTuple.from_types([numba_type(a) for a in argument.fields], argument.cls)


def lower(front: FrontEnd, declared: Iterable[Entry]) -> tuple[list[Any], list[str]]:
    """LLVM modules of the entries and of all that they call, and the names to export."""
    context = front.context
    libraries: dict[int, _Library] = {}
    wrappers, exported = [], []
    for item in declared:
        dispatcher = front.dispatchers.of(item)
        for number, signature in enumerate(item.signatures):
            symbol = f"{item.symbol}_{number}"
            arguments = tuple(numba_type(a) for a in signature.arguments)
            dispatcher.compile(arguments)
            result = dispatcher.overloads[arguments]
            result.library.collect(libraries)
            wrappers.append(_entry_wrapper(context, symbol, signature, result))
            exported.append(symbol)
    if not any(library.name == "nrt" for library in libraries.values()):
        # 0 is no identity of an object
        libraries[0] = compile_nrt_functions(context)
    return [*(library.code for library in libraries.values()), *wrappers], exported


def _callee(context: Any, module: ir.Module, result: Any) -> Any:
    """Declaration of a kernel in another module."""
    function = context.call_conv.get_function_type(result.fndesc.restype, result.fndesc.argtypes)
    return ir.Function(module, function, result.fndesc.llvm_func_name)


def _entry_wrapper(context: Any, symbol: str, signature: Signature, result: Any) -> Any:
    """``int32 symbol(const int64 *slots, void *result)``: arguments from their slots, the status back."""
    module = context.create_module(symbol)
    function = ir.Function(module, ir.FunctionType(_STATUS, [_WORD.as_pointer(), _WORD.as_pointer()]), symbol)
    builder = ir.IRBuilder(function.append_basic_block("entry"))
    slots = _Slots(context, builder, function.args[0])
    values = [slots.value(a) for a in signature.arguments]
    callee = _callee(context, module, result)
    status, out = context.call_conv.call_function(
        builder, callee, result.fndesc.restype, result.fndesc.argtypes, values
    )
    if signature.result is not None:
        declared = _NUMBERS[signature.result]
        out = context.cast(builder, out, result.signature.return_type, declared)
        if signature.result == "b1":
            # one byte, as ctypes reads it
            out = builder.zext(out, ir.IntType(8))
        builder.store(out, builder.bitcast(function.args[1], out.type.as_pointer()))
    elif result.signature.return_type != types.none:
        raise TypeError(f"{symbol} returns {result.signature.return_type}; declared: nothing")
    builder.ret(status.code)
    return llvm.parse_assembly(str(module))


class _Slots:
    """Arguments of a kernel from the 8-byte slots of a call (see ``compiled.declare``)."""

    def __init__(self, context: Any, builder: Any, slots: Any) -> None:
        self._context = context
        self._builder = builder
        self._slots = slots
        self._next = 0

    def _word(self) -> Any:
        place = self._builder.gep(self._slots, [ir.Constant(_WORD, self._next)])
        self._next += 1
        return self._builder.load(place)

    def value(self, argument: Argument) -> Any:
        """The next argument."""
        if isinstance(argument, Scalar):
            return self._number(argument.code, self._word())
        if isinstance(argument, Block):
            return self._array(argument)
        assert isinstance(argument, Bundle)
        fields = [self.value(field) for field in argument.fields]
        return self._context.make_tuple(self._builder, numba_type(argument), fields)

    def _number(self, code: str, word: Any) -> Any:
        if code == "i8":
            return word
        if code == "b1":
            return self._builder.trunc(word, ir.IntType(1))
        number = self._builder.bitcast(word, ir.DoubleType())
        return number if code == "f8" else self._builder.fptrunc(number, ir.FloatType())

    def _array(self, argument: Block) -> Any:
        builder, kind = self._builder, numba_type(argument)
        array = make_array(kind)(self._context, builder)
        data = builder.inttoptr(self._word(), array.data.type)
        shape = [self._word() for _ in range(argument.ndim)]
        strides = [ir.Constant(_WORD, argument.dtype.itemsize)]  # C order: the last index moves by one item
        for length in reversed(shape[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        populate_array(array, data, shape, strides, ir.Constant(_WORD, argument.dtype.itemsize), None)
        return array._getvalue()


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
    names, prefixes = set(exported), tuple(shared)
    parts = list(modules)
    for module in parts:
        for function in module.functions:  # several modules hold the same helpers of numba
            if not function.is_declaration and function.name not in names:
                function.linkage = "weak_odr"
    # in groups: LLVM goes through all that is there for each module that it adds
    whole = _linked([_linked(parts[i : i + _GROUP]) for i in range(0, len(parts), _GROUP)])
    for function in whole.functions:  # counts of references are null tests where arrays come from outside
        if function.name in _COUNTS and not function.is_declaration:
            function.add_function_attribute("alwaysinline")
    for item in (*whole.functions, *whole.global_variables):
        if not item.is_declaration and item.name not in names:
            if prefixes and item.name.startswith(prefixes):
                item.add_function_attribute("noinline")
            # numba's pointers to Python's objects: internal ones would be taken for the null that they are here, and
            # a kernel that uses Python would become one that fails
            item.linkage = "linkonce_any" if item.name.startswith(_ENVIRONMENT) else "internal"
    return whole


def _linked(modules: Iterable[Any]) -> Any:
    whole = llvm.parse_assembly("")
    for module in modules:
        whole.link_in(module)
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
    # exceptions keep the names of the files of numba that they come from, pickled, so that texts keep their length: the
    # place of numba on the machine that compiles is nobody else's business
    place = str(Path(numba.__file__).parents[1]).encode()
    return bytes(tm.emit_object(module)).replace(place, b"." * len(place))
