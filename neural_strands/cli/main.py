"""Entry point: picks the verb, runs it, and turns bad input into one sentence."""

import importlib
import sys
from collections.abc import Sequence
from typing import Protocol

import tyro

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.memory import keep_freed_memory

COMMANDS = {
    "info": "neural_strands.cli.info:Info",
    "synthesize": "neural_strands.cli.synthesize:Synthesize",
    "convert": "neural_strands.cli.convert:Convert",
    "prepare": "neural_strands.cli.prepare:Prepare",
    "check": "neural_strands.cli.check:Check",
    "head": "neural_strands.cli.head:HeadCheck",
    "score": "neural_strands.cli.score:Score",
    "score-views": "neural_strands.cli.score_views:ScoreViews",
    "lmvs": "neural_strands.cli.lmvs:Lmvs",
    "train-prior": "neural_strands.cli.train_prior:TrainPrior",
    "prior-report": "neural_strands.cli.prior_report:PriorReport",
    "prior-traverse": "neural_strands.cli.prior_traverse:PriorTraverse",
    "render": "neural_strands.cli.render:Render",
    "fit": "neural_strands.cli.fit:Fit",
    "evaluate": "neural_strands.cli.evaluate:Evaluate",
    "demo": "neural_strands.cli.demo:Demo",
}
"""Each verb and the dataclass that holds its arguments."""


class Command(Protocol):
    """A parsed verb."""

    def run(self) -> None:
        """Do the work; raises InputError for bad input."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status: 0 done, 2 bad input."""
    keep_freed_memory()
    words = list(sys.argv[1:] if arguments is None else arguments)
    named = words[0] if words and words[0] in COMMANDS else None
    commands = {name: _load(COMMANDS[name]) for name in COMMANDS if named in (None, name)}
    try:
        command: Command = (
            tyro.cli(commands[named], prog=f"neural-strands {named}", args=words[1:])
            if named
            else tyro.extras.subcommand_cli_from_dict(commands, prog="neural-strands", args=words)
        )
        command.run()
    except InputError as error:
        sys.stderr.write(f"neural-strands: {error}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write("neural-strands: stopped; finished parts are kept.\n")
        return 130
    return 0


def _load(location: str) -> type:
    module, _, name = location.partition(":")
    return getattr(importlib.import_module(module), name)
