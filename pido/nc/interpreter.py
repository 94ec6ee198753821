"""NC program -> toolpath: variables, loops, jumps and subprograms around the blocks.

In:  a program (file or text) in SINUMERIK dialect or plain ISO, optionally machine, tools, zero offsets, subprograms.
Out: `Toolpath`. Whatever is not understood, missing, endless or out of reach is a `ProgramError` with line and text,
     and all faults of the text are reported together before a block is executed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pido.core.axes import LINEAR_AXES
from pido.core.errors import ProgramError
from pido.core.machining import Machine, Tool
from pido.nc import words as known
from pido.nc.block import Executor, Values
from pido.nc.cycles import CYCLES
from pido.nc.grammar import Control, Word
from pido.nc.library import Library
from pido.nc.path import RAPID_FEED
from pido.nc.source import Program, Statement
from pido.nc.toolpath import Toolpath
from pido.nc.variables import Scope, typed

MAX_STEPS = 20_000_000
MAX_DEPTH = 16
Point = tuple[float, float, float]


def interpret(
    program: Path | str,
    *,
    machine: Machine | None = None,
    tools: Mapping[str, Tool] | None = None,
    start: Point | None = None,
    zero_offsets: Mapping[str, Point] | None = None,
    subprograms: Path | Mapping[str, str] | None = None,
    reference: Point | None = None,
    block_skip: bool = False,
    neutral: Collection[str] = (),
    max_steps: int = MAX_STEPS,
) -> Toolpath:
    """What `program` asks of the machine.

    Parameters
    ----------
    program : a file, or the text itself (a `str` with a line break, or one that names no file)
    machine : travel and spindle limits are checked where it is given
    tools : by the name in the program; needed for G41/G42 and pockets; a tool that is not in it is an error
    start : mm, machine coordinates of the first move's start; None: each axis starts where it is first sent
    zero_offsets : e.g. {"G54": (x, y, z)}, mm; None: unknown offsets count as 0 (with a note), else they are an error
    subprograms : a folder with NAME.SPF, or texts by name; a program file's own folder is searched in any case
    reference : mm, machine coordinates of the reference point (G28, G74)
    block_skip : leave out blocks that begin with /
    neutral : words of this machine that change nothing here, e.g. ("M27", "SPECIAL_CYCLE")

    Raises ProgramError: text that is not understood (all of it at once), a missing subprogram, an endless loop, a tool
    that is not in the list, travel or spindle speed exceeded.

    >>> path = interpret("G0 X0 Y0 Z0\\nG1 X30 Y40 F600\\nM30")
    >>> path.length.tolist(), path.feed.tolist(), path.nc_line.tolist()
    ([50.0], [10.0], [2])
    """
    library = Library(subprograms, frozenset(n.upper() for n in neutral))
    main = library.load(program)
    run = _Run(library, main, tools, zero_offsets, start, reference, block_skip, max_steps)
    run.execute()
    e = run.executor
    path = e.path.toolpath(
        None if start is None else np.asarray(start, float), tuple(e.tool_names), tuple(library.order), tuple(e.notes)
    )
    if machine is not None:
        _check_limits(path, machine, library)
    return path


class _Run:
    """Executes statements; knows where it is, for every message."""

    def __init__(
        self,
        library: Library,
        main: Program,
        tools: Mapping[str, Tool] | None,
        zero_offsets: Mapping[str, Point] | None,
        start: Point | None,
        reference: Point | None,
        block_skip: bool,
        max_steps: int,
    ) -> None:
        self.library, self.main, self.block_skip, self.max_steps = library, main, block_skip, max_steps
        m6 = any(library.programs[n].changes_tool_with_m6 for n in library.order if n in library.programs)
        self.executor = Executor(tools, zero_offsets, start, reference, m6 or main.changes_tool_with_m6)
        self.r: dict[int, float] = {}
        self.steps = 0
        self.seen: dict[tuple[int, int], Any] = {}
        self.depth = 0
        self.program = main
        self.ended = False

    def execute(self) -> None:
        self.call(self.main, ())
        self._guard(self.executor.finish)

    def system(self, name: str, index: tuple[Any, ...]) -> Any:
        e = self.executor
        if name in ("$AA_IW", "$P_EP"):
            return e.position[known.LINEAR.index(index[0])]
        if name == "$AA_IM":
            return float(e.path.frames[e.frame].apply(np.array(e.position))[known.LINEAR.index(index[0])])
        if name == "$P_TOOLR":
            return e.radius or 0.0
        if name == "$P_F":
            return e.feed_word
        if name == "$P_S":
            return e.speed_word
        if name == "$P_UIFR":
            number = int(index[0])
            offset = f"G{53 + number}" if 1 <= number <= 4 else f"G{500 + number}"
            return float(e.offsets.get(offset, np.zeros(3))[known.LINEAR.index(index[1])])
        raise ValueError(f"the value of {name} is not known here")

    def set_offset(self, number: float, axis: str, value: float) -> None:
        self.executor.set_offset(number, axis, value)

    def fail(self, fault: str, line: int | None = None) -> ProgramError:
        at = self.executor.line if line is None else line
        return ProgramError(f"{self.program.name}, line {at}: '{self.program.text(at)}': {fault}")

    def _guard(self, action: Any, *arguments: Any) -> Any:
        """Run one step; whatever is wrong with it is told with line and text."""
        try:
            return action(*arguments)
        except ZeroDivisionError:
            raise self.fail("division by zero") from None
        except (ValueError, OverflowError) as error:
            line = error.args[1][1] if len(error.args) == 2 else None
            raise self.fail(str(error.args[0]), line) from None
        except (TypeError, KeyError, IndexError, AttributeError) as error:
            raise self.fail(f"this expression has no value: {error}") from None

    def call(self, program: Program, values: tuple[Any, ...]) -> None:
        """Execute a program from its first statement, with its own variables."""
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self.fail(f"subprograms call each other more than {MAX_DEPTH} deep")
        outer, self.program = self.program, program
        e = self.executor
        outer_line, outer_number = e.line, e.program
        e.program = self.library.order.index(program.name)
        e.renew()
        scope = Scope(self)
        if len(values) > len(program.parameters):
            raise self.fail(
                f"{program.name} takes {len(program.parameters)} parameters, {len(values)} were given", outer_line
            )
        given = (*values, *[None] * (len(program.parameters) - len(values)))
        for (kind, name, default), value in zip(program.parameters, given, strict=True):
            if value is None:
                value = default(scope) if default else ("" if kind == "STRING" else 0.0)
            scope.kinds[name], scope.local[name] = kind, typed(kind, value)
        self._statements(program, scope, 0, len(program.statements))
        self.depth -= 1
        self.program, e.line, e.program = outer, outer_line, outer_number
        e.renew()

    def _statements(self, program: Program, scope: Scope, first: int, stop: int) -> bool:
        """Execute statements first..stop-1; True where the program ended (M30, M17, RET)."""
        e, rows = self.executor, self.executor.path.rows
        statements, i = program.statements, first
        loops: dict[int, float] = {}  # FOR: the end value
        while first <= i < stop:
            self.steps += 1
            e.step = self.steps
            if self.steps > self.max_steps:
                raise self.fail(
                    f"more than {self.max_steps} blocks were executed: is a loop without end?", statements[i][0]
                )
            statement = statements[i]
            i += 1
            if not isinstance(statement, Statement):
                line, g, x, y, z, f = statement
                e.line = line
                if e.plain:
                    if g is not None and g != e.motion:
                        e.motion = g
                    if f is not None:
                        e.feed_word = f
                    if x is None and y is None and z is None:
                        continue
                    px, py, pz = e.position
                    if e.absolute:
                        e.position = [px if x is None else x, py if y is None else y, pz if z is None else z]
                    else:
                        e.position = [px + (x or 0.0), py + (y or 0.0), pz + (z or 0.0)]
                        if any(v is not None and p != p for v, p in ((x, px), (y, py), (z, pz))):
                            raise self.fail("a distance from where the axes stand, which is not known: give `start`")
                    if e.motion == 0:
                        feed = RAPID_FEED
                    elif e.feed_word > 0:
                        feed = e.feed_word * e.override / 60.0
                    else:
                        raise self.fail("feed is zero: program F before this move")
                    rows.append((*e.position, feed, line, e.modal, self.steps))  # type: ignore[arg-type]
                    continue
                self._guard(e.run, _from_plain(statement))
                continue
            e.line = statement.line
            if statement.skippable and self.block_skip:
                continue
            if statement.control is not None:
                at = self._guard(self._control, program, scope, i - 1, statement.control, loops)
                if at is None:
                    return True
                i = at
                continue
            if self._guard(self._block, scope, statement):
                return True
            if self.ended:
                return True
        return False

    # --- blocks ------------------------------------------------------------------------------------------------

    def _block(self, scope: Scope, statement: Statement) -> bool:
        """Execute a block; True where it ends the program."""
        values, calls = Values(), []
        ends = False
        if statement.pairs is not None:
            for letter, number in statement.pairs:
                values.add(letter, number)
        else:
            calls = self._evaluate(scope, statement.words or (), values)
        for m in values.m:
            if f"M{m:g}" in self.library.neutral:
                continue
            if m in known.ENDS_M:
                ends = True
                self.ended = self.ended or m in (2, 30)
        if 98 in values.m:
            calls.append((f"L{values.take('P'):g}", (), int(values.take("L", 1.0))))
        values.at = {k: v for k, v in values.at.items() if k not in self.library.neutral}
        self.executor.run(values)
        for name, given, times in calls:
            target = self.library.programs.get(name) or self.library.find(name)
            if target is None or target.name not in self.library.order:
                raise ValueError(f"subprogram {name} is missing")
            for _ in range(times):
                self.call(target, given)
                if self.ended:
                    return True
        return ends

    def _evaluate(
        self, scope: Scope, words: tuple[Word, ...], values: Values
    ) -> list[tuple[str, tuple[Any, ...], int]]:
        """Words with their values into `values`; variables are set; subprogram calls are returned."""
        calls: list[tuple[str, tuple[Any, ...], int]] = []
        modal = any(w.name == "MCALL" for w in words)
        times = 1
        for w in words:
            if w.how == "number":
                if w.name == "L" and not any(v.name == "M" and v.number == 98 for v in words):
                    calls.append((f"L{w.number:g}", (), 1))
                elif w.name == "P" and (
                    calls or any(v.name not in known.COMMANDS and v.how in ("name", "call") for v in words)
                ):
                    times = int(w.number)
                else:
                    values.add(w.name, w.number)
            elif w.how == "assign":
                assert w.expression is not None
                value = w.expression(scope)
                index = tuple(i(scope) for i in w.index)
                if scope.set(w.name, index, value) or w.name in known.NEUTRAL_ASSIGNED:
                    continue
                if w.name == "P" and calls:
                    times = int(value)
                elif len(w.name) > 1 and w.name[0] in "MS" and w.name[1:].isdigit():
                    if w.name[0] == "M" and w.name[1:] == "1":
                        values.m.append(float(value))
                    elif w.name in ("S1", "S"):
                        values.add("S", value)
                else:
                    values.add(w.name, value)
            elif w.how == "text":
                calls.append((w.name.upper(), (), 1))
            elif w.name in self.library.neutral:
                continue
            elif w.name in CYCLES:
                given = tuple(a(scope) if a else None for a in w.arguments)
                values.calls.append((f"MCALL {w.name}" if modal else w.name, given))
            elif w.name in known.COMMANDS:
                values.names.append(w.name)
                if w.name == "MCALL" and len(words) == 1:
                    values.calls.append(("MCALL", ()))
            elif w.name == "CYCLE800":
                values.calls.append((w.name, tuple(a(scope) if a else None for a in w.arguments)))
            elif w.name not in known.NEUTRAL_CALLS:
                calls.append((w.name, tuple(a(scope) if a else None for a in w.arguments), 1))
        return [(name, given, times) for name, given, _ in calls]

    # --- control -----------------------------------------------------------------------------------------------

    def _control(self, program: Program, scope: Scope, i: int, control: Control, loops: dict[int, float]) -> int | None:
        """The statement that follows control statement i; None at the end of the program."""
        kind, parts, jump = control.kind, control.parts, program.jump
        if kind == "if":
            return i + 1 if parts[0](scope) else jump[i] + 1
        if kind in ("else", "endif"):
            return jump[i] + 1 if kind == "else" else i + 1
        if kind == "while":
            return i + 1 if parts[0](scope) else jump[i] + 1
        if kind in ("endwhile", "endloop", "endfor"):
            return self._back(program, scope, i, jump[i], loops)
        if kind == "for":
            start, end = parts[1](scope), parts[2](scope)
            scope.set(parts[0], (), start)
            loops[i] = end
            return i + 1 if start <= end else jump[i] + 1
        if kind == "until":
            return i + 1 if parts[0](scope) else self._back(program, scope, i, jump[i] + 1, loops)
        if kind in ("goto", "if_goto"):
            if kind == "if_goto" and not parts[0](scope):
                return i + 1
            return self._goto(program, scope, i, str(parts[-2]), parts[-1])
        if kind == "goto_start":
            return self._back(program, scope, i, 0, loops)
        if kind == "case":
            return self._case(program, scope, i, parts)
        if kind in ("repeat_label", "repeat_block"):
            return self._repeat(program, scope, i, control)
        if kind == "def":
            self._define(scope, parts)
        return None if kind == "ret" else i + 1

    def _back(self, program: Program, scope: Scope, i: int, target: int, loops: dict[int, float]) -> int:
        """A jump backwards, refused where nothing at all has changed since the last one from here."""
        opening = program.statements[target]
        if isinstance(opening, Statement) and opening.control is not None and opening.control.kind == "for":
            name = opening.control.parts[0]
            scope.set(name, (), scope.value(name, ()) + 1)
            target = target + 1 if scope.value(name, ()) <= loops[target] else i + 1
        state = (tuple(sorted(self.r.items())), repr(scope.local), self.executor.state())
        key = (id(scope), i)
        if self.seen.get(key) == state and target <= i:
            raise ValueError("endless loop: nothing has changed since the last pass, so it would never end")
        self.seen[key] = state
        return target

    def _goto(self, program: Program, scope: Scope, i: int, how: str, label: str) -> int:
        places = program.labels[label]
        after = [p for p in places if p > i]
        before = [p for p in places if p <= i]
        if how == "GOTOF" and not after:
            raise ValueError(f"label {label} does not follow: GOTOB looks backwards")
        if how == "GOTOB" and not before:
            raise ValueError(f"label {label} does not come before: GOTOF looks forwards")
        target = before[-1] if how == "GOTOB" or not after else after[0]
        return self._back(program, scope, i, target, {}) if target <= i else target

    def _case(self, program: Program, scope: Scope, i: int, parts: tuple[Any, ...]) -> int:
        value, rest = parts[0](scope), list(parts[1:])
        while len(rest) >= 3 and callable(rest[0]):
            expression, how, label, *rest = rest
            if expression(scope) == value:
                return self._goto(program, scope, i, str(how), label)
        return self._goto(program, scope, i, str(rest[0]), rest[1]) if rest else i + 1

    def _repeat(self, program: Program, scope: Scope, i: int, control: Control) -> int:
        """REPEAT label [label] P=n, REPEATB label P=n: a stretch of this program again."""
        labels = [p for p in control.parts if isinstance(p, str)]
        times = next((p for p in control.parts if not isinstance(p, str)), None)
        count = int((times.run if hasattr(times, "run") else times)(scope)) if times else 1
        first = program.labels[labels[0]][-1]
        if control.kind == "repeat_block":
            stop = first + 1
        elif len(labels) == 2:
            stop = program.labels[labels[1]][-1] + 1
        else:
            ends = [
                k for k, s in enumerate(program.statements[first:], first)
                if isinstance(s, Statement) and s.words and s.words[0].name == "ENDLABEL"
            ]  # fmt: skip
            stop = ends[0] if ends else i if first < i else len(program.statements)
        if first <= i < stop:
            raise ValueError("REPEAT stands inside the stretch that it repeats")
        for _ in range(count):
            self.depth += 1
            if self.depth > MAX_DEPTH:
                raise ValueError(f"REPEAT within REPEAT more than {MAX_DEPTH} deep")
            if self._statements(program, scope, first, stop):
                self.ended = True
                return len(program.statements)
            self.depth -= 1
        return i + 1

    def _define(self, scope: Scope, parts: tuple[Any, ...]) -> None:
        kind = str(parts[0])
        for name, size, value in (p for p in parts if isinstance(p, tuple)):
            scope.kinds[name] = kind
            given = value(scope) if value else None
            if size:
                scope.local[name] = {}
                if given is not None:
                    scope.set(name, (), given if isinstance(given, list) else [given])
            else:
                empty = "" if kind in ("STRING", "AXIS", "CHAR") else 0.0
                scope.local[name] = typed(kind, empty if given is None else given)


def _from_plain(statement: tuple[Any, ...]) -> Values:
    values = Values()
    _, g, x, y, z, f = statement
    if g is not None:
        values.g.append(float(g))
    values.at = {k: v for k, v in (("X", x), ("Y", y), ("Z", z), ("F", f)) if v is not None}
    return values


def _check_limits(path: Toolpath, machine: Machine, library: Library) -> None:
    """Travel of the axes and speed of the spindle; the first faults per axis, with the lines that cause them."""
    faults = []
    for axis, name in enumerate(LINEAR_AXES):
        low, high = machine.axes[name].travel_mm
        outside = np.flatnonzero((path.end[:, axis] < low - 1e-6) | (path.end[:, axis] > high + 1e-6))
        for i in outside[:3]:
            faults.append((int(i), f"{name} = {path.end[i, axis]:.3f} mm leaves the travel {low:g} .. {high:g} mm"))
    fast = np.flatnonzero(np.abs(path.spindle_rpm) * 6.0 > machine.spindle_max_deg_s * (1 + 1e-9))
    for i in fast[:3]:
        faults.append(
            (int(i), f"S{abs(path.spindle_rpm[i]):g} is above the spindle's {machine.spindle_max_deg_s / 6:g} 1/min")
        )
    if not faults:
        return
    texts = []
    for i, fault in faults:
        program = library.programs[library.order[path.program[i]]]
        texts.append(f"{program.name}, line {path.nc_line[i]}: '{program.text(int(path.nc_line[i]))}': {fault}")
    raise ProgramError(f"machine {machine.id} cannot run this program (work offsets right?):\n" + "\n".join(texts))
