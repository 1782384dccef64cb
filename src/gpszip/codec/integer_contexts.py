"""Bit contexts of an integer of any size, in the table of all contexts."""

from __future__ import annotations

__all__ = ["EXPONENT_CONTEXTS", "INTEGER_CONTEXTS", "MAX_EXPONENT", "TREE_NODES"]

#: Largest exponent of an integer, and bits after the leading one that have a context.
MAX_EXPONENT = 47
TREE_NODES = 8

#: Contexts of the exponents: 47, and a spare one.
EXPONENT_CONTEXTS = 48

#: Bit contexts that one integer of any size takes.
INTEGER_CONTEXTS = EXPONENT_CONTEXTS + TREE_NODES * EXPONENT_CONTEXTS
