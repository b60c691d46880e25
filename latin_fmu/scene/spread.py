"""Table [spread]: how numbers of the scene scatter, by their dotted names."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final

from pydantic import BeforeValidator

from ..errors import Problem
from .fields import Real, Text, refusal
from .overrides import no_number, number_at
from .raw_scene import number

_PER_CENT: Final = re.compile(r"\s*(\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)\s*%\s*")
_FORM: Final = 'standard deviation > 0, a share of the value such as "5 %", or the ends [low, high] of a range'


def _check_spread(written: Any) -> Any:
    if isinstance(written, str):
        match = _PER_CENT.fullmatch(written)
        fits = match is not None and 0.0 < float(match[1]) < 1e6
    elif isinstance(written, list | tuple):
        numbers = [number({"of": item}, "of") for item in written]
        fits = len(numbers) == 2 and None not in numbers and numbers[0] < numbers[1]  # type: ignore[operator]
    else:
        fits = (number({"of": written}, "of") or 0.0) > 0.0
    if not fits:
        raise refusal("not a spread", value=written, allowed=_FORM)
    if isinstance(written, list | tuple):
        return tuple(map(float, written))
    return written


def flat(written: Any) -> Any:
    """Names with dots, which TOML reads as tables in tables, as one key each."""
    if not isinstance(written, Mapping):
        return written
    values: dict[Any, Any] = {}
    for key, value in written.items():
        inner = flat(value)
        if isinstance(inner, dict):
            values |= {f"{key}.{name}": item for name, item in inner.items()}
        else:
            values[key] = inner
    return values


SpreadValue = Annotated[Real | Text | tuple[Real, Real], BeforeValidator(_check_spread)]
SpreadTable = Annotated[Mapping[Text, SpreadValue], BeforeValidator(flat)]


@dataclass(frozen=True)
class Distribution:
    """Scatter of a number of the scene: normal, or uniform.

    Attributes
    ----------
    value : of the scene. mean, deviation : mean and standard deviation. uniform : whether it is between two ends.
    """

    value: float
    mean: float
    deviation: float
    uniform: bool

    @staticmethod
    def of(value: float, written: float | str | tuple[float, float]) -> "Distribution":
        """That of a number by its ``value`` and the spread that is ``written`` for it."""
        if isinstance(written, tuple):
            low, high = written
            # variance of a uniform distribution: (b - a)^2 / 12
            return Distribution(value, 0.5 * (low + high), (high - low) / 12.0**0.5, True)
        share = None
        if isinstance(written, str):
            share = _PER_CENT.fullmatch(written)
        if share is None:
            return Distribution(value, value, float(written), False)
        return Distribution(value, value, float(share[1]) / 100 * abs(value), False)


def spread_problems(spread: Mapping[str, Any], tables: Mapping[str, Any]) -> Iterator[Problem]:
    """What is wrong with a spread in a scene of these tables."""
    for name, written in spread.items():
        where, value = f"spread.{name}", number_at(tables, name)
        if value is None:
            yield no_number(where, tables, name)
        elif isinstance(written, tuple) and not written[0] <= value <= written[1]:
            ends = f"{written[0]:g} to {written[1]:g}"
            yield Problem(where, "the value of the scene is not in its range", f"{value:g}", ends)
        elif Distribution.of(value, written).deviation == 0.0:
            yield Problem(where, "a share of a value of 0 is 0", str(written), "a standard deviation, or a range")
