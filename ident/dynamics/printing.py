"""SymPy expressions as Python text: for one number at a time (Numba), or for arrays (NumPy)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sympy import Basic, Expr, Piecewise, Pow, Rational, Symbol
from sympy.printing.pycode import PythonCodePrinter

LARGEST_PRODUCT = 4  # powers up to this are written as products
FUNCTIONS = ("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log")  # named alike by math and NumPy


class ScalarPrinter(PythonCodePrinter):  # type: ignore[misc]
    """Text for numbers: functions of ``math``, branches as conditional expressions."""

    module = "math"

    def __init__(self, names: Mapping[Symbol, str]) -> None:
        super().__init__({"fully_qualified_modules": True, "strict": True})
        self._names = names
        self.known_functions = {name: f"{self.module}.{name}" for name in FUNCTIONS}

    def _print_Symbol(self, expr: Symbol) -> str:  # noqa: N802 - SymPy's way of naming
        return self._names.get(expr, expr.name)

    def _print_Rational(self, expr: Rational) -> str:  # noqa: N802
        return repr(expr.p / expr.q)

    def _print_Half(self, expr: Rational) -> str:  # noqa: ARG002, N802
        return "0.5"

    def _print_Integer(self, expr: Rational) -> str:  # noqa: N802
        return f"{expr.p}.0" if expr.p >= 0 else f"({expr.p}.0)"

    def _print_Pow(self, expr: Pow, rational: bool = False) -> str:  # noqa: ARG002, N802
        base, exponent = expr.as_base_exp()
        if exponent == Rational(1, 2):
            return f"{self.module}.sqrt({self._print(base)})"
        if exponent.is_Integer:
            size = abs(int(exponent))
            text = f"({self._print(base)})"
            power = "*".join([text] * size) if size <= LARGEST_PRODUCT else f"{text}**{size}"
            return f"({power})" if exponent > 0 else f"(1.0/({power}))"
        return f"({self._print(base)})**({self._print(exponent)})"

    def _print_Piecewise(self, expr: Piecewise) -> str:  # noqa: N802
        *branches, last = expr.args
        text = f"({self._print(last.expr)})"
        for value, condition in reversed(branches):
            text = self._choose(self._print(condition), self._print(value), text)
        return text

    def _choose(self, condition: str, value: str, otherwise: str) -> str:
        return f"(({value}) if {condition} else {otherwise})"


class ArrayPrinter(ScalarPrinter):
    """Text for arrays: functions of NumPy; both branches of a choice are computed."""

    module = "np"

    def _choose(self, condition: str, value: str, otherwise: str) -> str:
        return f"np.where({condition}, {value}, {otherwise})"

    def _print_And(self, expr: Basic) -> str:  # noqa: N802
        return f"({' & '.join(f'({self._print(part)})' for part in expr.args)})"

    def _print_Or(self, expr: Basic) -> str:  # noqa: N802
        return f"({' | '.join(f'({self._print(part)})' for part in expr.args)})"

    def _print_Not(self, expr: Basic) -> str:  # noqa: N802
        return f"(~({self._print(expr.args[0])}))"


def assignments(
    printer: ScalarPrinter, temporaries: Sequence[tuple[Symbol, Expr]], indent: str = "    "
) -> list[str]:
    """One line for each temporary."""
    return [f"{indent}{printer.doprint(name)} = {printer.doprint(value)}" for name, value in temporaries]
