"""The decorator of compiled kernels, and the list of them all.

Compiled without fast-math and without threads, so that the same input gives the same bytes in every process.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast, overload

import numba
from numba.core.registry import CPUDispatcher

from uavbench.trajectories.kernels.argument_types import argument_types
from uavbench.trajectories.kernels.cache import cache_of

F = TypeVar("F", bound=Callable[..., Any])
OPTIONS = {"nopython": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""No Python objects; division by zero gives inf or nan, as in numpy; no kernel is called from C."""
KERNELS: list["Kernel"] = []
"""Every kernel with declared arguments in the modules that were imported, callees first."""


class Kernel(CPUDispatcher):
    """A kernel that is compiled for the types of its declared arguments alone, whoever calls it first."""

    declared: tuple[Any, ...] = ()
    targetctx: Any
    _cache: Any

    def compile(self, sig: Any) -> Any:
        """Machine code for the declared types, whatever those of a call are; kept on disk."""
        if not self.overloads:
            try:
                for types in self.declared:
                    super().compile(types)
            finally:
                self.disable_compile()
        code: Any = next(iter(self.overloads.values()))
        return code.entry_point

    def load(self) -> bool:
        """Whether the kernel is there: loaded from the disk now, or compiled before."""
        kept = [] if self.overloads else [self._cache.load_overload(types, self.targetctx) for types in self.declared]
        if kept and all(kept):
            for code in kept:
                self.targetctx.insert_user_function(code.entry_point, code.fndesc, [code.library])
                self.add_overload(code)
            self.disable_compile()
        return bool(self.overloads)

    def _compile_for_args(self, *args: Any, **kwargs: Any) -> Any:
        """Called by numba for a call that no machine code is there for."""
        self.compile(None)
        return self  # is called again with the same arguments, which now fit or are refused


@overload
def compiled(arguments: F) -> F: ...


@overload
def compiled(arguments: str, **tuples: Any) -> Callable[[F], F]: ...


def compiled(arguments: Any, **tuples: Any) -> Any:
    """Have a function compiled by numba for `arguments`, with the named tuples among them: see `kernel_types`.

    It is compiled by `warm_up.prepare`, or when it is called first, and kept on disk for the next process. Sums keep
    their order, so a kernel's result is always the same. Without arguments, `@compiled`, a function that only kernels
    call is compiled for what each of them calls it with.
    """
    if not isinstance(arguments, str):
        return _kept(cast(Any, numba).jit(**OPTIONS)(arguments), arguments)

    def decorate(function: F) -> F:
        if cast(Any, numba).config.DISABLE_JIT:
            return function
        kernel = Kernel(function, targetoptions=dict(OPTIONS))
        kernel.declared = argument_types(arguments, tuples)
        KERNELS.append(kernel)
        return cast(F, _kept(kernel, function))

    return decorate


def _kept(kernel: Any, function: Any) -> Any:
    """The kernel, kept on disk; the function itself where numba is switched off."""
    if kernel is not function:
        kernel._cache = cache_of(function)
    return kernel
