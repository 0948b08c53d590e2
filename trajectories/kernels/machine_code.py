"""Machine code of one kernel, in memory and in the cache.

A small kernel that other kernels call is linked into each of them, so that LLVM can inline it. A large one, which LLVM
does not inline but would optimize and translate again for every caller, is compiled once and called by its symbol.
"""

from typing import Any, NamedTuple, cast

from llvmlite import binding as llvm
from numba.core import compiler
from numba.core.codegen import JITCodeLibrary


class NoEntry:
    """Entry point of a kernel that is only linked into others."""


class KernelCode(JITCodeLibrary):
    """Code library that is optimized as a whole instead of per function first, which saves a tenth of the time."""

    def __init__(self, codegen: Any, name: str) -> None:
        cast(Any, super()).__init__(codegen, name)
        self.symbols: frozenset[str] = frozenset()
        """Names by which callers call it, where it is not linked into them."""
        self.called: set[str] = set()
        """Symbols that it calls, itself or in the libraries linked into it."""

    def add_linking_library(self, library: Any) -> None:
        """Link a library and everything that it calls."""
        cast(Any, super()).add_linking_library(library)
        if isinstance(library, KernelCode):
            self.called |= library.called | library.symbols

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout


class CodeApart(KernelCode):
    """Code of a large kernel, called by its symbol."""

    def _get_module_for_linking(self) -> Any:
        return cast(Any, llvm).parse_assembly(str(cast(Any, self)._codegen._create_empty_module(self.name)))


class CodeLinkedIn(KernelCode):
    """Code of a small kernel that is linked into its callers and never translated by itself."""

    def _finalize_final_module(self) -> None:
        cast(Any, self)._finalize_dynamic_globals()
        self._finalized = True


class CachedKernel(NamedTuple):
    """A compiled kernel as it is cached: an object file, and LLVM's bitcode where it is linked into others."""

    kind: type[KernelCode]
    name: str
    machine_code: bytes | None
    bitcode: bytes | None
    symbols: frozenset[str]
    called: frozenset[str]
    defined: frozenset[str]
    signature: Any
    description: Any
    environments: tuple[Any, ...]
    on_load: tuple[Any, ...]

    @classmethod
    def of(cls, result: Any) -> "CachedKernel":
        """The part of numba's compilation result that is cached."""
        code, description = result.library, result.fndesc
        code._ensure_finalized()
        names = description.llvm_func_name, description.llvm_cpython_wrapper_name
        description.typemap = description.calltypes = None  # not needed, and not all can be pickled
        return cls(
            kind=type(code),
            name=code.name,
            machine_code=None if isinstance(code, CodeLinkedIn) else code._get_compiled_object(),
            bitcode=None if isinstance(code, CodeApart) else code._get_module_for_linking().as_bitcode(),
            symbols=code.symbols,
            called=frozenset(code.called),
            defined=frozenset(name for name in names if code.codegen._engine.is_symbol_defined(name)),
            signature=result.signature,
            description=description,
            environments=(result.environment, *result._find_referenced_environments()),
            on_load=tuple(result.reload_init),
        )

    def restored(self, target: Any) -> Any:
        """The compiled kernel; LookupError when a kernel that it calls has not been loaded."""
        codegen, described = target.codegen(), self.description
        engine = codegen._engine
        if not all(engine.is_symbol_defined(symbol) for symbol in self.called):
            raise LookupError("a kernel that it calls has not been loaded")
        for initialize in self.on_load:
            initialize()
        code: Any = self.kind(codegen, self.name)
        code.symbols, code.called = self.symbols, set(self.called)
        if self.bitcode is not None:
            code._shared_module = cast(Any, llvm).parse_bitcode(self.bitcode)
        entry: Any = NoEntry()
        if self.machine_code is None:
            code._finalized = True
        else:
            code.enable_object_caching()
            code._set_compiled_object(self.machine_code)
            code._finalize_final_module()
            engine._defined_symbols |= self.defined
            entry = target.get_executable(code, described, self.environments[0])
            for environment in self.environments[1:]:
                codegen.set_env(environment.env_name, environment)
        return cast(Any, compiler).compile_result(
            target_context=target,
            typing_context=target.typing_context,
            library=code,
            environment=self.environments[0],
            entry_point=entry,
            fndesc=described,
            signature=self.signature,
            objectmode=False,
            lifted=(),
            reload_init=self.on_load,
            referenced_envs=self.environments[1:],
        )
