"""The ``better`` command line: a table of subcommands. Only the module of the chosen subcommand is imported."""

from __future__ import annotations

import importlib
import inspect
import itertools
import logging
import os
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_type_hints

import tyro

from betterbench.cli import EXIT_INTERRUPTED, begin_collecting, was_interrupted
from betterbench.cli.border import guarded, in_other_world
from betterbench.cli.console import LONGEST_MESSAGE, complain, make_streams_patient, say
from betterbench.cli.help_text import brief_usage, color_as_asked, description_of, word_options
from betterbench.errors import (
    BetterError,
    InvalidInputError,
    MissingDependencyError,
    UnknownNameError,
    line_start,
    printable,
    system_error_text,
)
from betterbench.installation import as_started_here, better_command, calibration_module

LogLevel = Literal["debug", "info", "warning", "error"]
_CALIBRATION = "betterbench_calibration."
LOG_LEVEL_VARIABLE = "BETTERBENCH_LOG_LEVEL"
"""Environment variable that carries the level of the log to worker processes (read by ``prepare_process``)."""


@dataclass(slots=True)
class Telling:
    """Logging options given on the command line: the log level, and whether errors are printed with a traceback."""

    traceback: bool = False

    def begin(self, level: LogLevel, *, with_traceback: bool) -> None:
        """Set the log level of this process and of the worker processes it starts."""
        os.environ[LOG_LEVEL_VARIABLE] = level.upper()
        logging.getLogger("betterbench").setLevel(level.upper())
        self.traceback = with_traceback


@dataclass(frozen=True, slots=True)
class Verb:
    """A subcommand of the command line.

    Attributes:
        function: Location of the function: "module:name" in the package of subcommands, or the full name if the
            function belongs to the package betterbench-calibration.
        takes_tasks: Whether the subcommand accepts ``--task-file`` and ``--asset-dir``.
        takes_suite: Whether the subcommand also accepts ``--suite``. If ``--tasks`` is not given, such a subcommand
            works on the tasks of the suite.
        takes_run_file: Whether the options may be given in a run file.
        commands: Nested commands, each with its own options, such as "import" in ``better assets import``. If there are
            nested commands, the function of the subcommand only provides the overview in the help.
    """

    function: str
    summary: str
    takes_tasks: bool = True
    takes_run_file: bool = False
    takes_suite: bool = False
    commands: Mapping[str, Verb] = field(default_factory=dict)

    def load(self, telling: Telling) -> Callable[..., None]:
        """Import the function of the subcommand, and add the options that all subcommands have."""
        module, _, name = self.function.partition(":")
        if module.startswith(_CALIBRATION):
            problem = "This subcommand is part of betterbench-calibration, which is not installed"
            home = calibration_module(module.removeprefix(_CALIBRATION), problem)
        else:
            home = importlib.import_module(f"betterbench.cli.verbs.{module}")
        function: Callable[..., None] = getattr(home, name)
        if self.takes_suite:
            function = _with_suite(function)
        if self.takes_run_file:
            function = _with_run_file(function)
        return _with_log_options(guarded(_with_task_files(function) if self.takes_tasks else function), telling)

    def words(self, given: Sequence[str]) -> list[str]:
        """Return the command-line arguments, with ``--run-file FILE`` replaced by the options in the file."""
        if not self.takes_run_file:
            return list(given)
        from betterbench.cli.run_file import with_run_file

        return with_run_file(given)


VERBS: dict[str, Verb] = {
    "doctor": Verb("doctor:doctor_command", "Check what works on this machine, or try a policy."),
    "list": Verb("listing:list_command", "List suites, tasks, variations, policies or assets.", takes_suite=True),
    "assets": Verb(
        "assets:assets_command",
        "Index, search and show assets, and list their licenses.",
        commands={
            "index": Verb("asset_index:index_command", "Add asset sources to the catalogue."),
            "search": Verb("asset_search:search_command", "Find assets by description."),
            "show": Verb("asset_show:show_asset_command", "Print one asset."),
            "licenses": Verb("asset_licenses:licenses_command", "Count licenses by source."),
            "import": Verb("asset_import:import_command", "Import files as assets."),
            "check": Verb("asset_check:check_command", "Certify assets."),
        },
    ),
    "review": Verb("review:review_command", "Review imported meshes and scenes in the browser.", takes_suite=True),
    "real": Verb(
        "real:real_command",
        "Run the diagnostic protocol on a real robot arm.",
        commands={
            "sheet": Verb("real_sheet:sheet_command", "Write the marker sheet for printing.", takes_tasks=False),
            "check-cameras": Verb(
                "real_check_cameras:check_cameras_command", "Measure the front camera's pose.", takes_tasks=False
            ),
            "plan": Verb("real_plan:plan_command", "Plan randomized trials on a real arm.", takes_tasks=False),
            "run": Verb("real_run:run_command", "Run planned trials on a real arm.", takes_tasks=False),
            "status": Verb("real_status:status_command", "Show the progress of a protocol.", takes_tasks=False),
            "judge": Verb("real_judge:judge_command", "Judge the videos of a protocol blind.", takes_tasks=False),
            "report": Verb("real_report:report_command", "Write the report on a protocol.", takes_tasks=False),
        },
    ),
    "worlds": Verb("worlds:worlds_command", "List the worlds, or install one.", takes_tasks=False),
    "premise": Verb("premise:premise_command", "Check LIBERO's scenes against their instructions.", takes_tasks=False),
    "import-better": Verb("import_better:import_better_command", "Import and audit tasks of the BeTTER release."),
    "show": Verb("show:show_command", "Draw a training scene beside a test scene.", takes_suite=True),
    "generate": Verb("generate:generate_command", "Write scenarios for a template or a sentence."),
    "build": Verb("build:build_command", "Build certified tasks from scenarios."),
    "place": Verb("place:place_command", "Adapt tasks to another robot and measure its reach."),
    "certify": Verb("certify:certify_command", "Certify that trials can be solved with trained motions."),
    "calibrate": Verb(
        "calibrate:calibrate_command", "Measure the diagnosis on policies with a known fault.", takes_suite=True
    ),
    "eval": Verb("evaluate:evaluate_command", "Evaluate a policy, or resume or repeat a run.", takes_run_file=True),
    "collect": Verb("collect:collect_command", "Collect varied expert demonstrations."),
    "teleop": Verb(
        "teleop:teleop_command", "Demonstrate in the browser by gizmo, keys or leader arm.", takes_suite=True
    ),
    "amplify": Verb("amplify:amplify_command", "Generate demonstrations for new initial states.", takes_suite=True),
    "dataset": Verb("dataset:dataset_command", "Make a training set with its dataset card and audit."),
    "train": Verb("train:train_command", "Train a small policy on demonstrations.", takes_suite=True),
    "study": Verb("study:study_command", "Train learners on several data sets, and compare them."),
    "shortcuts": Verb(
        "shortcuts:shortcuts_command", "Find shortcuts that a learner could exploit in a dataset.", takes_suite=True
    ),
    "diagnose": Verb(
        "diagnose:diagnose_command", "Explain why each trial of a run succeeded or failed.", takes_suite=True
    ),
    "compare": Verb(
        "compare:compare_command", "Compare policies on the trials that their runs share.", takes_suite=True
    ),
    "report": Verb("report:report_command", "Write a page with tables, figures and videos of runs.", takes_suite=True),
    "export": Verb("export:export_command", "Export a run's outcomes or a training data set.", takes_suite=True),
    "recipe": Verb("recipe:recipe_command", "Write configs for openpi, GR00T, Being-H or LeRobot.", takes_tasks=False),
    "mixture": Verb(
        "betterbench_calibration.cli.mixture:mixture_command",
        "Show a mixture of training data and sample from it.",
        takes_tasks=False,
    ),
    "materialize": Verb(
        "materialize:materialize_command", "Write depth, masks and boxes of recorded states.", takes_suite=True
    ),
    "view": Verb("view:view_command", "Show a trial, its masks, boxes and subgoals over time.", takes_suite=True),
    "vqa": Verb("vqa:vqa_command", "Make questions about recorded frames from the records."),
    "vlm": Verb("vlm:vlm_command", "Evaluate a vision-language model on static benchmarks.", takes_tasks=False),
    "replay": Verb("replay:replay_command", "Replay a record to check it, or write its video.", takes_suite=True),
    "serve": Verb("serve:serve_command", "Serve a policy behind the openpi protocol.", takes_suite=True),
    "demo": Verb("demo:demo_command", "Evaluate four policies on two tasks and write a report.", takes_tasks=False),
    "audit-paper": Verb(
        "betterbench_calibration.cli.audit_paper:audit_command",
        "Check the printed numbers of the paper's tables.",
        takes_tasks=False,
    ),
}
RESUMING = frozenset(
    ("eval", "certify", "calibrate", "collect", "teleop", "amplify", "dataset", "export", "mixture", "materialize")
) | {"vqa", "vlm", "demo", "train", "study", "assets", "review", "generate", "build", "real"}
"""Subcommands that resume an interrupted job when the same command is given again."""

EXIT_BAD_INPUT = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand and return the exit status: 0, 2 if the input was wrong, or 130 after Ctrl-C."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    os.environ.setdefault("LP_NUM_THREADS", "0")
    make_streams_patient()
    logging.basicConfig(handlers=[_log_handler()])
    given = list(sys.argv[1:] if arguments is None else arguments)
    telling = Telling()
    color_as_asked()
    try:
        if given and given[0] in VERBS:
            _require_out(given)
            name, verb, rest = _chosen(given)
            function = verb.load(telling)
            words = [_at_home(word) for word in verb.words(rest)]
            tyro.cli(function, prog=f"better {name}", description=description_of(function), args=words)
        elif given and not given[0].startswith("-"):
            raise UnknownNameError("verb", given[0], VERBS)  # noqa: TRY301
        else:
            _show_overview(given)
    except BetterError as error:
        if telling.traceback:
            traceback.print_exc()
        # Ctrl-C may have ended a child process, which causes this error.
        if was_interrupted():
            return _interrupted(given)
        complain(str(in_other_world(error)))
        return EXIT_BAD_INPUT
    except OSError as problem:
        # Any error of the operating system, for example for a path that is missing, too long or not writable.
        if isinstance(problem, BrokenPipeError):
            sys.stderr.close()
            return 0
        complain(system_error_text(problem))
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        return _interrupted(given)
    except Exception:
        if not was_interrupted():
            raise
        return _interrupted(given)  # native code raised this error because of Ctrl-C
    return 0


def _require_out(given: Sequence[str]) -> None:
    """Raise InvalidInputError if --out has an empty value. Without this check, it would mean the current folder."""
    if "--out=" in given or any(pair == ("--out", "") for pair in itertools.pairwise(given)):
        raise InvalidInputError(
            "--out",
            "the folder name is empty",
            "Pass the name of a folder, and check that every shell variable in it is set",
        )


def _at_home(word: str) -> str:
    """Replace "~" by the home folder where the shell does not, as in ``--out=~/runs`` or in a run file."""
    option, _, path = word.partition("=") if word.startswith("--") else ("", "", word)
    if not path.startswith("~/"):
        return word
    path = str(Path(path).expanduser())
    return f"{option}={path}" if option else path


def every_command() -> dict[str, Verb]:
    """Return all subcommands by name. The name of a nested command has two words ("assets import")."""
    found = dict(VERBS)
    for name, verb in VERBS.items():
        found |= {f"{name} {command}": each for command, each in verb.commands.items()}
    return found


def _chosen(given: Sequence[str]) -> tuple[str, Verb, list[str]]:
    """Return the name of the chosen subcommand, its :class:`Verb`, and the remaining arguments.

    Options may precede the name of a nested command.
    """
    verb, rest = VERBS[given[0]], list(given[1:])
    if not verb.commands or not rest:
        return given[0], verb, rest
    place = 0
    if rest[0].startswith("-"):
        place = next((place for place, word in enumerate(rest) if word in verb.commands), -1)
        if place < 0:
            return given[0], verb, rest
    if rest[place] not in verb.commands:
        raise UnknownNameError(f"command of better {given[0]}", rest[place], verb.commands)
    return f"{given[0]} {rest[place]}", verb.commands[rest[place]], [*rest[:place], *rest[place + 1 :]]


def _interrupted(given: Sequence[str]) -> int:
    """Report the interrupt and how to resume, and return the exit status."""
    more = "; run the same command again to continue where it stopped"
    say(f"interrupted{more if given and given[0] in RESUMING else ''}")
    return EXIT_INTERRUPTED


def _log_handler() -> logging.Handler:
    """Return the handler that writes log messages to standard error, without control characters."""

    class Printable(logging.Formatter):
        def format(self, record: logging.LogRecord) -> str:
            text = printable(super().format(record), most=LONGEST_MESSAGE)
            return line_start(sys.stderr) + as_started_here(text)

    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(Printable("%(message)s"))
    return handler


def _show_overview(given: Sequence[str]) -> None:
    """Print the overview, an error for a missing subcommand, or a shell completion script, and exit."""
    command = better_command()
    here = "" if command == "better" else f"\n\nHere, better is started as {command}."
    # A completion script needs the options of every subcommand.
    completion = any(word.startswith("--tyro-") for word in given)
    with brief_usage(VERBS):
        tyro.extras.subcommand_cli_from_dict(
            {name: _listed(verb, with_options=completion) for name, verb in VERBS.items()},
            prog="better",
            description="Find out why a vision-language-action policy fails.\n\n"
            f"better COMMAND --help explains a command, better --version prints the version.{here}",
            args=list(given),
        )


def _listed(verb: Verb, *, with_options: bool) -> Callable[..., None]:
    """Return the function that represents a subcommand in the overview.

    If ``with_options`` is set and the package of the subcommand is installed, return the subcommand itself. Otherwise,
    return an empty function with the summary of the subcommand as its docstring.
    """
    if with_options:
        with suppress(MissingDependencyError):
            return verb.load(Telling())

    def stand_in() -> None: ...

    stand_in.__doc__ = verb.summary
    return stand_in


def _with_log_options(function: Callable[..., None], telling: Telling) -> Callable[..., None]:
    """Wrap a subcommand so that it also takes ``--log-level`` and ``--traceback``."""

    def verb(*args: object, log_level: LogLevel = "warning", traceback: bool = False, **options: object) -> None:
        begin_collecting()
        telling.begin(log_level, with_traceback=traceback)
        function(*args, **options)

    _with_options(
        verb,
        function,
        log_level="Minimum level of the log messages on standard error, also for worker processes.",
        traceback="If an error occurs, also print its traceback.",
    )
    word_options(verb)
    return verb


def _with_task_files(function: Callable[..., None]) -> Callable[..., None]:
    """Wrap a subcommand so that it also takes ``--task-file`` and ``--asset-dir``, and loads both before it starts."""

    def verb(
        *args: object,
        task_file: tyro.conf.UseAppendAction[tuple[Path, ...]] = (),
        asset_dir: tyro.conf.UseAppendAction[tuple[Path, ...]] = (),
        **options: object,
    ) -> None:
        from betterbench.tasks.user_files import load_asset_folders, load_task_files

        load_asset_folders(asset_dir)
        load_task_files(task_file)
        function(*args, **options)

    return _with_options(
        verb,
        function,
        task_file="Python file that defines your own tasks, assets or learners; may be given several times.",
        asset_dir="Asset folder written by `better assets import`; may be given several times.",
    )


def _with_suite(function: Callable[..., None]) -> Callable[..., None]:
    """Wrap a subcommand so that it also takes ``--suite``, and uses the suite's tasks if ``--tasks`` is not given."""
    takes_names = "tasks" in inspect.signature(function).parameters

    def verb(*args: object, suite: str | None = None, **options: object) -> None:
        if suite is not None:
            from betterbench.tasks import suite_tasks

            of_suite = suite_tasks(suite)
            if takes_names and not options.get("tasks"):
                options["tasks"] = of_suite
        function(*args, **options)

    use = "the suite's tasks are used if --tasks is not given" if takes_names else "the suite's tasks are loaded"
    text = f"Name of a packaged suite, or folder with a suite in JSON; {use}."
    return _with_options(verb, function, suite=text)


def _with_run_file(function: Callable[..., None]) -> Callable[..., None]:
    """Wrap a subcommand so that its help lists ``--run-file``.

    When the wrapper is called, :meth:`Verb.words` has already replaced ``--run-file`` with the options in the file.
    """

    def verb(*args: object, run_file: Path | None = None, **options: object) -> None:
        del run_file
        function(*args, **options)

    return _with_options(
        verb,
        function,
        run_file="YAML file with these options; options on the command line take precedence.",
    )


def _with_options(verb: Callable[..., None], function: Callable[..., None], **texts: str) -> Callable[..., None]:
    """Copy the options, type hints and help texts of a subcommand to its wrapper, which adds more options.

    Args:
        verb: Wrapper that has additional options.
        function: Wrapped subcommand.
        texts: Help text of each added option, by option name.
    """
    added = inspect.signature(verb).parameters
    hints: dict[str, Any] = get_type_hints(function, include_extras=True)
    signature = inspect.signature(function)
    lines = [inspect.cleandoc(function.__doc__ or ""), *(f"    {name}: {text}" for name, text in texts.items())]
    verb.__doc__ = "\n".join(lines)
    verb.__annotations__ = {**hints, **{name: get_type_hints(verb, include_extras=True)[name] for name in texts}}
    parameters = [*signature.parameters.values(), *(added[name] for name in texts)]
    vars(verb)["__signature__"] = signature.replace(parameters=parameters)
    return verb
