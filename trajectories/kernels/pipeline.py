"""numba's compilation pipeline, with types resolved once and machine code generated once.

Own code, because numba resolves the types of `a + b` again at every occurrence, compiles a callee into each caller, and
counts a reference to each array of a tuple wherever a part of it is read.
"""

from typing import Any, cast

from numba.core import ir, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering, NopythonTypeInference

from uavbench.trajectories.kernels.cache import identity
from uavbench.trajectories.kernels.machine_code import CodeApart, CodeLinkedIn, KernelCode, NoEntry
from uavbench.trajectories.kernels.results import FromPython

INLINED_BYTES = 400
"""Longest Python bytecode of a kernel that is linked into its callers. LLVM inlines up to a cost of 225, some
50 instructions (its option `inline-threshold`); 400 bytes make several hundred."""
READ = {"getattr", "exhaust_iter", "getitem", "static_getitem"}
"""Operations by which parts of tuples, and views of arrays, are read."""


class ResolvedOnce:
    """numba's typing context, which resolves the type of each call of a function with given types only once.

    numba tries up to twenty templates for each operator, and formats an error message for each that does not fit.
    """

    resolved: dict[Any, Any] = {}  # noqa: RUF012, shared by all: the types of numba's functions do not change

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, arguments: Any, keywords: Any) -> Any:
        """The signature of a call."""
        call = function, tuple(arguments), tuple(sorted(keywords.items()))
        signature = self.resolved.get(call)
        if signature is None:
            signature = self._context.resolve_function_type(function, arguments, keywords)
            self.resolved[call] = signature
        return signature


@cast(Any, register_pass)(mutates_CFG=True, analysis_only=False)
class KernelTyping(NopythonTypeInference):
    """Type inference that remembers the signatures it has resolved."""

    _name = "kernel_type_inference"

    def run_pass(self, state: Any) -> bool:
        """Infer the types of a kernel."""
        context = state.typingctx
        state.typingctx = ResolvedOnce(context)
        try:
            return bool(cast(Any, super()).run_pass(state))
        finally:
            state.typingctx = context


class Borrowing(cast(Any, Lower)):  # type: ignore[misc]
    """Machine code that counts no references to arguments and to parts of them: the caller has them while it runs.

    numba counts each array of a tuple when a field is read, and again when it is read no more.
    """

    def pre_lower(self) -> None:
        """Find what is borrowed, before anything is lowered."""
        self.borrowed = borrowed(self.func_ir, self.typeof)
        super().pre_lower()

    def lower_assign(self, ty: Any, inst: Any) -> Any:
        """The value that is assigned; without a count of its own if it is borrowed."""
        counts = self.context.enable_nrt
        self.context.enable_nrt = counts and inst.target.name not in self.borrowed
        try:
            return super().lower_assign(ty, inst)
        finally:
            self.context.enable_nrt = counts

    def storevar(self, value: Any, name: str, argidx: Any = None) -> None:
        """Store a value in a variable; what a borrowed one held before is nothing to give back."""
        if name in self.borrowed and name not in self._singly_assigned_vars:
            self._alloca_var(name, self.typeof(name))
            self.builder.store(value, self.getvar(name))
        else:
            super().storevar(value, name, argidx)

    def delvar(self, name: str) -> None:
        """Give back what a variable holds, unless it is borrowed."""
        if name not in self.borrowed:
            super().delvar(name)


def borrowed(function: Any, type_of: Any) -> set[str]:
    """Names of the variables of a function that are arguments, and parts or views of these, and nothing else."""
    assigned: dict[str, list[Any]] = {}
    for block in function.blocks.values():
        for assign in block.find_insts(ir.Assign):
            assigned.setdefault(assign.target.name, []).append(assign.value)
    once = {name: values[0] for name, values in assigned.items() if len(values) == 1}
    found: set[str] = set()
    while True:
        more = {name for name, value in once.items() if name not in found and _is_part(name, value, found, type_of)}
        if not more:
            return found
        found |= more


def _is_part(name: str, value: Any, of: set[str], type_of: Any) -> bool:
    if isinstance(value, ir.Arg):
        return True
    if isinstance(value, ir.Var):
        return value.name in of
    if not isinstance(value, ir.Expr) or value.op not in READ or value.value.name not in of:
        return False
    whole = type_of(value.value.name)
    if isinstance(whole, types.BaseTuple):
        return True
    if not isinstance(whole, types.Array) or not isinstance(type_of(name), types.Array):
        return False  # what a list or a dictionary holds may be replaced meanwhile
    index = value.index_var if value.op == "static_getitem" else value.index if value.op == "getitem" else None
    return index is not None and _is_basic(type_of(index.name))


def _is_basic(index: Any) -> bool:
    """Whether what an index of this type selects of an array is a view of it."""
    if isinstance(index, types.BaseTuple):
        return all(_is_basic(each) for each in cast(Any, index))
    return isinstance(index, types.Integer | types.SliceType | types.EllipsisType)


class NotFromPython(Borrowing):
    """Machine code without the part that unpacks the arguments of a call from Python."""

    def create_cpython_wrapper(self, release_gil: bool = False) -> None:
        """No wrapper is created."""


class CalledFromPython(Borrowing, FromPython):
    """Machine code with that part."""


@cast(Any, register_pass)(mutates_CFG=True, analysis_only=False)
class KernelLowering(NativeLowering):
    """Lowering to machine code that is optimized once, and linked into callers."""

    _name = "kernel_lowering"

    @property
    def lowering_class(self) -> type:
        """The class that lowers to machine code."""
        return CalledFromPython

    def run_pass(self, state: Any) -> bool:
        """Lower a typed kernel."""
        return self._lower(state, KernelCode)

    def _lower(self, state: Any, kind: Any) -> bool:
        state.library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        done = bool(cast(Any, super()).run_pass(state))
        if kind is CodeApart:
            state.library.symbols = frozenset([state.cr.fndesc.llvm_func_name])
        return done


@cast(Any, register_pass)(mutates_CFG=True, analysis_only=False)
class DeclaredLowering(KernelLowering):
    """The same for a kernel with declared arguments, which is called by its symbol where it is large."""

    _name = "declared_kernel_lowering"
    inner = False
    small: type[KernelCode] = KernelCode

    def run_pass(self, state: Any) -> bool:
        """Lower a typed kernel."""
        function = state.func_ir.func_id
        known = identity(function.func, self.inner)
        if known is not None:  # callers find it by the same symbol in every process
            function.unique_id = known
        return self._lower(state, CodeApart if large(function.func) else self.small)


@cast(Any, register_pass)(mutates_CFG=True, analysis_only=False)
class InnerLowering(DeclaredLowering):
    """The same for a kernel that is called only by other kernels."""

    _name = "inner_kernel_lowering"
    inner = True
    small = CodeLinkedIn

    @property
    def lowering_class(self) -> type:
        """The class that lowers to machine code."""
        return NotFromPython

    def _lower(self, state: Any, kind: Any) -> bool:
        state.flags.no_compile = kind is CodeLinkedIn
        done = super()._lower(state, kind)
        if kind is CodeLinkedIn:
            state["cr"] = state["cr"]._replace(cfunc=NoEntry())
            state.targetctx.insert_user_function(state["cr"].cfunc, state["cr"].fndesc, [state.library])
            state.reload_init.extend(state.library._reload_init)
        return done


def large(function: Any) -> bool:
    """Whether a function is too large to be inlined."""
    return len(function.__code__.co_code) > INLINED_BYTES


class KernelCompiler(CompilerBase):
    """numba's passes, except for type inference and lowering."""

    lowering: type = KernelLowering

    def define_pipelines(self) -> list[Any]:
        """The only pipeline: there is no object mode."""
        own = {NativeLowering: self.lowering, NopythonTypeInference: KernelTyping}
        passes = cast(Any, DefaultPassBuilder).define_nopython_pipeline(self.state)
        passes.passes = [(own.get(step, step), about) for step, about in passes.passes]
        passes.finalize()
        return [passes]


class DeclaredCompiler(KernelCompiler):
    """The same for kernels with declared arguments."""

    lowering = DeclaredLowering


class InnerCompiler(KernelCompiler):
    """The same for kernels that are not called from Python."""

    lowering = InnerLowering
