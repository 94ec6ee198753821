"""The library's reference from its docstrings: `make docs`, or `python docs/reference.py FOLDER`.

Every module of the package but the command line, whose reference is `pido --help`. A warning is an error.
"""

from __future__ import annotations

import pkgutil
import sys
import warnings
from pathlib import Path

import pdoc

import pido


def modules() -> list[str]:
    """Names of all modules of the library, the package itself first."""
    names = ["pido", *(module.name for module in pkgutil.walk_packages(pido.__path__, "pido."))]
    wanted: list[str] = []
    covered: set[str] = set()
    for name in names:
        # a package brings its modules along, unless its __all__ says which names are public
        if name not in covered and not name.startswith("pido.cli"):
            wanted.append(name)
            covered |= set(pdoc.extract.walk_specs([name]))
    return wanted


def build(folder: Path) -> None:
    """One page per module, a search index and a start page below `folder`."""
    # formulas in docstrings are indented text, which Markdown shows as it stands
    pdoc.render.configure(docformat="numpy", footer_text=f"pido {pido.__version__}", search=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # the constructor that NamedTuple makes has no module in which its annotations could be looked up
        warnings.filterwarnings("ignore", message=r"Error parsing type annotation .*pido\.nc\.source\.Statement")
        pdoc.pdoc(*modules(), output_directory=folder)


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "out/docs")
    build(target)
    print(target / "index.html")
