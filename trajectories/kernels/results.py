"""Python objects of what a kernel returns to Python.

Own code, because numba finds the class of each array and named tuple by its pickle again, and makes a named tuple by
its constructor in Python: together 0.6 us for each of some hundred in a frame of a tracker.
"""

from typing import Any, cast

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.callwrapper import PyCallWrapper
from numba.core.lowering import Lower
from numba.core.pythonapi import PythonAPI
from numba.np.numpy_support import as_dtype


class Objects(cast(Any, PythonAPI)):  # type: ignore[misc]
    """numba's interface to Python, with the classes of what is returned among the constants of the kernel."""

    def from_native_value(self, typ: Any, val: Any, env_manager: Any = None) -> Any:
        """The Python object of a value; a reference to an array that it holds goes over to the object."""
        if isinstance(typ, types.BaseNamedTuple):
            return self._named_tuple(typ, val, env_manager)
        if type(typ) is types.Array and self.context.enable_nrt:
            return self._array(typ, val, env_manager)
        return super().from_native_value(typ, val, env_manager)

    def _named_tuple(self, typ: Any, val: Any, constants: Any) -> Any:
        size = ir.IntType(64)
        call = ir.FunctionType(self.pyobj, [self.pyobj, size])
        make = self._get_function(call, name="PyType_GenericAlloc")
        made = self.builder.call(make, [_constant(typ.instance_class, constants), ir.Constant(size, len(typ))])
        for i, field in enumerate(typ):
            value = self.from_native_value(field, self.builder.extract_value(val, i), constants)
            self.tuple_setitem(made, i, value)
        return made

    def _array(self, typ: Any, val: Any, constants: Any) -> Any:
        number = ir.IntType(32)
        call = ir.FunctionType(self.pyobj, [self.voidptr, self.pyobj, number, number, self.pyobj])
        make = self._get_function(call, name="NRT_adapt_ndarray_to_python_acqref")
        place = self.builder.bitcast(cast(Any, cgutils).alloca_once_value(self.builder, val), self.voidptr)
        shape = [ir.Constant(number, typ.ndim), ir.Constant(number, int(typ.mutable))]
        made = self.builder.call(
            make, [place, _constant(typ.box_type, constants), *shape, _constant(as_dtype(typ.dtype), constants)]
        )
        self.context.nrt.decref(self.builder, typ, val)
        return made


def _constant(value: Any, constants: Any) -> Any:
    return constants.read_const(constants.add_const(value))


class Wrapper(cast(Any, PyCallWrapper)):  # type: ignore[misc]
    """What Python calls: it unpacks the arguments, calls the kernel, and makes objects of what that returns."""

    def build_wrapper(self, api: Any, builder: Any, *arguments: Any) -> None:
        """Write it."""
        super().build_wrapper(Objects(self.context, builder), builder, *arguments)


class FromPython(Lower):
    """Machine code with such a wrapper."""

    def create_cpython_wrapper(self, release_gil: bool = False) -> None:
        """Create it in a module of its own, as numba does."""
        this = cast(Any, self)
        module = this.context.create_module("wrapper")
        form = this.context.call_conv.get_function_type(this.fndesc.restype, this.fndesc.argtypes)
        callee = ir.Function(module, form, this.fndesc.llvm_func_name)
        Wrapper(this.context, module, callee, this.fndesc, this.env, this.call_helper, release_gil).build()
        this.library.add_ir_module(module)
