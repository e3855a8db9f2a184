"""Compile a piece of a kernel to intermediate code only, which its kernel includes.

By default numba optimises each function together with all that it calls, down to machine code.  For
nested pieces it would repeat this at every level in vain: a kernel contains a copy of all its
pieces and is optimised as a whole.  Omitting it saves a quarter of the time to compile.
Passes that change nothing in the kernels are omitted too, which saves a tenth of what is left.
"""

from __future__ import annotations

from typing import Any

from vibrosweep.kernels._numba import (
    CompilerBase,
    DefaultPassBuilder,
    JITCodeLibrary,
    LoweringPass,
    NativeLowering,
    make_function,
    register_pass,
)

PACKAGE = __name__.partition(".")[0]
# Kernels have no comprehensions, functions within functions or `with`, compute with numbers instead
# of whole arrays, and leave inlining to LLVM.  Functions from outside the package may differ.
NEEDLESS = {
    "IRProcessing",
    "WithLifting",
    "InlineClosureLikes",
    "InlineOverloads",
    "NopythonRewrites",
}


class PieceLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The intermediate code of a piece, with that of the pieces that it calls."""

    def _optimize_functions(self, module: Any) -> None:
        """Simplify functions that have code; numba would visit those only declared, too."""
        module.data_layout = self._codegen._data_layout
        for function in module.functions:
            if not function.is_declaration:
                passes, builder = self._codegen._function_pass_manager()
                passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        """Simplify loops and expressions; all else is left to the kernel."""
        passes, builder = self._codegen._module_pass_manager(opt=0, cost="cheap")
        passes.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        """Make no machine code."""
        self._finalized = True


@register_pass(mutates_CFG=False, analysis_only=False)
class DeclarePiece(LoweringPass):  # type: ignore[misc]
    """Let other pieces and kernels call a piece, as numba does for functions with machine code."""

    _name = "declare_piece"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Declare the piece by a function object without code, which is never called."""
        lowered, nowhere = state["cr"], 0
        module, name = lowered.fndesc.lookup_module(), lowered.fndesc.qualname
        key = make_function(module, name, "", nowhere, lowered.env, ())
        state.targetctx.insert_user_function(key, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=key)
        return True


class PieceCompiler(CompilerBase):  # type: ignore[misc]
    """Numba's compiler without machine code, and without passes that kernels do not need."""

    def define_pipelines(self) -> list[Any]:
        """Return numba's passes, with the declaration of the piece after its lowering."""
        state = self.state
        state.flags.no_compile = True
        state.library = PieceLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        passes = DefaultPassBuilder.define_nopython_pipeline(state)
        if state.func_id.modname.partition(".")[0] == PACKAGE:
            needed = [step for step in passes.passes if step[0].__name__ not in NEEDLESS]
            passes.passes = needed
        passes.add_pass_after(DeclarePiece, NativeLowering)
        passes.finalize()
        return [passes]
