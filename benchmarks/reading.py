"""Reading speed beside the named peers, alternately in one run, medians of five.

In:  nothing; a capture of 100 MB and an hfdata table of 170 000 x 61 are made in a temporary folder.
Out: rows {work, peer, ratio, goal, error}: ratio is the peer's time over ours, error the largest difference of results.

The public parser's way (max-scw/CaptureDataParser) is written out here: the whole file as Python objects, then a loop
over each cell into one list per signal, then a data frame.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pandas as pd
import pyarrow.csv as pc

from benchmarks.table import alternately, both_clocks
from pido.recordings import hfdata, sinumerik

AXES = {1: "X1", 2: "Y1", 3: "Z1", 4: "C1", 5: "B1", 6: "SP1"}
KINDS = ("CMD_SPEED", "CONT_DEV", "VEL_FFW", "TORQUE_FFW", "TORQUE", "POWER", "CURRENT", "LOAD", "ENC_POS", "DES_POS")
SIGNALS = ["CYCLE", *(f"{kind}|{n}" for kind in KINDS for n in AXES)]


QUICK = {"mb": 5.0, "rows": 5_000, "repeats": 2}


def run(mb: float = 100.0, rows: int = 170_000, repeats: int = 5) -> list[dict[str, Any]]:
    """Every line of the table; smaller sizes for a quick look."""
    with tempfile.TemporaryDirectory() as folder:
        return [*_capture(Path(folder), mb, repeats), *_table(Path(folder), rows, repeats)]


def _capture(folder: Path, mb: float, repeats: int) -> list[dict[str, Any]]:
    path = _write_capture(folder / "capture.json", mb)
    ours = sinumerik.READER.read(path, None, {})["curr_y"]
    peers: dict[str, tuple[Callable[[], Any], float]] = {
        "public parser's way": (lambda: _public_way(path), 12.0),
        "orjson.loads alone": (lambda: orjson.loads(path.read_bytes()), 1.0),
    }
    ways = {"ours": lambda: sinumerik.READER.read(path, None, {}), **{k: f for k, (f, _) in peers.items()}}
    times = {name: cpu for name, (_, cpu) in both_clocks(ways, repeats).items()}  # all of them have one thread
    error = float(np.abs(_public_way(path)["CURRENT|2"].to_numpy() - ours).max())
    work = f"SINUMERIK JSON, {path.stat().st_size / 1e6:.0f} MB"
    return [
        {"work": work, "peer": name, "ratio": times[name] / times["ours"], "goal": goal, "error": error}
        for name, (_, goal) in peers.items()
    ]


def _table(folder: Path, rows: int, repeats: int) -> list[dict[str, Any]]:
    path = folder / "IMP-01_hfdata.csv"
    rng = np.random.default_rng(0)
    frame = pd.DataFrame(np.round(rng.normal(size=(rows, len(SIGNALS))) * 100, 6), columns=pd.Index(SIGNALS))
    frame["CYCLE"] = np.arange(rows)
    frame.to_csv(path, index=False)
    needed = ["CYCLE", *(f"{kind}|{n}" for kind in ("ENC_POS", "CURRENT") for n in (1, 2, 3, 6))]
    peers: dict[str, Callable[[], Any]] = {
        "pyarrow, same columns": lambda: pc.read_csv(path, convert_options=pc.ConvertOptions(include_columns=needed))
    }
    try:
        import polars

        peers["polars, same columns"] = lambda: polars.scan_csv(path).select(needed).collect()
    except ImportError:
        pass  # polars comes with the extra `experiments`; pyarrow is peer enough
    times = alternately({"ours": lambda: hfdata.READER.read(path, None, {}), **peers}, repeats)
    error = float(np.abs(hfdata.READER.read(path, None, {})["curr_y"] - frame["CURRENT|2"].to_numpy()).max())
    work = f"hfdata CSV, {rows} x {len(SIGNALS)}, {len(needed)} columns needed"
    return [{"work": work, "peer": p, "ratio": times[p] / times["ours"], "goal": 0.95, "error": error} for p in peers]


def _write_capture(path: Path, mb: float) -> Path:
    rng = np.random.default_rng(0)
    header = {
        "SignalListHFData": [
            {"Name": s, "Type": "DOUBLE", "Axis": AXES.get(int(s[-1]) if "|" in s else 0, "Cycle"), "Address": s}
            for s in SIGNALS
        ],
        "CycleTimeMs": 2,
    }
    block = np.round(rng.normal(size=(100, len(SIGNALS))) * 1000, 6).tolist()
    with path.open("wb") as file:
        file.write(b'{\n"Header":\n' + orjson.dumps(header) + b',\n"Payload":\n[')
        count = 0
        while file.tell() < mb * 1e6:
            rows = [[count + k, *row[1:]] for k, row in enumerate(block)]
            file.write((b",\n" if count else b"") + orjson.dumps({"HFData": rows}))
            count += len(rows)
        file.write(b'],\n"Footer":{}\n}\n')
    return path


def _public_way(path: Path) -> pd.DataFrame:
    content = json.loads(path.read_text(encoding="utf-8"))
    names = [signal["Name"] for signal in content["Header"]["SignalListHFData"]]
    cells: dict[str, list[float]] = {name: [] for name in names}
    for message in content["Payload"]:
        for row in message.get("HFData", []):
            for name, cell in zip(names, row, strict=True):
                cells[name].append(cell)
    return pd.DataFrame(cells)


if __name__ == "__main__":
    for line in run():
        print(
            f"{line['work']}: {line['ratio']:.2f} x {line['peer']} (goal {line['goal']:g}), error {line['error']:.1g}"
        )
