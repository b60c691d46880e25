"""Which effects a scene calls for, what each costs, and what would switch it: nothing else is computed."""

from .effect import Effect
from .explanation import Explanation, explain

__all__ = ["Effect", "Explanation", "explain"]
