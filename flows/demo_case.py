"""`python -m flows.demo_case KIND FOLDER`: parts of a simulated mill that conceal one thing, to try `pido diagnose`.

In:  what to conceal (an id of the mechanism vocabulary, or 'none'), how strong, a seed.
Out: FOLDER/parts/<part>/ (recording.parquet, part.json, program.mpf) as a plant would hand them over, and the truth in
     FOLDER/sealed/truth.json, which no command of pido reads.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click

from pido.core.errors import PidoError


@click.command()
@click.argument("kind")
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.option("--strength", default=2.0, show_default=True, help="size of the effect beside the noise, where it acts")
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="of machine, parts, effect and noise"
)
@click.option("--parts", type=click.IntRange(min=1), help="number of parts  [default: three to six]")
def main(kind: str, folder: Path, strength: float, seed: int, parts: int | None) -> None:
    """Parts of a simulated mill in FOLDER/parts, in which KIND is concealed.

    \b
    python -m flows.demo_case stribeck_friction example
    pido diagnose example/parts/* --out example/diagnosis
    """
    from pido.synthetic.cases import draw_case
    from pido.synthetic.write import write_case

    for place in write_case(draw_case(kind, strength, seed, parts=parts), folder):
        click.echo(place)


if __name__ == "__main__":
    try:
        main()
    except PidoError as fault:
        click.echo(f"demo_case: {fault}", err=True)
        sys.exit(1)
