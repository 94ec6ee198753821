"""`pido ingest`: read recordings, check them, keep what can be used and set the rest aside with the reason."""

from __future__ import annotations

from pathlib import Path

import click

from pido.cli.inputs import Input


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path, readable=False))
@click.option("--store", "root", required=True, type=click.Path(path_type=Path, file_okay=False), help="the store")
@click.option("--machine", help="machine of recordings that do not name theirs; its ranges bound what is possible")
@click.option("--settings", type=Input(dir_okay=False), help="TOML with own machines")
@click.option("--rate", "rate_hz", type=click.FloatRange(min=0, min_open=True), help="resample to this rate, Hz")
@click.option("--cutting", is_flag=True, help="refuse recordings in which the simulated tool never cuts")
@click.option("--keep", is_flag=True, help="leave rejected files where they are; the reason goes beside the store only")
@click.option("--json", "as_json", is_flag=True, help="one JSON object per recording, one per line")
def command(
    paths: tuple[Path, ...],
    root: Path,
    machine: str | None,
    settings: Path | None,
    rate_hz: float | None,
    cutting: bool,
    keep: bool,
    as_json: bool,
) -> None:
    """Read recordings, check them, and keep them in the store.

    PATH is a part folder (recording.parquet, part.json) or a file of any known format. All faults of a recording are
    listed. One that cannot be used is moved to STORE/rejected with the reason beside it, and the exit code is 1; the
    others are kept all the same. Where nothing may be taken away, it is copied; a folder of other things stays.

    \b
    pido ingest parts/p01 capture.json --store plant/store
    pido ingest experiment_01.csv --store plant/store --machine smart_mill --keep
    """
    if settings and not machine:
        raise click.UsageError(
            "--settings says what machines are like; name the one of these recordings with --machine"
        )
    import sys

    import orjson

    from pido import config
    from pido.core.errors import PidoError, StoreError, UnavailableError
    from pido.recordings import read_recording
    from pido.recordings.check import check
    from pido.recordings.faults import ERROR
    from pido.store import Store

    own = config.machine_config(machine, settings) if machine else None
    channels = own.channels() if own else {}
    limits = own.build(machine) if own and machine else None
    fastest = limits.spindle_max_deg_s if limits else None
    store = Store(root)
    failed = False
    for path in paths:
        faults = ()
        entry = None
        reason = ""
        broken = False
        notes: tuple[str, ...] = ()
        try:
            recording = read_recording(
                path, machine=machine, channels=channels, rate_hz=rate_hz, spindle_max_deg_s=fastest
            )
            notes = recording.notes
            faults = check(recording, limits, air_cut=not cutting)
            reason = "\n".join(str(f) for f in faults if f.severity == ERROR)
            if not reason:
                entry = store.add(recording, source=path.name)
                if entry.gained:
                    notes = (*notes, f"{entry.part} was stored without {', '.join(entry.gained)}: it has them now")
        except (UnavailableError, OSError):
            raise  # the disk's fault: nothing is rejected for it
        except PidoError as error:
            reason = str(error)
        except Exception as error:  # the others are read all the same
            reason = f"{path}: internal error while it was read ({type(error).__name__}: {error}). Please report it."
            broken = True
        failed |= entry is None
        rejected = None
        if entry is None and not (keep or broken) and path.exists() and not _somebodys_folder(path):
            try:
                rejected = store.reject(path, reason)
            except (StoreError, OSError) as error:
                reason = f"{reason}\nIt was not moved away: {error}"
        state = "rejected" if entry is None else "stored" if entry.new else "completed" if entry.gained else "known"
        if as_json:
            row = {
                "path": str(path),
                "state": state,
                "digest": entry.digest if entry else None,
                "part": entry.part if entry else None,
                "samples": entry.samples if entry else None,
                "reason": reason or None,
                "rejected": str(rejected) if rejected else None,
                "faults": [f.as_dict() for f in faults],
                "notes": [*notes, *([entry.told] if entry and entry.told else [])],
            }
            click.echo(orjson.dumps(row).decode())
            continue
        line = f"{entry.digest[:12]}  {entry.part}  {entry.samples} samples" if entry else f"{path}"
        click.echo(f"{state:10}{line}" + (f"  -> {rejected}" if rejected else ""))
        for note in notes:
            click.echo(f"  note: {note}", err=True)
        for fault in faults:
            click.echo(f"  {fault}", err=True)
        if entry is None and not faults:
            click.echo(f"pido: {reason}", err=True)
    sys.exit(1 if failed else 0)


def _somebodys_folder(path: Path) -> bool:
    """Whether it is a folder with something in it that is no recording."""
    from pido.recordings import READERS

    return path.is_dir() and any(path.iterdir()) and not any(reader.recognises(path) for reader in READERS)
