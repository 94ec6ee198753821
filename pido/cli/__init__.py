"""The command line: one module per verb, imported only when its verb is called, so that `pido --help` is quick.

Exit codes: 0 done (also when the answer is "nothing found"), 1 input that cannot be used, 2 a wrong call.
The result goes to stdout, everything else to stderr.
Completion: `eval "$(_PIDO_COMPLETE=bash_source pido)"` in bash; zsh_source in zsh, fish_source in fish.
"""

from __future__ import annotations

import difflib
import importlib
import sys

import click

from pido import __version__
from pido.core.errors import PidoError
from pido.core.files import refusal

VERBS = {
    "ingest": "read recordings, check them, and keep them in the store",
    "iterate": "one production iteration for each part: refit, balance, retrain, evaluate, log",
    "watch": "see parts arrive in an inbox and run an iteration for each",
    "plan": "what a coming part needs: relevant bins, and what PiDO would generate where",
    "simulate": "an NC program to motion, engagement, forces and the 13 inputs",
    "diagnose": "compare simulation with recording and name the physics that is missing",
    "correct": "apply a diagnosis to a part that was not diagnosed",
    "accept-physics": "extend the physical equation with an accepted finding",
    "monitor": "watch the residual of a part against the champion's band",
    "status": "which model is champion, which waits for approval",
    "approve": "promote a model version that passed its gate",
    "reject": "refuse a model version, with the reason",
    "rollback": "bring the previous champion back",
    "withdraw": "take a part out that was recorded or exported wrongly, or bring it back",
    "experiment": "run an experiment of the paper, or the tool's own proofs",
    "report": "write the page of an iteration, a plan, an experiment or a monitor run",
}

EXTRAS = {
    "prefect": "servers",
    "mlflow": "servers",
    "httpx": "servers",
    "asyncpg": "servers",
    "prefect_dask": "cluster",
    "dask": "cluster",
    "distributed": "cluster",
    "optuna": "experiments",
    "dcor": "experiments",
}
"""Libraries that the package does without, and the extra that brings them."""


class Verbs(click.Group):
    """Commands found by name; their modules are imported only when called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in VERBS:
            return None
        return importlib.import_module(f"pido.cli.{cmd_name.replace('-', '_')}").command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in VERBS and not args[0].startswith("-"):
            near = difflib.get_close_matches(args[0], VERBS, n=1)
            meant = f" Did you mean '{near[0]}'?" if near else " `pido --help` lists the verbs."
            raise click.UsageError(f"No such verb '{args[0]}'.{meant}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Verbs"):
            formatter.write_dl(list(VERBS.items()))


@click.group(cls=Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="pido")
def pido() -> None:
    """Current models of a CNC machine that stay right while parts arrive, and the physics a simulation left out.

    \b
    pido iterate parts/p01 parts/p02 --workspace plant
    pido diagnose parts/p01 parts/p02 parts/p03 --out diagnosis
    """


def main() -> None:
    """Entry point: a deliberate error, one of the operating system, or an extra that is not installed, is one message
    on stderr and exit code 1."""
    try:
        pido(prog_name="pido")
    except PidoError as error:
        click.echo(f"pido: {error}", err=True)
        sys.exit(1)
    except OSError as error:
        click.echo(f"pido: {refusal(error)}", err=True)
        sys.exit(1)
    except ModuleNotFoundError as error:
        library = (error.name or "").partition(".")[0]
        if library not in EXTRAS:
            raise
        click.echo(
            f"pido: this needs {library}, which is not installed: pip install 'pido[{EXTRAS[library]}]'", err=True
        )
        sys.exit(1)
