"""Options of the command line, from the signatures of the commands: each is declared once, as a parameter.

A command is a function below ``command``. Its docstring is the help, a parameter with ``Option`` or ``Argument`` in its
annotation is what a user can give, and the default of the parameter is that of the option::

    @command()
    def greet(name: Annotated[str, Argument("whom")], loud: Annotated[bool, Option("in capitals")] = False) -> int:
        "Greet someone."

==================================  ===========================================================
type of the parameter               on the command line
==================================  ===========================================================
``bool``                            a switch, ``--no-NAME`` where its default is True
``Literal["a", "b"]``               one of these
``tuple[T, ...]``                   an option that may be repeated; one argument or several
``tuple[T, T]``                     an option with two values
``str``, ``int``, ``float``, Path   a value, which must be one of this type
any other                           a value that ``Option.read`` makes
``T | None``                        as ``T``
a dataclass without ``Option``      the options of its fields; the command takes them together
``Annotated[T, FROM_CALLER]``       none: the caller gives it
==================================  ===========================================================

What is not given is not handed on, so that defaults stand in signatures alone. An option that goes to a public function
of the package under its own name needs no text: its sentence and its default are those of the function
(``command(feeds=...)``, ``handed``), read from the source, which costs nothing where no help is printed.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from importlib import import_module
from keyword import iskeyword
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin, get_type_hints

AddParser = Callable[..., "CommandParser"]
"""``add_parser`` of the subcommands of a parser."""

FROM_CALLER: Final = "from the caller"
"""In the annotation of a parameter that is no option."""

_PLAIN: Final = (str, int, float, Path)
_NAMED: Final = re.compile(r"(?:^|(?<=[.;] ))([A-Za-z_][\w, ]*?) : ")
_OF_NONE: Final = re.compile(r"; None(?::| for) (.*)$")  # what a docstring says of the default None
_MISSING: Final = inspect.Parameter.empty


@dataclass(frozen=True)
class Option:
    """What is said of a parameter that is an option.

    Attributes
    ----------
    text : sentence of the help; the default is added where it names none. Empty: that of the function that is fed.
    metavar : name of the value in the help. flags : short form, as in "-o", or another name than that of the parameter,
        as in "--from". read : makes the value from its text; argparse.ArgumentTypeError where it cannot.
    const : the value where the option is given without one.
    """

    text: str = ""
    metavar: str | tuple[str, ...] | None = None
    flags: str = ""
    read: Callable[[str], Any] | None = None
    const: Any = None


class Argument(Option):
    """What is said of a parameter that is given without a name, by its place."""


@dataclass(frozen=True)
class _Declared:
    """A parameter of a command.

    Attributes
    ----------
    name : in the signature. kind : type, without None. option : what is said of it; None of a group, and of what the
        caller gives. default : ``_MISSING`` where it has none.
    """

    name: str
    kind: Any
    option: Option | None
    default: Any

    @property
    def group(self) -> bool:
        """Whether it stands for the options of a dataclass."""
        return self.option is None and is_dataclass(self.kind)

    def names(self) -> list[str]:
        """Flags of the option, or the name of the argument."""
        assert self.option is not None
        if isinstance(self.option, Argument):
            return [self.name]
        flags = self.option.flags.split()
        if any(flag.startswith("--") for flag in flags):
            return flags
        return [*flags, f"--{'no-' * (self.default is True)}{self.name.replace('_', '-')}"]

    def keywords(self) -> dict[str, Any]:
        """Keywords of ``add_argument`` but for the help.

        Raises
        ------
        TypeError : a type that nothing reads.
        """
        assert self.option is not None
        by_place, optional = isinstance(self.option, Argument), self.default is not _MISSING
        # what is not given is not in the result, and the default of the signature holds; plain defaults are there, for
        # checks of the arguments before the command runs
        keywords: dict[str, Any] = {"default": argparse.SUPPRESS}
        if isinstance(self.default, _PLAIN):
            keywords["default"] = self.default
        if not by_place:
            keywords |= {"dest": self.name, "required": not optional}
        if self.kind is bool:
            return keywords | {"action": "store_false" if self.default is True else "store_true"}
        words: tuple[Any, ...] = ()
        if get_origin(self.kind) is tuple:
            words = get_args(self.kind)
        one, *_ = [*words, self.kind]
        if get_origin(one) is Literal:
            keywords["choices"] = get_args(one)
        elif self.option.read is None and one not in _PLAIN:
            raise TypeError(f"parameter {self.name}: nothing reads a {one}; give Option(read=...)")
        else:
            keywords["type"] = self.option.read or one
        if self.option.metavar is not None:
            keywords["metavar"] = self.option.metavar
        if words and words[-1] is not Ellipsis:
            return keywords | {"nargs": len(words)}
        if words:
            return keywords | ({"nargs": "+"} if by_place else {"action": "append"})
        if by_place and optional:
            return keywords | {"nargs": "?", "default": self.default}
        if self.option.const is None:
            return keywords
        return keywords | {"nargs": "?", "const": self.option.const}

    def value(self, arguments: Mapping[str, Any]) -> Any:
        """The value of the parameter from the ``arguments`` of the command line."""
        if self.group:
            return self.kind(**_values(self.kind, arguments))
        value = arguments[self.name]
        if get_origin(self.kind) is tuple:
            return tuple(value)
        return value


def _declared(of: Callable[..., Any]) -> Iterator[_Declared]:
    """Parameters of a function, or fields of a dataclass.

    Raises
    ------
    TypeError : a parameter of which nothing is said.
    """
    kinds = get_type_hints(of, include_extras=True)
    for name, parameter in inspect.signature(of).parameters.items():
        kind: Any = kinds.get(name)
        said: tuple[Any, ...] = ()
        if get_origin(kind) is Annotated:
            said = kind.__metadata__
            kind = kind.__origin__
        if get_origin(kind) in (Union, UnionType):
            kind = next(one for one in get_args(kind) if one is not type(None))
        option = next((one for one in said if isinstance(one, Option)), None)
        if option is None and FROM_CALLER not in said and not is_dataclass(kind):
            raise TypeError(f"{of.__name__}: nothing is said of the parameter {name}; annotate it with Option(text)")
        yield _Declared(name, kind, option, parameter.default)


def _values(of: Callable[..., Any], arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of a function or dataclass from what was given on the command line."""
    return {one.name: one.value(arguments) for one in _declared(of) if one.group or one.name in arguments}


class CommandParser(argparse.ArgumentParser):
    """Parser of a command: sentences of its options that stand elsewhere are looked up when its help is printed."""

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self._feeds: tuple[str, ...] = ()
        self._borrowers: list[tuple[argparse.Action, _Declared]] = []

    def declare(self, of: Callable[..., Any], feeds: tuple[str, ...]) -> None:
        """Declare the parameters of a function or dataclass that feeds these functions of the package.

        Raises
        ------
        TypeError : a parameter without a sentence.
        """
        self._feeds = feeds
        for one in _declared(of):
            if one.group:
                self.declare(one.kind, feeds)
            elif one.option is not None:
                if not one.option.text and not feeds:
                    raise TypeError(f"{of.__name__}: the parameter {one.name} has no sentence; give Option(text)")
                action = self.add_argument(*one.names(), help=_help(one.option.text, one.default), **one.keywords())
                if feeds and (not one.option.text or one.default is None):
                    self._borrowers.append((action, one))

    def format_help(self) -> str:
        """The help.

        Raises
        ------
        TypeError : a parameter without a sentence, in the docstring of the function that it goes to neither.
        """
        documentation = []
        if self._borrowers:
            documentation = [documented(name) for name in self._feeds]
        for action, one in self._borrowers:
            assert one.option is not None
            sentence, default = next((found[one.name] for found in documentation if one.name in found), ("", None))
            if not (one.option.text or sentence):
                raise TypeError(f"the parameter {one.name} has no sentence, in {', '.join(self._feeds)} neither")
            with_default = one.default is not None
            action.help = _help(one.option.text or _said(one.name, sentence), one.default if with_default else default)
        return super().format_help()


def _said(name: str, sentence: str) -> str:
    """A sentence of a docstring about a parameter as one of the help."""
    # it continues the name
    if sentence.startswith("of "):
        whole = f"{name.replace('_', ' ')} {sentence}"
    else:
        whole = sentence
    return _OF_NONE.sub(r" (default: \1)", whole).replace("`", "")


def _help(text: str, default: Any) -> str:
    """A sentence as argparse wants it, with the default where it is a value and the text does not name it."""
    text = text.rstrip(".").replace("%", "%%")
    nothing = default is _MISSING or default is None or isinstance(default, bool) or default in ("", ())
    if not text or nothing or "default" in text.lower():
        return text
    if isinstance(default, float):
        shown = f"{default:g}".replace("e-0", "e-")
    else:
        shown = default
    return f"{text} (default: {shown})"


@dataclass(frozen=True)
class Command:
    """A subcommand: a function whose parameters are its options, and which returns an exit code.

    Attributes
    ----------
    function : what it runs. examples : stand below its help. feeds : public functions of the package that options go to
        under their own names.
    """

    function: Callable[..., int]
    examples: str | None
    feeds: tuple[str, ...]

    def declare(self, add: AddParser) -> None:
        """Declare it with its options; its name and help are those of the function."""
        said = inspect.getdoc(self.function) or ""
        text = " ".join(said.split("\n\n")[0].split())
        formatter = argparse.HelpFormatter
        if self.examples:
            formatter = argparse.RawDescriptionHelpFormatter
        parser = add(
            self.function.__name__.rstrip("_"),
            help=(text[:1].lower() + text[1:]).rstrip("."),
            description=text,
            epilog=self.examples,
            formatter_class=formatter,
        )
        parser.declare(self.function, self.feeds)
        parser.set_defaults(command=self)

    def __call__(self, arguments: argparse.Namespace) -> int:
        """Run it with the arguments that the parser has found."""
        return self.function(**_values(self.function, vars(arguments)))


def function_name(command_name: str) -> str:
    """Name of the function of a command, which ends with _ where that of the command is a word of Python.

    >>> function_name("import"), function_name("run")
    ('import_', 'run')
    """
    return command_name + "_" * iskeyword(command_name)


def command(examples: str | None = None, feeds: tuple[str, ...] = ()) -> Callable[[Callable[..., int]], Command]:
    """Make a function a subcommand; ``examples`` and ``feeds`` as of ``Command``."""
    return lambda function: Command(function, examples, feeds)


def handed(options: object, function: Callable[..., Any]) -> dict[str, Any]:
    """Those of ``options``, a dataclass, that ``function`` has an optional parameter for; those that the user has not
    given (None) are left out, so that the defaults of the function hold."""
    named = [name for name, one in inspect.signature(function).parameters.items() if one.default is not _MISSING]
    return {name: value for name in named if (value := getattr(options, name, None)) is not None}


def documented(function: str) -> dict[str, tuple[str, Any]]:
    """Sentence and default (None without one) of the parameters of a public function of the package that its docstring
    describes; from its source, as importing it loads the solver.

    >>> documented("vibration_modes")["count"]
    ('elastic modes, the lowest ones; rigid motions come in addition', 10)
    """
    package = import_module("..", __package__)
    source = Path(str(package.__file__)).parent.joinpath(*package._MODULES[function].split(".")).with_suffix(".py")
    tree = ast.parse(source.read_text(encoding="utf-8"))
    node = next(one for one in tree.body if isinstance(one, ast.FunctionDef) and one.name == function)
    places = [*node.args.posonlyargs, *node.args.args]
    expressions = dict(zip([one.arg for one in places][::-1], node.args.defaults[::-1], strict=False))
    expressions |= {a.arg: d for a, d in zip(node.args.kwonlyargs, node.args.kw_defaults, strict=True) if d is not None}
    defaults = {name: ast.literal_eval(default) for name, default in expressions.items()}
    section = (ast.get_docstring(node) or "").partition("Parameters\n----------\n")[2].split("\n\n")[0]
    return {
        name.strip(): (text.rstrip("."), defaults.get(name.strip()))
        for names, text in described(section)
        for name in names.split(",")
    }


def described(paragraph: str) -> list[tuple[str, str]]:
    """Names and what they are, from a paragraph of a docstring; none where it does not begin with a name.

    >>> described("joints : of interfaces that may open. first, last : instants, s.")
    [('joints', 'of interfaces that may open.'), ('first, last', 'instants, s.')]
    """
    text = " ".join(paragraph.replace("``", "`").split())
    found = list(_NAMED.finditer(text))
    if not found or found[0].start() > 0:
        return []
    ends = [match.start() for match in found[1:]] + [len(text)]
    return [(match[1], text[match.end() : end].strip()) for match, end in zip(found, ends, strict=True)]
