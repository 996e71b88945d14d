"""The command ``better``: a table of verbs, of which only the chosen one is imported."""

from __future__ import annotations

import importlib
import inspect
import logging
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_type_hints

import tyro

from betterbench.cli.border import guarded
from betterbench.cli.console import ERR, LONGEST_MESSAGE, say
from betterbench.errors import BetterError, printable, system_error_text


@dataclass(frozen=True, slots=True)
class Verb:
    """A verb; ``function`` is "module:name" within this package, ``takes_tasks`` whether users' files may matter."""

    function: str
    summary: str
    takes_tasks: bool = True

    def load(self) -> Callable[..., None]:
        """Import the function."""
        module, _, name = self.function.partition(":")
        function: Callable[..., None] = getattr(importlib.import_module(f"betterbench.cli.{module}"), name)
        return guarded(_with_task_files(function) if self.takes_tasks else function)


VERBS: dict[str, Verb] = {
    "doctor": Verb("doctor:doctor_command", "Check what works on this machine, or try a policy."),
    "list": Verb("listing:list_command", "List tasks, variations, policies, assets or templates."),
    "show": Verb("show:show_command", "Draw a training scene beside a test scene."),
    "certify": Verb("certify:certify_command", "Certify that each trial can be solved with trained motions."),
    "calibrate": Verb("calibrate:calibrate_command", "Measure the diagnosis on policies with a known fault."),
    "eval": Verb("evaluate:evaluate_command", "Evaluate a policy, resume a run or repeat one."),
    "diagnose": Verb("diagnose:diagnose_command", "Say why each trial of a run succeeded or failed."),
    "compare": Verb("compare:compare_command", "Compare policies on the trials that their runs share."),
    "report": Verb("report:report_command", "Write a page with tables, figures and film strips of runs."),
    "replay": Verb("replay:replay_command", "Simulate a record again and compare, or write its video."),
    "serve": Verb("serve:serve_command", "Serve a policy behind the openpi protocol."),
    "demo": Verb("demo:demo_command", "Evaluate four policies on two tasks and report on them.", takes_tasks=False),
    "audit-paper": Verb(
        "audit_paper:audit_command", "Check the printed numbers of the paper's tables.", takes_tasks=False
    ),
}
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb, and return the exit status: 0, or 2 where the input was wrong."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    os.environ.setdefault("LP_NUM_THREADS", "0")
    logging.basicConfig(level=logging.WARNING, handlers=[_log_handler()])
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if given and given[0] in VERBS:
            tyro.cli(VERBS[given[0]].load(), prog=f"better {given[0]}", args=given[1:])
        else:
            _show_overview(given)
    except BetterError as error:
        ERR.print("[bold red]error:[/] ", end="")
        say(str(error))
        return EXIT_BAD_INPUT
    except OSError as problem:
        # The rule for whatever the system refuses: a path that is missing, too long, a loop or not ours to write.
        if isinstance(problem, BrokenPipeError):
            sys.stderr.close()
            return 0
        ERR.print("[bold red]error:[/] ", end="")
        say(system_error_text(problem))
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        say("interrupted; run the same command again to continue where it stopped")
        return EXIT_INTERRUPTED
    return 0


def _log_handler() -> logging.Handler:
    """Return what writes log messages to standard error, without what steers a terminal."""

    class Printable(logging.Formatter):
        def format(self, record: logging.LogRecord) -> str:
            return printable(super().format(record), most=LONGEST_MESSAGE)

    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(Printable("%(message)s"))
    return handler


def _show_overview(given: Sequence[str]) -> None:
    """Print the verbs, or what is wrong with a command line that names none of them; always exits."""

    def stand_in(summary: str) -> Callable[[], None]:
        def verb() -> None: ...

        verb.__doc__ = summary
        return verb

    tyro.extras.subcommand_cli_from_dict(
        {name: stand_in(verb.summary) for name, verb in VERBS.items()},
        prog="better",
        description="Find out why a Vision-Language-Action policy fails.\n\nExample: better eval --help",
        args=list(given),
    )


def _with_task_files(function: Callable[..., None]) -> Callable[..., None]:
    """Return a verb that also takes ``--task-file``, and loads these files before it does anything else."""
    hints = get_type_hints(function, include_extras=True)
    hints["task_file"] = tyro.conf.UseAppendAction[tuple[Path, ...]]

    def verb(*args: object, task_file: tuple[Path, ...] = (), **options: object) -> None:
        from betterbench.tasks.user_files import load_task_files

        load_task_files(task_file)
        function(*args, **options)

    option = inspect.signature(verb).parameters["task_file"]
    signature = inspect.signature(function)
    text = "    task_file: Python file that defines tasks or assets of your own; may be given several times."
    verb.__doc__ = f"{inspect.cleandoc(function.__doc__ or '')}\n{text}"
    verb.__annotations__ = hints
    vars(verb)["__signature__"] = signature.replace(parameters=[*signature.parameters.values(), option])
    return verb
