"""The decorator of compiled kernels, and their registry.

Compiled without fast-math and without threads, so that the same input gives the same bytes in every process.
"""

from collections.abc import Callable
from functools import cache, cached_property
from threading import RLock
from typing import Any, TypeVar, cast, overload

import numba
from numba.core.compiler_lock import global_compiler_lock
from numba.core.event import trigger_event
from numba.core.registry import CPUDispatcher

from uavbench.trajectories.kernels.argument_types import argument_types
from uavbench.trajectories.kernels.cache import cache_of
from uavbench.trajectories.kernels.pipeline import DeclaredCompiler, InnerCompiler, KernelCompiler

F = TypeVar("F", bound=Callable[..., Any])
OPTIONS = {"nopython": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""No Python objects; division by zero gives inf or nan, as in numpy; no kernel is called from C."""
ONE_AT_A_TIME = RLock()
"""Held while a kernel is loaded or compiled, or sees types for the first time: two threads would both add them."""
KERNELS: list["Kernel"] = []
"""Every kernel with declared arguments in the modules that were imported, callees first."""


class Kernel(CPUDispatcher):
    """A kernel that is compiled for its declared argument types only, regardless of the first call."""

    targetctx: Any
    _cache: Any
    _compiler: Any

    def __init__(
        self, function: Callable[..., Any], declared: tuple[Any, ...], *, inner: bool, allocates: bool
    ) -> None:
        pipeline = InnerCompiler if inner else DeclaredCompiler
        super().__init__(function, targetoptions={**OPTIONS, "_nrt": allocates}, pipeline_class=pipeline)
        self.declared, self.inner, self.allocates = declared, inner, allocates
        self._cache = cache_of(function, inner)
        # What numba may do with a call is read before its types, and then holds: to forbid further forms only after
        # the first call compiled those declared rejected calls that had begun in other threads.
        self._can_compile = inner

    def compile(self, sig: Any) -> Any:
        """Machine code for the declared types, regardless of those of a call; cached on disk."""
        with ONE_AT_A_TIME:
            if not self.load():
                for kernel in callees(self):
                    kernel.compile(None)
                if not self.load():  # it may have lacked but one of these
                    for types in self.declared:
                        self._compile_form(types)
            code: Any = next(iter(self.overloads.values()))
            return code.entry_point

    def load(self) -> bool:
        """Load from the cache; whether the kernel and those that it calls are available now."""
        with ONE_AT_A_TIME:
            if self.overloads:
                return True
            for kernel in callees(self):
                kernel.load()
            kept = [self._cache.load_overload(types, self.targetctx) for types in self.declared]
            if all(kept):
                for code in kept:
                    self.targetctx.insert_user_function(code.entry_point, code.fndesc, [code.library])
                    self.add_overload(code)
            return bool(self.overloads)

    def add_overload(self, code: Any) -> None:
        """Register compiled code for calls from kernels and, unless it is an inner kernel, from Python."""
        if self.inner:
            self.overloads[tuple(code.signature.args)] = code
        else:
            super().add_overload(code)

    @cached_property
    def for_python(self) -> Any:
        """The kernel itself, or an inner one compiled so that Python can call it: for tests and notebooks."""
        return Kernel(self.py_func, self.declared, inner=False, allocates=self.allocates) if self.inner else self

    @cached_property
    def unchecked(self) -> Any:
        """The compiled code; see the function `unchecked`. TypeError for a kernel of several forms."""
        if len(self.declared) != 1:
            raise TypeError(f"{self.py_func.__name__} is compiled for several forms of arguments: call it itself")
        self.for_python.compile(None)
        return next(iter(self.for_python.overloads.values())).entry_point

    def _compile_form(self, types: tuple[Any, ...]) -> None:
        about = {"dispatcher": self, "args": types, "return_type": None}
        with global_compiler_lock, trigger_event("numba:compile", data=about):
            code = self._compiler.compile(types, None)
            self.add_overload(code)
            self._cache.save_overload(types, code)

    def _compile_for_args(self, *args: Any, **kwargs: Any) -> Any:
        """Called by numba for a call of an inner kernel from Python: what it returns is called in its place."""
        return self.for_python

    def _search_new_conversions(self, *args: Any, **kwargs: Any) -> Any:
        """Called by numba for types that no form is known to take: in the first call, and for others than before."""
        self.compile(None)
        with ONE_AT_A_TIME:
            return cast(Any, super())._search_new_conversions(*args, **kwargs)

    def typeof_pyval(self, val: Any) -> Any:
        """Called by numba for an argument of a type not seen before: two threads would number equal types twice."""
        with ONE_AT_A_TIME:
            return super().typeof_pyval(val)


@cache
def callees(kernel: Any) -> tuple[Kernel, ...]:
    """Kernels with declared arguments that a kernel calls, directly or indirectly."""
    function = kernel.py_func
    named = (function.__globals__.get(name) for name in function.__code__.co_names)
    called = (value for value in named if isinstance(value, CPUDispatcher) and value is not kernel)
    return tuple(other for value in called for other in ((value,) if isinstance(value, Kernel) else callees(value)))


@overload
def compiled(arguments: F) -> F: ...


@overload
def compiled(arguments: str, *, inner: bool = False, allocates: bool = True, **tuples: Any) -> Callable[[F], F]: ...


def compiled(arguments: Any, *, inner: bool = False, allocates: bool = True, **tuples: Any) -> Any:
    """Decorator that compiles a function with numba for declared `arguments`: see `argument_types`.

    tuples: the named tuples among the arguments. Compiled by `warm_up.prepare` or on the first call, and cached. Sums
    keep their order, so results are reproducible. `inner`: called by other kernels only, which compiles faster; a
    call from Python compiles it once more. `allocates=False`: it makes no arrays and counts no references to those it
    is given, which takes as long as the rest where small kernels are called for every pixel with tuples of arrays.
    Plain `@compiled` is for a function that only kernels call, compiled for the types of each caller.
    """
    if not isinstance(arguments, str):
        return _for_kernels(arguments)

    def decorate(function: F) -> F:
        if cast(Any, numba).config.DISABLE_JIT:
            return function
        kernel = Kernel(function, argument_types(arguments, tuples), inner=inner, allocates=allocates)
        KERNELS.append(kernel)
        return cast(F, kernel)

    return decorate


def unchecked(kernel: F) -> F:
    """A kernel that does not compare the types of its arguments with those declared, but the sizes of their numbers.

    For each named tuple among the arguments numba's comparison takes 0.6 us, as long as some kernels. Call it so with
    arguments that come from kernels, or from places that make contiguous arrays of the declared types only: others
    would be read as what they are not.
    """
    return kernel.unchecked if isinstance(kernel, Kernel) else kernel


@overload
def inlined(function: F) -> F: ...


@overload
def inlined(*, allocates: bool) -> Callable[[F], F]: ...


def inlined(function: Any = None, *, allocates: bool = True) -> Any:
    """Decorator of a function that only kernels call and that is copied into them, whatever LLVM takes it to cost.

    For what is called for every pixel with tuples of arrays: each of their fields is an argument of a call, which take
    longer than most such functions. `allocates=False`: it makes and returns no arrays, and counts no references, as of
    `compiled`; two counts for each array of each tuple take as long as the rest. Otherwise it does as its caller does.
    """
    counts = {} if allocates else {"_nrt": False}

    def decorate(each: F) -> F:
        return _for_kernels(each, forceinline=True, **counts)

    return decorate if function is None else decorate(function)


def _for_kernels(function: F, **options: bool) -> F:
    kernel = cast(Any, numba).jit(**OPTIONS, **options, pipeline_class=KernelCompiler)(function)
    if kernel is not function:  # as it is where numba is switched off
        kernel._cache = cache_of(function)
    return cast(F, kernel)
