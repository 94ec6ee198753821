"""All programs that a main program may reach, understood before anything is executed.

In:  a program (file or text), subprograms by name or in folders. Out: `Program`s in the order in which they were found.
Whatever is not understood or missing is one `ProgramError` that lists all of it, with line and text.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pido.core.errors import ProgramError
from pido.nc.source import Program, read_text, split_sections, understand

_SUFFIXES = ("", ".SPF", ".spf", ".MPF", ".mpf", ".NC", ".nc")


class Library:
    """Programs by name; `order` is that in which they are reached, and numbers them in a path."""

    def __init__(self, subprograms: Path | Mapping[str, str] | None, neutral: frozenset[str]) -> None:
        self.texts = {k.upper(): v for k, v in subprograms.items()} if isinstance(subprograms, Mapping) else {}
        self.folders = [Path(subprograms)] if subprograms is not None and not isinstance(subprograms, Mapping) else []
        self.neutral = neutral
        self.programs: dict[str, Program] = {}
        self.order: list[str] = []

    def load(self, source: Path | str) -> Program:
        name, text = "program", ""
        if isinstance(source, Path) or ("\n" not in source and len(source) < 1000 and Path(source).is_file()):
            file = Path(source)
            name, text = file.name, read_text(file)
            self.folders.append(file.parent)
        elif "\n" not in source and Path(source).suffix.lower() in (".mpf", ".spf", ".nc"):
            raise ProgramError(f"{source}: no such NC program.")
        else:
            text = source
        sections = split_sections(name, text)
        self.programs |= {p.name: p for p in sections}
        faults: list[str] = []
        waiting = [sections[0]]
        while waiting:
            program = waiting.pop(0)
            self.order.append(program.name)
            program.neutral = self.neutral
            faults += understand(program)
            for called, line in program.calls.items():
                if called in self.neutral or called in self.order or any(p.name == called for p in waiting):
                    continue
                found = self.find(called)
                if found is None:
                    faults.append(
                        f"{program.name}, line {line}: '{program.text(line)}': {called} is neither a word that is "
                        "understood nor a subprogram that is there; put its file beside the program, or name it in "
                        "`neutral`"
                    )
                else:
                    self.programs[called] = found
                    if found.name not in self.order and all(p is not found for p in waiting):
                        waiting.append(found)
        if faults:
            raise ProgramError(f"{len(faults)} fault(s), nothing was executed:\n" + "\n".join(faults))
        return sections[0]

    def find(self, name: str) -> Program | None:
        for candidate in (name, name.removeprefix("L")):
            if (program := self.programs.get(candidate if candidate == name else f"O{candidate}")) is not None:
                return program
        if name in self.texts:
            return Program(name, self.texts[name].splitlines())
        for folder in self.folders:
            if not folder.is_dir():
                continue
            wanted = {f"{name}{s}".casefold() for s in _SUFFIXES}
            for file in sorted(folder.iterdir()):
                if file.name.casefold() in wanted and file.is_file():
                    return Program(name, read_text(file).splitlines())
        return None
