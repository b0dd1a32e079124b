"""A compiled kernel as a value of numba code: a function address, called with addresses of arrays.

Numba's first-class functions are looked up twice in Python whenever a loop is called, and an array travels as seven
numbers. ``Kernel`` keeps the address, and where a signature says ``pointer`` an array gives that of its first number.
Kernels raise nothing.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import Signature
from numba.core.typing.templates import signature as call_signature
from numba.extending import NativeValue, intrinsic, lower_builtin, models, register_model, typeof_impl, unbox

from model.kernels.compile import kernel

pointer = types.CPointer(types.float64)
"""In a signature: a C-contiguous array of float64, of which the kernel sees the address only."""


def _is_plain_array(kind: Any) -> bool:
    return isinstance(kind, types.Array) and kind.dtype == types.float64 and kind.layout == "C"


class KernelType(types.Callable):  # type: ignore[misc]
    """Type of kernels of one signature: C functions, or ``of_numba``, functions that numba compiled."""

    def __init__(self, of: Signature, of_numba: bool = False) -> None:
        self.of, self.of_numba = of, of_numba
        super().__init__(name=f"kernel{of}{' of numba' if of_numba else ''}")

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Signature of a call with these arguments: numbers are converted, arrays passed by address."""
        if kws or len(args) != len(self.of.args):
            return None
        pairs = zip(args, self.of.args, strict=True)
        wanted = [given if of == pointer and _is_plain_array(given) else of for given, of in pairs]
        if any(context.can_convert(given, of) is None for given, of in zip(args, wanted, strict=True)):
            return None
        return call_signature(self.of.return_type, *wanted, recvr=self)

    def get_call_signatures(self) -> Any:
        return [self.of], False

    def get_impl_key(self, sig: Any) -> Any:
        return type(self)


@register_model(KernelType)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.IntType(64))


class Kernel:
    """A compiled kernel, its address found once.

    Parameters
    ----------
    address : of a C function
    of : its signature
    owner : what keeps the machine code alive
    of_numba : whether it takes and gives what numba's own functions do
    """

    def __init__(self, address: int, of: Signature, owner: Any, of_numba: bool = False) -> None:
        self.address, self.type, self.owner = address, KernelType(of, of_numba), owner

    def __call__(self, *values: Any) -> Any:
        return _call(self, *values)


def numba_kernel(dispatcher: Any, of: Signature) -> Kernel:
    compiled = dispatcher.get_compile_result(of)
    address = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
    return Kernel(address, of, dispatcher, of_numba=True)


@typeof_impl.register(Kernel)
def _kernel_type(value: Kernel, context: Any) -> KernelType:
    return value.type


@unbox(KernelType)
def _address(kind: KernelType, value: Any, c: Any) -> NativeValue:
    number = c.pyapi.object_getattr_string(value, "address")
    address = c.pyapi.long_as_ulonglong(number)
    c.pyapi.decref(number)
    return NativeValue(address, is_error=cgutils.is_not_null(c.builder, c.pyapi.err_occurred()))


@lower_builtin(KernelType, KernelType, types.VarArg(types.Any))
def _lower_call(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """LLVM value of a call of a kernel by its address; arrays are passed by the address of their first number."""
    of = sig.args[0].of
    given = []
    for kind, of_kind, value in zip(sig.args[1:], of.args, args[1:], strict=True):
        if of_kind == pointer and kind != pointer:
            value = context.make_array(kind)(context, builder, value).data
        given.append(value)
    if sig.args[0].of_numba:
        kind = context.call_conv.get_function_type(of.return_type, of.args)
        callee = builder.inttoptr(args[0], kind.as_pointer())
        _, result = context.call_conv.call_function(builder, callee, of.return_type, of.args, given)
        return result
    function = ir.FunctionType(context.get_value_type(of.return_type), [value.type for value in given])
    return builder.call(builder.inttoptr(args[0], function.as_pointer()), given)


@intrinsic
def pointer_at(typingctx: Any, address: Any) -> Any:
    """The numbers at an address, an integer; what calls the loop keeps them alive."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(pointer))

    return pointer(types.int64), generate


@kernel
def _call(function, *values):
    return function(*values)
