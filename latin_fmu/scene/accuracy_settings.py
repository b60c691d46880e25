"""Table [accuracy]: the error estimate of a run, and the accuracy wanted."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import AfterValidator

from ..errors import did_you_mean
from .fields import Flag, Real, Table, Text, about, refusal

QUANTITY_KEYS: Final = (
    "impulse",
    "first_contact",
    "separation",
    "peak_force",
    "friction_work",
    "force_history",
    "displacement",
)
"""Kinds of quantities: those of interfaces, and the displacement of sensors."""


def _check_quantity(quantity: str) -> str:
    owner, _, key = quantity.rpartition(".")
    if key not in QUANTITY_KEYS or "." in owner:
        raise refusal(
            "unknown quantity",
            value=quantity,
            allowed=f"one of {', '.join(QUANTITY_KEYS)}, with the name of one interface or sensor before it or not",
            remedy=did_you_mean(key, QUANTITY_KEYS),
        )
    return quantity


Quantity = Annotated[Text, AfterValidator(_check_quantity)]


class Accuracy(Table):
    """Whether `latin-fmu run` estimates its error, and what `--accuracy` aims at."""

    estimate: Annotated[Flag, about("coarse companion runs tell the error of each quantity (`latin-fmu run`)")] = True
    quantity: Annotated[
        Quantity, about('what the target is for: "impulse" (of every interface that may open), "crush.impulse", ...')
    ] = "impulse"
    target: Annotated[
        Real | None, about("relative error wanted; mesh, time step and tolerance are then chosen", "1", gt=0, lt=1)
    ] = None
