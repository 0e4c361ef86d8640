"""Entry point: picks the command, runs it, and reports bad input in one sentence.

Little is imported here, and nothing slow: what a command needs is loaded where Ctrl-C already ends in one sentence.
"""

import importlib
import sys
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple, Protocol, runtime_checkable

from neural_strands import __version__
from neural_strands.cli.interrupts import INTERRUPTED, ends_as_interrupted, interruptible_loading
from neural_strands.cli.streams import ReaderGoneError, guarded_output
from neural_strands.foundation.errors import InputError

PROGRAM = "neural-strands"
READER_GONE = 141
"""Exit status where nobody reads the output any more: 128 and the number of SIGPIPE."""
STOPPED = f"{PROGRAM}: stopped; finished parts are kept."


class Entry(NamedTuple):
    """One command.

    Attributes:
        location: module in `cli.commands` and dataclass of its arguments.
        summary: what it does, for the list of commands.
    """

    location: str
    summary: str


COMMANDS = {
    "prepare": Entry("prepare:Prepare", "turn photographs into a capture"),
    "fit-head": Entry("fit_head:FitHead", "fit a head to a capture that has none"),
    "check": Entry("check:Check", "list what is in a capture and what is wrong with it"),
    "fit": Entry("fit:Fit", "reconstruct the hair of a capture"),
    "evaluate": Entry("evaluate:Evaluate", "score a fit and write its report"),
    "render": Entry("render:Render", "render a fitted model from any camera"),
    "edit": Entry("edit:Edit", "cut, restyle or otherwise edit fitted hair"),
    "export": Entry("export:Export", "write hair for Blender, Unreal, web pages and other programs"),
    "view": Entry("view:View", "show a run, a groom or a capture in the browser"),
    "batch": Entry("batch:Batch", "reconstruct many subjects on one machine or many"),
    "demo": Entry("demo:Demo", "make a small capture, reconstruct and score it"),
    "info": Entry("info:Info", "print the contents of a groom"),
    "convert": Entry("convert:Convert", "convert a groom into another format"),
    "score": Entry("score:Score", "compare strands with true strands"),
    "score-views": Entry("score_views:ScoreViews", "compare renderings with photographs"),
    "head": Entry("head:HeadCheck", "find or check the scalp of a head"),
    "lmvs": Entry("lmvs:Lmvs", "run line-based multi-view stereo alone"),
    "synthesize": Entry("synthesize:Synthesize", "render a capture with true strands"),
    "train-prior": Entry("prior.train:TrainPrior", "train the strand prior"),
    "train-networks": Entry("train_networks:TrainNetworks", "train the networks from which fits start"),
    "prior-report": Entry("prior.report:PriorReport", "measure how well the prior reproduces a groom"),
    "prior-traverse": Entry("prior.traverse:PriorTraverse", "draw the prior's latent space"),
}
"""The commands, in the order in which help lists them."""


@runtime_checkable
class Command(Protocol):
    """A parsed command."""

    def run(self) -> None:
        """Do the work; raises InputError for bad input."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status: 0 done, 2 bad input, 130 interrupted, 141 output not read."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with guarded_output(), interruptible_loading(STOPPED) as loaded, ends_as_interrupted():
            if not words or words[0] in ("-h", "--help"):
                sys.stdout.write(_help())
            elif words[0] == "--version":
                sys.stdout.write(f"{PROGRAM} {__version__}\n")
            elif (command := _parse(words[0], words[1:])) is not None:
                loaded()
                command.run()
    except InputError as error:
        sys.stderr.write(f"{PROGRAM}: {error}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write(f"{STOPPED}\n")
        return INTERRUPTED
    except ReaderGoneError:
        return READER_GONE
    return 0


def _parse(command: str, words: list[str]) -> Command | None:
    """The command that the words spell; None where they asked for help, which is printed then."""
    if command not in COMMANDS:
        import difflib

        near = difflib.get_close_matches(command, COMMANDS, 1, 0)[0]
        raise InputError(f"{command!r}: expected a command, such as {near}; `{PROGRAM} --help` lists them.")
    from neural_strands.cli.arguments import parse
    from neural_strands.foundation.memory import keep_freed_memory
    from neural_strands.foundation.threads import sleep_when_idle

    keep_freed_memory()
    sleep_when_idle()
    module, _, name = COMMANDS[command].location.partition(":")
    kind = getattr(importlib.import_module(f"neural_strands.cli.commands.{module}"), name)
    return getattr(kind, "parse", partial(parse, kind))(f"{PROGRAM} {command}", words)


def _help() -> str:
    width = max(map(len, COMMANDS)) + 2
    commands = "".join(f"  {name:<{width}}{command.summary}\n" for name, command in COMMANDS.items())
    return (
        f"usage: {PROGRAM} COMMAND ...\n\n"
        "From photographs of a head to hair strands rooted on the scalp, and an appearance that renders them.\n\n"
        f"commands:\n{commands}\n"
        f"`{PROGRAM} COMMAND --help` says what a command takes; `{PROGRAM} --version` which version this is.\n"
    )
