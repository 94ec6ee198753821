"""NC text -> statements, with all faults of a file found before anything is executed.

In:  a program's text (UTF-8 or cp1252 file), the names of the subprograms that exist.
Out: `Program`: one statement per line that says something. Plain lines (G0/G1 X Y Z F) are tuples, recognised by one
     regular expression, so that a million of them take seconds; lines of letter-number words are lists of pairs; all
     others go through the grammar.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from pido.core.errors import ProgramError
from pido.nc import words as known
from pido.nc.cycles import CYCLES
from pido.nc.grammar import Control, Word, parse

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"
_PLAIN = re.compile(
    rf"\s*(?:N\d+\s*)?(?:G0*([01])(?![\d.])\s*)?(?:X({_NUMBER})\s*)?(?:Y({_NUMBER})\s*)?(?:Z({_NUMBER})\s*)?"
    rf"(?:F({_NUMBER})\s*)?(?:;.*)?"
)
_PAIRS = re.compile(rf"(?:[A-Z]{_NUMBER}(?![\d.])\s*)+")
_PAIR = re.compile(rf"([A-Z])({_NUMBER})")
_SKIP = re.compile(r"/\d?\s*")
_BLOCK_NUMBER = re.compile(r"[N:](\d+)\s*")
_LABEL = re.compile(r"([A-Z_][A-Z0-9_]*):(?!=)\s*")
_SECTION = re.compile(r"\s*(?:%_N_(\w+?)_(?:MPF|SPF)\b|O(\d{1,8})\s*(?:\(.*\))?\s*$)", re.IGNORECASE)
_COMMENT_AFTER = re.compile(r"(?:^|[^A-Z0-9_$])[A-Z]=?[-+]?[\d.]+\s*$|[)\]\"]\s*$|^\s*$")
_CALL_BEFORE = re.compile(r"(?:^|[^A-Z0-9_])L\d+\s*$")

_CALLS = known.NEUTRAL_CALLS | frozenset(CYCLES) | {"CYCLE800"}

Plain = tuple[int, int | None, float | None, float | None, float | None, float | None]


class Statement(NamedTuple):
    """One line that is not plain: its words (pairs of letter and number, or grammar words) or its control statement."""

    line: int
    pairs: list[tuple[str, float]] | None = None
    words: tuple[Word, ...] | None = None
    control: Control | None = None
    skippable: bool = False


@dataclass
class Program:
    """Statements of one program. `jump` leads a control statement to its partner, `labels` names to positions."""

    name: str
    lines: list[str]
    first_line: int = 1
    statements: list[Plain | Statement] = field(default_factory=list)
    labels: dict[str, list[int]] = field(default_factory=dict)
    jump: dict[int, int] = field(default_factory=dict)
    parameters: tuple[tuple[str, str, Any], ...] = ()
    calls: dict[str, int] = field(default_factory=dict)
    changes_tool_with_m6: bool = False
    neutral: frozenset[str] = frozenset()

    def text(self, line: int) -> str:
        return self.lines[line - self.first_line].strip()


def read_text(path: Path) -> str:
    """The text of a program file, UTF-8 or cp1252. Raises ProgramError where there is no such file."""
    try:
        raw = path.read_bytes()
    except (FileNotFoundError, IsADirectoryError):
        raise ProgramError(f"{path}: no such NC program.") from None
    if b"\0" in raw:
        raise ProgramError(f"{path}: not an NC program: the file is binary.")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def split_sections(name: str, text: str) -> list[Program]:
    """The programs in one text: archives hold several, each after `%_N_NAME_MPF` (or SPF) or `O1234`."""
    lines = text.splitlines()
    heads = [(i, m) for i, line in enumerate(lines) if line[:1] in "%O o\t" and (m := _SECTION.match(line))]
    if not heads:
        return [Program(name, lines)]
    programs = []
    for (i, match), end in zip(heads, [*(i for i, _ in heads[1:]), len(lines)], strict=True):
        title = match[1].upper() if match[1] else f"O{match[2]}"
        programs.append(Program(title, lines[i + 1 : end], first_line=i + 2))
    head = [line for line in lines[: heads[0][0]] if line.strip() and not line.lstrip().startswith((";", "(", "%"))]
    if head:  # statements before the first heading belong to the main program
        programs.insert(0, Program(name, lines[: heads[0][0]]))
    return programs


def understand(program: Program) -> list[str]:
    """Fill `program` from its lines; returns every fault of the text, in order of lines."""
    faults: list[tuple[int, str]] = []
    add = program.statements.append
    plain = _PLAIN.fullmatch
    for number, raw in enumerate(program.lines, program.first_line):
        if match := plain(raw):
            g, x, y, z, f = match.groups()
            if x or y or z or g or f:
                add(
                    (
                        number,
                        int(g) if g else None,
                        float(x) if x else None,
                        float(y) if y else None,
                        float(z) if z else None,
                        float(f) if f else None,
                    )
                )
            continue
        try:
            statement = _statement(number, raw, program)
        except ValueError as fault:
            faults.append((number, str(fault)))
            continue
        if statement is not None:
            add(statement)
    _number_blocks(program)
    faults += _match_structure(program) + _check_words(program)
    return [f"{program.name}, line {n}: '{program.text(n)}': {fault}" for n, fault in sorted(set(faults))]


def _statement(number: int, raw: str, program: Program) -> Statement | None:
    text = _without_comment(raw).strip()
    if not text or text[0] == "%":
        return None
    skippable = False
    if match := _SKIP.match(text):
        skippable, text = True, text[match.end() :]
    if match := _BLOCK_NUMBER.match(text):
        text = text[match.end() :]
    while match := _LABEL.match(text):
        program.labels.setdefault(match[1], []).append(len(program.statements))
        text = text[match.end() :]
    if not text:
        return None
    if _PAIRS.fullmatch(text) and "L" not in text and "E" not in text:
        pairs = [(letter, float(value)) for letter, value in _PAIR.findall(text)]
        if ("M", 6.0) in pairs:
            program.changes_tool_with_m6 = True
        return Statement(number, pairs=pairs, skippable=skippable)
    parsed = parse(text)
    if isinstance(parsed, Control):
        if parsed.kind == "proc":
            program.parameters = tuple(p for p in parsed.parts[1:] if isinstance(p, tuple))
        return Statement(number, control=parsed, skippable=skippable)
    if any(w.name == "M" and w.number == 6 for w in parsed):
        program.changes_tool_with_m6 = True
    return Statement(number, words=parsed, skippable=skippable)


def _without_comment(raw: str) -> str:
    """The line in capitals outside quotes, without `; ...` and without ISO `( ... )` remarks."""
    if '"' not in raw and "(" not in raw:
        return raw.partition(";")[0].upper()
    out, quoted, i = [], False, 0
    while i < len(raw):
        c = raw[i]
        if c == '"':
            quoted = not quoted
        elif not quoted and c == ";":
            break
        elif not quoted and c == "(":
            before = "".join(out)
            if _COMMENT_AFTER.search(before) and not _CALL_BEFORE.search(before):
                end = raw.find(")", i)
                i = len(raw) if end < 0 else end + 1
                continue
        out.append(c if quoted else c.upper())
        i += 1
    return "".join(out)


def _number_blocks(program: Program) -> None:
    """Block numbers that a jump names become labels."""
    wanted = {t for s in program.statements if isinstance(s, Statement) and s.control for t in _targets(s.control)}
    wanted = {t for t in wanted if re.fullmatch(r"[N:]?\d+|N\d+", t)}
    if not wanted:
        return
    lines = [s[0] for s in program.statements]
    position = {line: i for i, line in reversed(list(enumerate(lines)))}
    for number, raw in enumerate(program.lines, program.first_line):
        match = _BLOCK_NUMBER.match(raw.lstrip(" \t/").upper())
        if match and f"N{match[1]}" in wanted:
            at = next(
                (position[n] for n in range(number, program.first_line + len(program.lines)) if n in position),
                len(lines),
            )
            program.labels.setdefault(f"N{match[1]}", []).append(at)


def _targets(control: Control) -> list[str]:
    if control.kind in ("goto", "if_goto"):
        return [control.parts[-1]]
    if control.kind == "case":
        return [
            t for sign, t in zip(control.parts, control.parts[1:], strict=False) if getattr(sign, "type", "") == "GOTO"
        ]
    if control.kind in ("repeat_label", "repeat_block"):
        return [p for p in control.parts if isinstance(p, str)]
    return []


_OPENS = {"if": "endif", "while": "endwhile", "for": "endfor", "loop": "endloop", "repeat": "until"}
_CLOSES = {close: opening for opening, close in _OPENS.items()}


def _match_structure(program: Program) -> list[tuple[int, str]]:
    """Partners of IF, WHILE, FOR, LOOP and REPEAT in `program.jump`; faults where one is missing."""
    faults, stack = [], []
    for i, statement in enumerate(program.statements):
        if not isinstance(statement, Statement) or statement.control is None:
            continue
        kind = statement.control.kind
        if kind in _OPENS:
            stack.append((kind, i, statement.line))
        elif kind == "else":
            if not stack or stack[-1][0] != "if":
                faults.append((statement.line, "ELSE without an open IF"))
                continue
            program.jump[stack[-1][1]] = i
            stack[-1] = ("if", i, stack[-1][2])
        elif kind in _CLOSES:
            if not stack or stack[-1][0] != _CLOSES[kind]:
                faults.append((statement.line, f"{kind.upper()} without an open {_CLOSES[kind].upper()}"))
                continue
            opening = stack.pop()[1]
            program.jump[opening] = i
            program.jump.setdefault(i, opening)
        for target in _targets(statement.control):
            if target not in program.labels:
                faults.append((statement.line, f"there is no label {target} in {program.name}"))
    faults += [(line, f"{kind.upper()} is never closed by {_OPENS[kind].upper()}") for kind, _, line in stack]
    return faults


def _check_words(program: Program) -> list[tuple[int, str]]:
    """Words and variables that nothing explains; calls of subprograms go to `program.calls`."""
    faults: list[tuple[int, str]] = []
    variables = {name for _, name, _ in program.parameters} | set(known.SYSTEM_VARIABLES)
    for s in program.statements:
        if isinstance(s, Statement) and s.control and s.control.kind == "def":
            variables |= {part[0] for part in s.control.parts if isinstance(part, tuple)}

    def explained(name: str) -> bool:
        return name in variables or bool(re.fullmatch(r"R\d*", name))

    for s in program.statements:
        if not isinstance(s, Statement):
            continue
        if s.pairs is not None:
            if ("M", 98.0) in s.pairs:
                program.calls.setdefault(f"L{dict(s.pairs).get('P', 0.0):g}", s.line)
            faults += [
                (s.line, fault) for letter, value in s.pairs if (fault := _unknown(letter, value, program.neutral))
            ]
            continue
        reads = (
            s.control.reads
            if s.control
            else frozenset().union(*(w.reads for w in s.words or () if w.name not in known.NEUTRAL_CALLS))
        )
        for name in sorted(reads):
            if name.endswith("()"):
                faults.append((s.line, f"function {name} is not known"))
            elif not explained(name):
                faults.append((s.line, f"variable {name} is not defined; DEF REAL {name} defines it"))
        if s.control and s.control.kind == "for" and not explained(s.control.parts[0]):
            faults.append(
                (s.line, f"variable {s.control.parts[0]} is not defined; DEF INT {s.control.parts[0]} defines it")
            )
        previous = ""
        for w in s.words or ():
            fault = ""
            if w.how == "number":
                if w.name == "L":
                    program.calls.setdefault(f"L{w.number:g}", s.line)
                else:
                    fault = _unknown(w.name, w.number, program.neutral)
            elif w.how == "assign":
                ok = w.name in known.ADDRESSES | known.NAMED_ADDRESSES or explained(w.name) or w.name[1:].isdigit()
                fault = "" if ok else f"'{w.name}=' is not understood"
            elif w.how == "text":
                if previous == "CALL":
                    program.calls.setdefault(w.name.upper(), s.line)
                else:
                    fault = f'"{w.name}" stands alone; text belongs to T="...", MSG("...") or CALL "..."'
            elif w.name in _CALLS or (w.name in known.COMMANDS and w.how == "name"):
                pass
            else:
                program.calls.setdefault(w.name, s.line)
            if fault:
                faults.append((s.line, fault))
            previous = w.name
    return faults


def _unknown(letter: str, value: float, neutral: frozenset[str]) -> str:
    if f"{letter}{value:g}" in neutral:
        return ""
    if letter == "G" and value not in known.KNOWN_G:
        return f"G{value:g} is not understood"
    if letter == "M" and value not in known.KNOWN_M:
        return (
            f"M{value:g} is not understood; if it changes neither path, spindle, tool nor coolant, name it in `neutral`"
        )
    if letter not in known.ADDRESSES and letter not in "GM":
        return f"address {letter} is not understood"
    return ""
