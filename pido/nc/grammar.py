"""One line of NC text -> a control statement or a list of words, with compiled expressions (lark, LALR).

In:  a line without comment, block number, skip sign and label; letters outside quotes are capitals.
Out: `Control` or a list of `Word`; every expression is a callable of the interpreter's variables (`Scope`).
Source: SINUMERIK 840D sl programming manuals "Fundamentals" and "Job planning". Operators bind as they say there:
NOT, then * / DIV MOD, + -, B_AND, B_XOR, B_OR, AND, XOR, OR, <<, and comparisons last.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, reduce
from typing import Any, Protocol

from lark import Lark, Transformer, Tree
from lark.exceptions import UnexpectedInput

Expression = Callable[["Scope"], Any]


class Scope(Protocol):
    """Where an expression finds its variables."""

    def value(self, name: str, index: tuple[Any, ...]) -> Any: ...


@dataclass(frozen=True, slots=True)
class Word:
    """`name` is an address letter, an address or variable name, or a command.

    how : 'number' (X10), 'assign' (X=R1), 'name' (TRANS) or 'call' (CYCLE81(..)), 'text' ("NAME" after CALL)
    number : value of X10; expression : value of X=...; arguments : of a call, None where one was left out;
    index : of an array element or an axis, e.g. $P_UIFR[1,X,TR]
    """

    name: str
    how: str
    number: float = 0.0
    expression: Expression | None = None
    arguments: tuple[Expression | None, ...] = ()
    index: tuple[Expression, ...] = ()
    reads: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Control:
    """A control statement; `parts` as the grammar rule of that kind gives them."""

    kind: str
    parts: tuple[Any, ...]
    reads: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Coordinate:
    """A position that says itself how it counts: AC, IC, DC, ACP, ACN."""

    value: float
    incremental: bool


GRAMMAR = r"""
?start: control | words
words: word*

?control: _IF expr                               -> if_
    | _IF expr GOTO target                       -> if_goto
    | _ELSE                                      -> else_
    | _ENDIF                                     -> endif
    | _WHILE expr                                -> while_
    | _ENDWHILE                                  -> endwhile
    | _FOR NAME "=" expr _TO expr                -> for_
    | _ENDFOR                                    -> endfor
    | _LOOP                                      -> loop
    | _ENDLOOP                                   -> endloop
    | _REPEAT                                    -> repeat
    | _UNTIL expr                                -> until
    | _REPEAT label label? times?                -> repeat_label
    | _REPEATB label times?                      -> repeat_block
    | GOTO target                                -> goto
    | _GOTOS                                     -> goto_start
    | _CASE expr _OF (expr GOTO target)+ (_DEFAULT GOTO target)? -> case
    | _DEF TYPE ("[" expr "]")? declared ("," declared)*         -> def_
    | _PROC NAME ("(" formal ("," formal)* ")")? NAME*           -> proc
    | _PROC NAME "(" ")" NAME*                                   -> proc
    | _EXTERN NAME ("(" extern ("," extern)* ")")?               -> extern_
    | _RET ("(" returned ")")?                                  -> ret
returned: expr ("," expr)*
target: NAME | WORD
label: NAME
times: NAME "=" expr -> times_expression
    | WORD           -> times_number
declared: NAME index? ("=" expr)?
formal: (_VAR)? TYPE NAME ("=" expr)?
extern: _VAR? TYPE
index: "[" expr ("," expr)* "]"

word: WORD                                      -> number
    | NAME index? "=" expr                      -> assign
    | NAME                                      -> name
    | NAME "(" arguments ")"                    -> call
    | STRING                                    -> text
arguments: argument ("," argument)*
argument: expr?

?expr: sum9
?sum9: sum8 | sum9 COMPARE sum8                 -> binary
?sum8: sum7 | sum8 JOIN sum7                    -> binary
?sum7: sum6 | sum7 OR sum6                      -> binary
?sum6: sum5 | sum6 XOR sum5                     -> binary
?sum5: sum4 | sum5 AND sum4                     -> binary
?sum4: sum3 | sum4 B_OR sum3                    -> binary
?sum3: sum2 | sum3 B_XOR sum2                   -> binary
?sum2: sum1 | sum2 B_AND sum1                   -> binary
?sum1: product | sum1 PLUS product              -> binary
?product: unary | product TIMES unary           -> binary
?unary: atom | (PLUS | NOT) unary               -> prefixed
?atom: NUMBER                                   -> constant
    | HEX                                       -> bits
    | STRING                                    -> string
    | NAME index?                               -> variable
    | NAME "(" arguments ")"                    -> function
    | "(" expr ")"

WORD.3: /[A-Z][-+]?(?:\d+\.?\d*|\.\d+)(?:EX[-+]?\d+)?(?![\d.]|\s*[=\[](?!=)|[A-Z_][A-Z0-9_]*\()/
NUMBER.2: /(?:\d+\.?\d*|\.\d+)(?:EX[-+]?\d+)?/
HEX: /'[HB][0-9A-F]+'/
STRING: /"[^"]*"/
COMPARE: "==" | "<>" | "<=" | ">=" | "<" | ">"
JOIN.4: "<<"
PLUS: "+" | "-"
TIMES.5: /\*|\/|DIV(?![A-Z0-9_])|MOD(?![A-Z0-9_])/
AND.5: /AND(?![A-Z0-9_])/
OR.5: /OR(?![A-Z0-9_])/
XOR.5: /XOR(?![A-Z0-9_])/
NOT.5: /NOT(?![A-Z0-9_])|B_NOT(?![A-Z0-9_])/
B_AND.5: /B_AND(?![A-Z0-9_])/
B_OR.5: /B_OR(?![A-Z0-9_])/
B_XOR.5: /B_XOR(?![A-Z0-9_])/
_IF.6: /IF(?![A-Z0-9_])/
_ELSE.6: /ELSE(?![A-Z0-9_])/
_ENDIF.6: /ENDIF(?![A-Z0-9_])/
_WHILE.6: /WHILE(?![A-Z0-9_])/
_ENDWHILE.6: /ENDWHILE(?![A-Z0-9_])/
_FOR.6: /FOR(?![A-Z0-9_])/
_TO.6: /TO(?![A-Z0-9_])/
_ENDFOR.6: /ENDFOR(?![A-Z0-9_])/
_LOOP.6: /LOOP(?![A-Z0-9_])/
_ENDLOOP.6: /ENDLOOP(?![A-Z0-9_])/
_REPEAT.6: /REPEAT(?![A-Z0-9_])/
_REPEATB.6: /REPEATB(?![A-Z0-9_])/
_UNTIL.6: /UNTIL(?![A-Z0-9_])/
GOTO.6: /GOTO[BFC]?(?![A-Z0-9_])/
_GOTOS.6: /GOTOS(?![A-Z0-9_])/
_CASE.6: /CASE(?![A-Z0-9_])/
_OF.6: /OF(?![A-Z0-9_])/
_DEFAULT.6: /DEFAULT(?![A-Z0-9_])/
_DEF.6: /DEF(?![A-Z0-9_])/
_PROC.6: /PROC(?![A-Z0-9_])/
_EXTERN.6: /EXTERN(?![A-Z0-9_])/
_RET.6: /RET(?![A-Z0-9_])/
_VAR.6: /VAR(?![A-Z0-9_])/
TYPE.6: /(?:REAL|INT|BOOL|CHAR|STRING|AXIS)(?![A-Z0-9_])/
NAME: /[A-Z_$][A-Z0-9_$]*/
%ignore /[ \t]+/
"""


def _degrees(f: Callable[[float], float]) -> Callable[[float], float]:
    return lambda x: f(math.radians(x))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "SIN": _degrees(math.sin),
    "COS": _degrees(math.cos),
    "TAN": _degrees(math.tan),
    "ASIN": lambda x: math.degrees(math.asin(x)),
    "ACOS": lambda x: math.degrees(math.acos(x)),
    "ATAN2": lambda y, x: math.degrees(math.atan2(y, x)),
    "SQRT": math.sqrt,
    "ABS": abs,
    "POT": lambda x: x * x,
    "TRUNC": lambda x: float(math.trunc(x)),
    "ROUND": lambda x: math.copysign(math.floor(abs(x) + 0.5), x),
    "ROUNDUP": lambda x: float(math.ceil(x)),
    "LN": math.log,
    "EXP": math.exp,
    "MINVAL": min,
    "MAXVAL": max,
    "BOUND": lambda low, high, x: min(max(x, low), high),
    "AC": lambda x: Coordinate(float(x), False),
    "IC": lambda x: Coordinate(float(x), True),
    "DC": lambda x: Coordinate(float(x), False),
    "ACP": lambda x: Coordinate(float(x), False),
    "ACN": lambda x: Coordinate(float(x), False),
    "SET": lambda *values: list(values),
    "REP": lambda x: [x],
}
CONSTANTS = {"TRUE": True, "FALSE": False, "$PI": math.pi}
AXIS_NAMES = frozenset({"X", "Y", "Z", "TR", "FI", "RT", "SC", "MI"})

_OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "==": operator.eq,
    "<>": operator.ne,
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
    "<<": lambda a, b: _text(a) + _text(b),
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "DIV": lambda a, b: float(math.trunc(a / b)),
    "MOD": lambda a, b: math.fmod(a, b),
    "AND": lambda a, b: bool(a) and bool(b),
    "OR": lambda a, b: bool(a) or bool(b),
    "XOR": lambda a, b: bool(a) != bool(b),
    "B_AND": lambda a, b: float(int(a) & int(b)),
    "B_OR": lambda a, b: float(int(a) | int(b)),
    "B_XOR": lambda a, b: float(int(a) ^ int(b)),
}
_PREFIXES: dict[str, Callable[[Any], Any]] = {
    "-": operator.neg,
    "+": operator.pos,
    "NOT": lambda a: not a,
    "B_NOT": lambda a: float(~int(a)),
}


def _text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True, slots=True)
class _Code:
    """An expression on its way: what to call, and which names it reads."""

    run: Expression
    reads: frozenset[str] = frozenset()


def _reads(codes: Any) -> frozenset[str]:
    return reduce(frozenset.union, (c.reads for c in codes if isinstance(c, _Code)), frozenset())


class _Builder(Transformer):
    """Grammar rules -> values. Methods carry the rules' names."""

    def constant(self, children):
        value = _number(children[0])
        return _Code(lambda scope: value)

    def bits(self, children):
        text = children[0].strip("'")
        value = float(int(text[1:], 16 if text[0] == "H" else 2))
        return _Code(lambda scope: value)

    def string(self, children):
        value = children[0][1:-1]
        return _Code(lambda scope: value)

    def index(self, children):
        return tuple(children)

    def variable(self, children):
        name, index = str(children[0]), children[1] if len(children) > 1 else ()
        if name in CONSTANTS or (name in AXIS_NAMES and not index):
            value = CONSTANTS.get(name, name)
            return _Code(lambda scope: value)
        runs = tuple(i.run for i in index)
        if not runs:
            return _Code(lambda scope: scope.value(name, ()), frozenset({name}))
        reads = frozenset({name}) | _reads(index)
        return _Code(lambda scope: scope.value(name, tuple(r(scope) for r in runs)), reads)

    def argument(self, children):
        return children[0] if children else None

    def arguments(self, children):
        return () if children == [None] else tuple(children)

    def function(self, children):
        name, arguments = str(children[0]), children[1]
        function = FUNCTIONS.get(name)
        if function is None or None in arguments:
            return _Code(lambda scope: scope.value(name, ()), frozenset({f"{name}()"}))
        runs = tuple(a.run for a in arguments)
        return _Code(lambda scope: function(*(r(scope) for r in runs)), _reads(arguments))

    def prefixed(self, children):
        function, run = _PREFIXES[str(children[0])], children[1].run
        return _Code(lambda scope: function(run(scope)), children[1].reads)

    def binary(self, children):
        left, sign, right = children
        function, a, b = _OPERATORS[str(sign)], left.run, right.run
        return _Code(lambda scope: function(a(scope), b(scope)), left.reads | right.reads)

    def number(self, children):
        return _word_number(str(children[0]))

    def assign(self, children):
        name, *index, value = children
        places = index[0] if index else ()
        reads = value.reads | _reads(places)
        return Word(str(name), "assign", expression=value.run, index=tuple(i.run for i in places), reads=reads)

    def name(self, children):
        return Word(str(children[0]), "name")

    def call(self, children):
        name, arguments = children
        runs = tuple(a.run if a else None for a in arguments)
        return Word(str(name), "call", arguments=runs, reads=_reads(arguments))

    def text(self, children):
        return Word(children[0][1:-1], "text")

    def words(self, children):
        return list(children)

    def target(self, children):
        return str(children[0])

    def label(self, children):
        return str(children[0])

    def times_expression(self, children):
        return children[1]

    def times_number(self, children):
        value = _word_number(str(children[0])).number
        return _Code(lambda scope: value)

    def declared(self, children):
        name, *rest = children
        size = next((r for r in rest if isinstance(r, tuple)), ())
        value = next((r for r in rest if isinstance(r, _Code)), None)
        return (str(name), tuple(s.run for s in size), value.run if value else None)

    def formal(self, children):
        kind, name, *value = children
        return (str(kind), str(name), value[0].run if value else None)

    def extern(self, children):
        return str(children[0])

    def __default__(self, data, children, meta):
        if data.startswith("_"):  # lark's own helper rules for repetitions, which it takes apart again
            return Tree(data, children, meta)
        parts = tuple(c.run if isinstance(c, _Code) else c for c in children)
        return Control(str(data).rstrip("_"), parts, _reads(children))


def _number(text: str) -> float:
    return float(text.replace("EX", "E"))


def _word_number(text: str) -> Word:
    return Word(text[0], "number", number=_number(text[1:]))


@cache
def _parser() -> Lark:
    return Lark(GRAMMAR, parser="lalr", transformer=_Builder(), maybe_placeholders=False)


@cache
def _parsed(text: str) -> Control | tuple[Word, ...]:
    result = _parser().parse(text)
    return result if isinstance(result, Control) else tuple(result)  # type: ignore[return-value]


def parse(text: str) -> Control | tuple[Word, ...]:
    """The statement in `text`. Raises ValueError, naming the column and the word, where it is none.

    >>> [(w.name, w.number) for w in parse("G1 X10 Y-2.5")]
    [('G', 1.0), ('X', 10.0), ('Y', -2.5)]
    """
    try:
        return _parsed(text)
    except UnexpectedInput as error:
        column = error.column if isinstance(error.column, int) and error.column > 0 else len(text) + 1
        rest = text[column - 1 :].strip()
        found = f"'{rest[:20]}' was not expected" if rest else "the line ends too early"
        raise ValueError(f"column {column}: {found}") from None
