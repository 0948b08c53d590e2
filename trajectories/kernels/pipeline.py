"""numba's compilation pipeline without the slow passes that these kernels do not need."""

from typing import Any, cast

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering


class OptimizedOnce(JITCodeLibrary):
    """Code library that is optimized as a whole instead of per function first, which saves a tenth of the time."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout


class NotFromPython(Lower):
    """Machine code without the part that unpacks the arguments of a call from Python."""

    def create_cpython_wrapper(self, release_gil: bool = False) -> None:
        """No wrapper is created."""


@cast(Any, register_pass)(mutates_CFG=True, analysis_only=False)
class KernelLowering(NativeLowering):
    """Lowering to machine code that is optimized once."""

    _name = "kernel_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower a typed kernel."""
        state.library = cast(Any, OptimizedOnce)(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return bool(cast(Any, super()).run_pass(state))


@cast(Any, register_pass)(mutates_CFG=True, analysis_only=False)
class InnerLowering(KernelLowering):
    """The same for a kernel that other kernels call and Python does not."""

    _name = "inner_kernel_lowering"

    @property
    def lowering_class(self) -> type:
        """The class that lowers to machine code."""
        return NotFromPython


class KernelCompiler(CompilerBase):
    """numba's passes, but for the lowering."""

    lowering: type = KernelLowering

    def define_pipelines(self) -> list[Any]:
        """The only pipeline: there is no object mode."""
        passes = cast(Any, DefaultPassBuilder).define_nopython_pipeline(self.state)
        passes.passes = [(self.lowering if step is NativeLowering else step, told) for step, told in passes.passes]
        passes.finalize()
        return [passes]


class InnerCompiler(KernelCompiler):
    """The same for kernels that Python does not call."""

    lowering = InnerLowering
