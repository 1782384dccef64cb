"""Named tuples of arrays that kernels pass on by a pointer.

Numba passes each number of each array of a tuple as an argument of its own: some 160 for the model
of walks, with as many instructions in each kernel that takes it and at each call. Here the kernel
that Python calls stores the tuple once, and inner kernels take the address. An attribute is read
from there where it is used. Kernels don't write to the tuple, so an address is as good as a copy.
"""

from __future__ import annotations

import hashlib
from typing import Any

from llvmlite import ir as llvm
from numba.core import cgutils, ir, types
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.datamodel import models
from numba.core.imputils import impl_ret_borrowed, lower_cast, lower_getattr_generic
from numba.core.ir_utils import build_definitions, mk_unique_var
from numba.core.typeconv import Conversion
from numba.core.types.containers import BaseNamedTuple
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, register_model

__all__ = ["POINTER", "Reference", "TakeReferences"]

#: An address, as llvmlite knows it; nothing else in compiled code has this type.
POINTER = llvm.LiteralStructType([llvm.IntType(8)]).as_pointer()

#: Bits of a distance between addresses.
_DISTANCE = llvm.IntType(64)

#: Bytes of the digest that tells tuples of one name apart.
_DIGEST_BYTES = 8


class Reference(types.Type):
    """Type of the address of a named tuple.

    Parameters
    ----------
    pointee : numba type
        Type of the tuple.
    """

    def __init__(self, pointee: Any) -> None:
        self.pointee = pointee
        self.offsets: dict[str, int] = {}
        digest = hashlib.blake2b(str(pointee).encode(), digest_size=_DIGEST_BYTES).hexdigest()
        super().__init__(f"Reference({pointee.instance_class.__name__}, {digest})")

    def attribute(self, name: str) -> Any:
        """Type of an attribute; that of a tuple in a tuple is a reference, too."""
        kind = self.pointee.types[self.pointee.fields.index(name)]
        return Reference(kind) if _holds_arrays(kind) else kind

    def offset(self, context: Any, name: str) -> int:
        """Bytes from the beginning of the tuple to an attribute."""
        if name not in self.offsets:
            # Attributes of one type lie in an array, others in a structure.
            layout, target = context.get_value_type(self.pointee), context.target_data
            index = self.pointee.fields.index(name)
            self.offsets[name] = (
                index * layout.element.get_abi_size(target)
                if isinstance(layout, llvm.ArrayType)
                else layout.get_element_offset(target, index)
            )
        return self.offsets[name]

    def can_convert_to(self, _: Any, other: Any) -> Any:
        """Allow a reference where the tuple itself is wanted, as by a pointer to a kernel."""
        return Conversion.safe if other == self.pointee else None


def _holds_arrays(kind: Any) -> bool:
    """Whether a type is that of a named tuple with an array, or with such a tuple."""
    return isinstance(kind, BaseNamedTuple) and any(
        isinstance(member, types.Array) or _holds_arrays(member) for member in kind.types
    )


@register_model(Reference)
class _ReferenceModel(models.PrimitiveModel):  # type: ignore[misc]
    """A reference is an address in compiled code."""

    def __init__(self, manager: Any, kind: Reference) -> None:
        super().__init__(manager, kind, POINTER)


@infer_getattr
class _ReferenceAttributes(AttributeTemplate):  # type: ignore[misc]
    """Types of the attributes of references."""

    key = Reference

    def generic_resolve(self, kind: Reference, name: str) -> Any:
        """Type of an attribute; None if the tuple has none of this name."""
        return kind.attribute(name) if name in kind.pointee.fields else None


@lower_getattr_generic(Reference)
def _read_attribute(context: Any, builder: Any, kind: Reference, value: Any, name: str) -> Any:
    """Read an attribute; of a tuple in a tuple, return the address."""
    # Find the address.
    offset = llvm.Constant(_DISTANCE, kind.offset(context, name))
    first = builder.bitcast(value, llvm.IntType(8).as_pointer())
    address = builder.gep(first, [offset], inbounds=True)

    # Read what stands there.
    attribute = kind.attribute(name)
    if isinstance(attribute, Reference):
        return builder.bitcast(address, POINTER)
    place = builder.bitcast(address, context.get_value_type(attribute).as_pointer())
    return impl_ret_borrowed(context, builder, attribute, builder.load(place))


@lower_cast(Reference, BaseNamedTuple)
def _read_tuple(context: Any, builder: Any, kind: Reference, target: Any, value: Any) -> Any:
    """Read the tuple itself."""
    place = builder.bitcast(value, context.get_value_type(target).as_pointer())
    return impl_ret_borrowed(context, builder, kind.pointee, builder.load(place))


@intrinsic
def _refer_to(_typing: Any, whole: Any) -> Any:
    """Store a tuple, and return its address, which holds until the kernel returns."""

    def build(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.bitcast(cgutils.alloca_once_value(builder, arguments[0]), POINTER)

    return Reference(whole)(whole), build


@register_pass(mutates_CFG=False, analysis_only=False)
class TakeReferences(FunctionPass):  # type: ignore[misc]
    """A step of numba's compiler: use references to the tuples that Python hands to a kernel."""

    _name = "take_references"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Follow each argument that is a tuple of arrays by a reference to it."""
        block = state.func_ir.blocks[min(state.func_ir.blocks)]
        body: list[Any] = []
        for statement in block.body:
            if _takes_tuple(statement, state.args):
                body += _refer(statement)
            else:
                body.append(statement)
        if len(body) == len(block.body):
            return False

        # Let the compiler know the new variables.
        block.body = body
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        return True


def _takes_tuple(statement: Any, kinds: Any) -> bool:
    """Whether a statement takes an argument that is a tuple of arrays."""
    value = getattr(statement, "value", None)
    return isinstance(value, ir.Arg) and _holds_arrays(kinds[value.index])


def _refer(statement: Any) -> list[Any]:
    """Statements that take an argument, and assign a reference to it in its place."""
    target, where = statement.target, statement.loc
    whole = target.scope.define(mk_unique_var("whole"), where)
    function = target.scope.define(mk_unique_var("refer_to"), where)
    return [
        ir.Assign(statement.value, whole, where),
        ir.Assign(ir.Global("_refer_to", _refer_to, where), function, where),
        ir.Assign(ir.Expr.call(function, (whole,), (), where), target, where),
    ]
