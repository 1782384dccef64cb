"""Arrays without counts of references: a call that takes a tuple of twenty arrays would count each of them up and down."""

from __future__ import annotations

from typing import Any, cast

import numba
from numba.core import cgutils, types
from numba.extending import intrinsic

__all__ = ["without_refcount"]


def _uncounted(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if not isinstance(kind, types.Array):
        return value
    array = context.make_array(kind)(context, builder, value=value)
    array.meminfo = cgutils.get_null_value(array.meminfo.type)
    return array._getvalue()


@intrinsic
def without_refcount(_typing: Any, arrays: Any) -> Any:
    """Return a named tuple of the same arrays, for kernels only; it doesn't keep them alive.

    Only what a kernel was given may be borrowed: whoever gave it holds it until the kernel returns.
    """

    def build(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        parts = zip(arrays, cgutils.unpack_tuple(builder, arguments[0]), strict=True)
        return context.make_tuple(
            builder, arrays, [_uncounted(context, builder, kind, value) for kind, value in parts]
        )

    return arrays(arrays), build


if numba.config.DISABLE_JIT:
    # the interpreter has no such arrays, and knows no intrinsics
    without_refcount = cast(Any, lambda arrays: arrays)
