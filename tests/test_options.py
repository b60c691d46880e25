"""Options of the command line from the signatures of commands: ``commands.options``, and what the help says."""

from __future__ import annotations

import argparse
import inspect
import re
import subprocess
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_type_hints

import pytest

import latin_fmu
from latin_fmu.cli import COMMANDS, _parser, main
from latin_fmu.commands.options import (
    FROM_CALLER,
    Argument,
    Command,
    CommandParser,
    Option,
    command,
    documented,
    function_name,
    handed,
)

EVERY: dict[str, Command] = {
    name: getattr(import_module(f"latin_fmu.commands.{module}"), function_name(name))
    for name, module in COMMANDS.items()
}
HELPS: dict[str, CommandParser] = next(
    action.choices for action in _parser([])._actions if isinstance(action, argparse._SubParsersAction)
)


def parser_of(made: Command) -> CommandParser:
    """The parser of a command alone."""
    add = argparse.ArgumentParser(prog="p").add_subparsers(parser_class=CommandParser).add_parser
    made.declare(add)
    return add.__self__.choices[made.function.__name__]


def run(made: Command, *words: str, **more: Any) -> int:
    """Exit code of a command with these words."""
    return made(parser_of(made).parse_args(words, argparse.Namespace(**more)))


def test_an_option_is_one_parameter() -> None:
    """Nothing else is written: its name, default, type, sentence and value come from there."""

    @command()
    def greet(
        name: Annotated[str, Argument("whom to greet", "NAME")], times: Annotated[int, Option("how often", "N")] = 3
    ) -> int:
        """Greet someone."""
        said.append((name, times))
        return 7

    said: list[tuple[str, int]] = []
    assert run(greet, "Ada") == run(greet, "Ada", "--times", "2") == 7
    assert said == [("Ada", 3), ("Ada", 2)]
    text = parser_of(greet).format_help()
    assert "Greet someone." in text
    assert re.search(r"NAME\s+whom to greet\n", text)
    assert re.search(r"--times N\s+how often \(default: 3\)\n", text)


def even(text: str) -> int:
    """An even number."""
    if int(text) % 2:
        raise argparse.ArgumentTypeError(f"{text!r} is odd; for example 2")
    return int(text)


@pytest.mark.parametrize(
    ("option", "value", "told"),
    [
        ("--many", "3", "'3' is odd; for example 2"),
        ("--axis", "z", "invalid choice: 'z' (choose from"),
        ("--size", "a", "invalid float value: 'a'"),
    ],
)
def test_a_bad_value_is_told_with_its_option(
    option: str, value: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    @command()
    def take(
        many: Annotated[int, Option("an even number", read=even)] = 2,
        axis: Annotated[Literal["x", "y"], Option("an axis")] = "x",
        size: Annotated[float, Option("a number")] = 1.0,
    ) -> int:
        """Take values."""
        return pytest.fail(f"ran with {many}, {axis}, {size}")

    with pytest.raises(SystemExit):
        run(take, option, value)
    assert f"argument {option}: {told}" in capsys.readouterr().err


@dataclass(frozen=True, kw_only=True)
class Given:
    """Options of each type of the table in ``commands.options``."""

    files: Annotated[tuple[Path, ...], Argument("files")]
    needed: Annotated[float, Option("a number")]
    switch: Annotated[bool, Option("a switch", flags="-s")] = False
    estimate: Annotated[bool, Option("no estimate")] = True
    axis: Annotated[Literal["x", "y"] | None, Option("an axis")] = None
    first: Annotated[float | None, Option("the first", flags="--from")] = None
    names: Annotated[tuple[str, ...], Option("names", "NAME")] = ()
    units: Annotated[tuple[str, str], Option("units", ("LENGTH", "RATIO"))] = ("m", "1")
    size: Annotated[int | None, Option("a size", const=0)] = None


def test_types_of_parameters() -> None:
    @command()
    def take(given: Given, said: Annotated[list[Any], FROM_CALLER]) -> int:
        """Take options."""
        said.append(given)
        return 0

    said: list[Given] = []
    run(take, "a", "b", "--needed", "1.5", said=said)
    run(
        take,
        *("a", "--needed", "2", "-s", "--no-estimate", "--axis", "y", "--from", "1", "--names", "n", "--names", "m"),
        *("--units", "um", "%", "--size"),
        said=said,
    )
    assert said[0] == Given(files=(Path("a"), Path("b")), needed=1.5)
    assert said[1] == Given(
        files=(Path("a"),),
        needed=2.0,
        switch=True,
        estimate=False,
        axis="y",
        first=1.0,
        names=("n", "m"),
        units=("um", "%"),
        size=0,
    )
    with pytest.raises(SystemExit):  # a required option
        run(take, "a", said=said)


def test_a_parameter_without_a_sentence_is_refused() -> None:
    @command()
    def bare(count: int = 3) -> int:
        """Count."""
        return count

    @command()
    def empty(count: Annotated[int, Option(metavar="N")] = 3) -> int:
        """Count."""
        return count

    @command(feeds=("vibration_modes",))
    def unknown(amount: Annotated[int | None, Option(metavar="N")] = None) -> int:
        """Count."""
        return amount or 0

    @command()
    def unreadable(count: Annotated[complex, Option("a number")] = 0j) -> int:
        """Count."""
        return int(count.real)

    with pytest.raises(TypeError, match="bare: nothing is said of the parameter count"):
        parser_of(bare)
    with pytest.raises(TypeError, match="empty: the parameter count has no sentence"):
        parser_of(empty)
    with pytest.raises(TypeError, match="amount has no sentence, in vibration_modes neither"):
        parser_of(unknown).format_help()
    with pytest.raises(TypeError, match="count: nothing reads a <class 'complex'>"):
        parser_of(unreadable)


def test_sentence_and_default_are_those_of_the_function_that_is_fed() -> None:
    @command(feeds=("vibration_modes",))
    def shapes(count: Annotated[int | None, Option(metavar="N")] = None) -> int:
        """Count."""
        return count or 0

    text = " ".join(parser_of(shapes).format_help().split())
    assert "--count N elastic modes, the lowest ones; rigid motions come in addition (default: 10)" in text


@pytest.mark.parametrize("name", sorted({name for made in EVERY.values() for name in made.feeds}))
def test_what_is_read_from_a_source_is_the_function(name: str) -> None:
    """Defaults of all that its docstring describes; without those that it needs."""
    parameters, found = inspect.signature(getattr(latin_fmu, name)).parameters, documented(name)
    assert found.keys() <= parameters.keys()
    for parameter, (sentence, default) in found.items():
        real = parameters[parameter].default
        assert sentence
        assert default == (None if real is inspect.Parameter.empty else real), parameter


@pytest.mark.parametrize("name", [name for name, made in EVERY.items() if made.feeds])
def test_choices_are_those_of_the_function_that_is_fed(name: str) -> None:
    """A choice that a function does not know, and one that the command line does not offer."""
    fed = [inspect.get_annotations(getattr(latin_fmu, one), eval_str=False) for one in EVERY[name].feeds]
    namespaces = [vars(sys.modules[getattr(latin_fmu, one).__module__]) for one in EVERY[name].feeds]
    wanted = {
        parameter: get_args(namespace[text])
        for annotations, namespace in zip(fed, namespaces, strict=True)
        for parameter, text in annotations.items()
        if getattr(namespace.get(text), "__origin__", None) is Literal
    }
    offered = {action.dest: action.choices for action in HELPS[name]._actions if action.choices}
    assert {key: value for key, value in offered.items() if key in wanted} == wanted
    assert wanted or name in ("sweep", "calibrate", "random")


def test_options_that_were_not_given_are_not_handed_on() -> None:
    def solve(scene: str, count: int = 10, *, kind: str = "direct", other: int = 0) -> tuple[Any, ...]:
        return scene, count, kind, other

    @dataclass(frozen=True)
    class Given:
        scene: str = "a file"
        count: int | None = None
        kind: str | None = "explicit"

    assert handed(Given(), solve) == {"kind": "explicit"}
    assert solve("a scene", **handed(Given(), solve)) == ("a scene", 10, "explicit", 0)


def test_defaults_that_a_help_names_are_those_of_the_code() -> None:
    """Of options that go to what is no public function of the package."""
    from fmu_build.build import build_model_exchange
    from latin_fmu.pictures.result_picture import Window
    from latin_fmu.scene.laws import CsvLaw
    from latin_fmu.scene.sensors import Spectrum

    def named(name: str, option: str) -> str:
        text = " ".join(HELPS[name].format_help().split("\n\noptions:")[1].split())
        return re.search(rf"--{option} [^(]*\([^)]*default: ([\w.]+)\)", text)[1]

    model = inspect.signature(build_model_exchange).parameters
    assert int(named("fmu", "modes")) == model["n_mode"].default
    assert int(named("fmu", "patches")) == model["n_patch"].default
    assert int(named("plot", "frames")) == Window.frames
    assert int(named("srs", "per-octave")) == Spectrum.model_fields["per_octave"].default
    assert float(named("srs", "quality")) == Spectrum.model_fields["quality"].default
    offered = next(action.choices for action in HELPS["srs"]._actions if action.dest == "gaps")
    assert offered == get_args(get_type_hints(CsvLaw)["gaps"])


@pytest.mark.parametrize("name", EVERY)
def test_every_option_of_a_command_has_a_sentence(name: str) -> None:
    HELPS[name].format_help()
    assert EVERY[name].function.__name__ == function_name(name)
    assert all(action.help for action in HELPS[name]._actions)


def test_an_output_by_default_does_not_replace_an_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a.fmu", "out.csv"):
        Path(name).write_text("time\n")
    assert main(["simulate", "a.fmu", "--input", "out.csv"]) == 2
    assert "out.csv: this file is an input, the output would replace it" in capsys.readouterr().err


def test_help_loads_no_library() -> None:
    """It is there at once: signatures are read, and what they feed is not loaded."""
    code = (
        "import sys; from latin_fmu.cli import main; "
        "[main(words) for words in (['--help'], ['frf', '--help'], ['sweep', '--help'])]; "
        "assert not {'numpy', 'pydantic', 'xarray', 'latin_fmu.api'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
