"""Arrays without reference counts.

A compiled call that takes a tuple of twenty arrays counts each of them up and down. The coder of
walks makes many such calls for each knot, so its entry point drops the counts once.
"""

from __future__ import annotations

from typing import Any, cast

import numba
from numba.core import cgutils, types
from numba.extending import intrinsic

__all__ = ["without_refcount"]


def _drop_refcount(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return an array's structure without its ``meminfo``, which holds the count."""
    if not isinstance(kind, types.Array):
        return value
    array = context.make_array(kind)(context, builder, value=value)
    array.meminfo = cgutils.get_null_value(array.meminfo.type)
    return array._getvalue()


@intrinsic
def without_refcount(_typing: Any, arrays: Any) -> Any:
    """Return a named tuple of the same arrays, for kernels only; it doesn't keep them alive.

    Only arguments of a kernel may be taken: the caller holds them until the kernel returns.
    """

    def build(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        members = zip(arrays, cgutils.unpack_tuple(builder, arguments[0]), strict=True)
        return context.make_tuple(
            builder,
            arrays,
            [_drop_refcount(context, builder, kind, value) for kind, value in members],
        )

    return arrays(arrays), build


if numba.config.DISABLE_JIT:
    # The interpreter has no such arrays, and knows no intrinsics.
    without_refcount = cast(Any, lambda arrays: arrays)
