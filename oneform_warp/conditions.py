"""Vertex selections by MeshLab's condition strings, such as "x > 0 && q < 0.5", on NumPy arrays.

The language is the one of muParser as MeshLab uses it. Two things that muParser lets through are errors
here, because they hide mistakes: `x = 0` (an assignment) and `a, b` outside a call (only `b` counts).
"""

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from functools import cache, reduce
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from oneform_warp.errors import InputError

if TYPE_CHECKING:
    from lark import Lark, Token, Transformer
    from lark.exceptions import UnexpectedInput

__all__ = ["needs_positions_only", "select", "vertex_variables"]

Value = NDArray[np.float64]

# A sign stands before a power (-x^2 is -(x^2)), and only once; all comparisons have one precedence.
GRAMMAR = r"""
?start: choice
?choice: either | either "?" choice ":" choice
?either: both | either OR both -> binary
?both: comparison | both AND comparison -> binary
?comparison: sum | comparison COMPARE sum -> binary
?sum: product | sum SIGN product -> binary
?product: signed | product TIMES signed -> binary
?signed: power | SIGN power -> sign
?power: atom | atom POWER signed -> binary
?atom: NUMBER -> number | NAME -> name | "(" choice ")" | NAME "(" [choice ("," choice)*] ")" -> call
OR: "||"
AND: "&&"
COMPARE: "==" | "!=" | "<=" | ">=" | "<" | ">"
SIGN: "+" | "-"
TIMES: "*" | "/"
POWER: "^"
NUMBER: /(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?/
NAME: /[A-Za-z_][A-Za-z_0-9]*/
%ignore /[ \t\r\n]+/
"""

# muParser's own digits of pi: exact comparisons then agree with MeshLab's.
CONSTANTS = {"_pi": 3.141592653589, "_e": 2.718281828459045}

BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "||": np.logical_or, "&&": np.logical_and, "==": np.equal, "!=": np.not_equal, "<=": np.less_equal,
    ">=": np.greater_equal, "<": np.less, ">": np.greater, "+": np.add, "-": np.subtract, "*": np.multiply,
    "/": np.divide, "^": np.power,
}  # fmt: skip

UNARY: dict[str, Callable[[Any], Any]] = {
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan,
    "sinh": np.sinh, "cosh": np.cosh, "tanh": np.tanh, "asinh": np.arcsinh, "acosh": np.arccosh,
    "atanh": np.arctanh, "log": np.log, "ln": np.log, "log2": np.log2, "log10": np.log10, "exp": np.exp,
    "sqrt": np.sqrt, "abs": np.abs, "rint": lambda a: np.floor(a + 0.5),
    "sign": lambda a: 1.0 * (a > 0) - (a < 0),
}  # fmt: skip

# The order of the comparisons decides what becomes of NaN, as std::min and std::max do it.
MANY: dict[str, Callable[[Sequence[Value]], Any]] = {
    "min": lambda values: reduce(lambda a, b: np.where(b < a, b, a), values),
    "max": lambda values: reduce(lambda a, b: np.where(a < b, b, a), values),
    "sum": lambda values: reduce(np.add, values),
    "avg": lambda values: reduce(np.add, values) / len(values),
}

FUNCTIONS = sorted([*UNARY, *MANY, "atan2"])

# What a mesh may lack: these names are known to MeshLab, so the message can say what is missing.
OPTIONAL = dict.fromkeys("rgba", "colours") | dict.fromkeys(("nx", "ny", "nz"), "normals")
OPTIONAL |= {"q": "quality", "vsel": "selection"}

HINTS = {
    "and": "write && instead of 'and'",
    "or": "write || instead of 'or'",
    "not": "write (...) == 0 instead of 'not ...'",
    "!": "write (...) == 0 instead of '!...'",
    "=": "write == to compare",
    ",": "join conditions with && or ||",
    "": "complete the condition",
}


def select(condition: str, variables: Mapping[str, ArrayLike]) -> NDArray[np.bool_]:
    """Mark the vertices for which a condition is not zero.

    `variables` has a number or an array (V,) for each name; see `vertex_variables`. Returns a mask (V,).
    As in MeshLab, NaN counts as true, and division by zero gives an infinity. Raises InputError for a
    condition that cannot be read (with its column), an unknown name, and arrays of different lengths.
    """
    from lark.exceptions import UnexpectedInput, VisitError

    values = {name: np.asarray(value, dtype=np.float64) for name, value in variables.items()}
    sizes = {value.shape for value in values.values() if value.ndim}
    if len(sizes) != 1 or len(next(iter(sizes))) != 1:
        raise InputError("the variables need one common length (V,)", fix=f"the shapes are {sorted(sizes)}")
    try:
        tree = _parser().parse(condition)
    except UnexpectedInput as error:
        raise _syntax_error(condition, error) from None
    try:
        with np.errstate(all="ignore"):
            result = _evaluator()(values).transform(tree)
    except VisitError as error:
        if isinstance(error.orig_exc, InputError):
            raise InputError(error.orig_exc.what, where=_where(condition), fix=error.orig_exc.fix) from None
        raise
    return np.array(np.broadcast_to(result != 0, sizes.pop()))


def needs_positions_only(condition: str) -> bool:
    """Whether all names in a condition are known of any mesh; False also where it cannot be read."""
    from lark.exceptions import UnexpectedInput

    try:
        tree = _parser().parse(condition)
    except UnexpectedInput:
        return False
    known = vertex_variables(np.zeros((1, 3))).keys() | CONSTANTS.keys()
    return all(str(name.children[0]) in known for name in tree.find_data("name"))


def vertex_variables(
    x: ArrayLike,
    *,
    colors: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    quality: ArrayLike | None = None,
    selected: ArrayLike | None = None,
) -> dict[str, NDArray[np.float64]]:
    """Name the per-vertex values and the bounding box as MeshLab does.

    `x` (V, 2) or (V, 3) positions; `colors` (V, 3) or (V, 4), integers 0..255 or floats 0..1;
    `normals` (V, 3); `quality` (V,); `selected` (V,) bool. Names of absent values are left out.
    Raises InputError for other shapes of `x`.
    """
    x = np.asarray(x, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] not in (2, 3) or not len(x):
        raise InputError(f"conditions need positions (V, 2) or (V, 3), not {x.shape}", fix="pass a mask instead")
    points = x if x.shape[1] == 3 else np.pad(x, ((0, 0), (0, 1)))
    # Column by column: NumPy takes ten times as long for the short rows at once.
    low = np.array([column.min() for column in points.T])
    high = np.array([column.max() for column in points.T])
    named = {"vi": np.arange(len(x), dtype=np.float64), "bbdiag": np.linalg.norm(high - low)}
    for axis, name in enumerate("xyz"):
        named[name] = points[:, axis]
        named |= {f"{name}min": low[axis], f"{name}max": high[axis], f"{name}dim": high[axis] - low[axis]}
        named[f"{name}mid"] = (low[axis] + high[axis]) / 2
    if colors is not None:
        named |= zip("rgba", _color_bytes(np.asarray(colors)).T, strict=True)
    if normals is not None:
        named |= zip(("nx", "ny", "nz"), np.asarray(normals, dtype=np.float64).T, strict=True)
    if quality is not None:
        named["q"] = np.asarray(quality, dtype=np.float64)
    if selected is not None:
        named["vsel"] = np.asarray(selected, dtype=np.float64)
    return {name: np.asarray(value) for name, value in named.items()}


def _color_bytes(colors: NDArray[Any]) -> Value:
    """Colours as 0..255 with alpha, (V, 4), from integers 0..255 or floats 0..1."""
    if np.issubdtype(colors.dtype, np.floating):
        colors = np.rint(colors * 255)
    colors = colors.astype(np.float64)
    return colors if colors.shape[1] == 4 else np.pad(colors, ((0, 0), (0, 1)), constant_values=255)


@cache
def _parser() -> "Lark":
    """The parser of conditions, made once; lark is loaded only when a condition is used."""
    from lark import Lark

    return Lark(GRAMMAR, parser="lalr")


@cache
def _evaluator() -> "Callable[[Mapping[str, Value]], Transformer[Token, Value]]":
    """The class that turns a syntax tree into an array."""
    from lark import Token, Transformer, v_args

    @v_args(inline=True)
    class Evaluator(Transformer[Token, Value]):
        def __init__(self, variables: Mapping[str, Value]) -> None:
            super().__init__()
            self.variables = variables

        def number(self, token: Token) -> Value:
            return np.asarray(float(token))

        def name(self, token: Token) -> Value:
            return _lookup(token, self.variables)

        def sign(self, sign: Token, value: Value) -> Value:
            return -value if sign == "-" else value

        def binary(self, left: Value, operator: Token, right: Value) -> Value:
            return np.asarray(BINARY[operator](left, right), dtype=np.float64)

        def choice(self, condition: Value, yes: Value, no: Value) -> Value:
            return np.where(condition != 0, yes, no)

        def call(self, token: Token, *arguments: Value | None) -> Value:
            return _call(token, [value for value in arguments if value is not None])

    return Evaluator


def _lookup(token: "Token", variables: Mapping[str, Value]) -> Value:
    """The value of a name; raises InputError with the nearest name."""
    if token in variables:
        return variables[token]
    if token in CONSTANTS:
        return np.asarray(CONSTANTS[token])
    if token in OPTIONAL:
        raise InputError(f"the mesh has no {OPTIONAL[token]} for '{token}'", fix="give them or use other names")
    if token in FUNCTIONS:
        raise InputError(f"'{token}' at column {token.column} is a function", fix=f"write {token}(...)")
    raise _unknown(token, "variable", [*variables, *CONSTANTS])


def _call(token: "Token", arguments: list[Value]) -> Value:
    """The value of a function; raises InputError for a name or a number of arguments that does not fit."""
    if token not in FUNCTIONS:
        raise _unknown(token, "function", FUNCTIONS)
    wanted = "at least 1" if token in MANY else "2" if token == "atan2" else "1"
    if not arguments or (token not in MANY and len(arguments) != int(wanted)):
        raise InputError(f"'{token}' at column {token.column} has {len(arguments)} arguments", fix=f"give {wanted}")
    if token in MANY:
        return np.asarray(MANY[token](arguments))
    return np.asarray(np.arctan2(*arguments) if token == "atan2" else UNARY[token](arguments[0]))


def _unknown(token: "Token", kind: str, known: Sequence[str]) -> InputError:
    """The error for a name that is not known, with the nearest one that is."""
    near = get_close_matches(token, known, n=1, cutoff=0.0)
    names = ", ".join(sorted(known))
    return InputError(
        f"unknown {kind} '{token}' at column {token.column}", fix=f"did you mean '{near[0]}'? known: {names}"
    )


def _syntax_error(condition: str, error: "UnexpectedInput") -> InputError:
    """The error for a condition that cannot be read, with the column where reading stopped."""
    found = getattr(error, "token", None)
    position = len(condition) if found == "" else int(getattr(error, "pos_in_stream", 0))
    word = condition[position : position + 1] if found is None else str(found)
    what = f"unexpected '{word}' at column {position + 1}" if word else f"unexpected end at column {position + 1}"
    return InputError(what, where=_where(condition), fix=HINTS.get(word, "see the list of operators and functions"))


def _where(condition: str) -> str:
    return f"condition '{condition}'"
