"""`python docs/notebook.py` writes `docs/guide/library.ipynb`: the cells of `docs/guide/library.py`, for Jupyter."""

import json
import re
from pathlib import Path

SCRIPT = Path(__file__).parent / "guide" / "library.py"


def notebook(script: str) -> str:
    """The script's `# %%` cells as a notebook (nbformat 4.5), without outputs.

    >>> cells = json.loads(notebook("# %% [markdown]\\n# # Title\\n\\n# %%\\nx = 1\\n"))["cells"]
    >>> [cell["cell_type"] for cell in cells]
    ['markdown', 'code']
    """
    cells = []
    for k, text in enumerate(re.split(r"^# %%", script, flags=re.MULTILINE)[1:]):
        head, _, body = text.partition("\n")
        cell = {"cell_type": "code", "id": f"cell-{k}", "metadata": {}}
        if "[markdown]" in head:
            cell["cell_type"], body = "markdown", re.sub(r"^# ?", "", body, flags=re.MULTILINE)
        else:
            cell |= {"execution_count": None, "outputs": []}
        cells.append({**cell, "source": body.strip().splitlines(keepends=True)})
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    whole = {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    SCRIPT.with_suffix(".ipynb").write_text(notebook(SCRIPT.read_text(encoding="utf-8")), encoding="utf-8")
