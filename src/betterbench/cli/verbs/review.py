"""``better review``: review imported objects and scenes in the browser, and apply the reviews."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from betterbench.cli.console import OUT, print_json, print_table, say
from betterbench.cli.person import end_process, person_named
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from betterbench.review.command_page import CommandPage
    from betterbench.statistics import AgreementTable


def review_command(
    given: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="DIR_OR_FILES")] = (),
    *,
    tasks: tuple[str, ...] = (),
    author: str | None = None,
    out: Path | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Review imported meshes or scenes in the browser: correct poses, grasps and slots, accept or reject.

    The page shows one object at a time, with its visual and collision shapes, a ruler and the gripper. Pose, size,
    support plane, grasps, placement frames, mass and name can be changed; keys start a simulated drop or lift. Every
    decision is appended to the file --out, which a task file applies with imported(..., review=FILE). Running the
    command again continues where you stopped. By default, the page can only be opened on this machine. To open it on
    another machine, forward the port (ssh -L 8080:127.0.0.1:8080 MACHINE). The printed address contains the access
    token of the page.

    "better review assets --asset-dir DIR" reviews the assets of a folder. "better review scenes" shows the scenes of
    --tasks, --suite or --task-file, one condition at a time. Slots and placement frames can be moved, and a key
    certifies the scene. "better review apply FILE --out DIR" writes the reviewed tasks and assets to new files; the
    reviewed files are not changed. "better review agree A.jsonl B.jsonl" prints the agreement of two reviews, with
    Cohen's kappa.

    Example: better review meshes --author ada --out reviews.jsonl

    Args:
        given: Mesh files and folders of mesh files, by default the meshes that --task-file imports; or one of the
            words assets, scenes, apply (followed by a review file) and agree (followed by two review files).
        tasks: With scenes: tasks, or single conditions such as fast_food/L1; default: all of --suite or --task-file.
        author: Reviewer name in the file; default: the user name.
        out: File to which decisions are appended, by default reviews.jsonl, for scenes scene_reviews.jsonl; with
            apply, the folder to write.
        host: Network interface to listen on. With 0.0.0.0, other machines can open the page, but its access token is
            sent unencrypted.
        port: Port to listen on; 0 for any free port.
        overwrite: With apply: replace files that `better review` did not write.
        json: With agree: print one JSON document.
    """
    word = str(given[0]) if given else ""
    if word == "agree":
        _agree(given[1:], json=json)
        return
    if json:
        raise InvalidInputError("--json", "this option applies only to `better review agree`", "Leave out --json")
    if word == "apply":
        _apply(given[1:], out, overwrite=overwrite)
        return
    if word == "scenes":
        if given[1:]:
            problem = f"unexpected argument {given[1]}"
            raise InvalidInputError("review scenes", problem, "Pass tasks with --tasks")
        _review_scenes(tasks, author, out or Path("scene_reviews.jsonl"), host=host, port=port)
        return
    if tasks:
        problem = "the review of objects does not use tasks"
        raise InvalidInputError(
            "--tasks, --suite", problem, "To review scenes, run `better review scenes --tasks TASK`"
        )
    _review_objects(given, author, out or Path("reviews.jsonl"), host=host, port=port)


def _review_objects(given: tuple[Path, ...], author: str | None, out: Path, *, host: str, port: int) -> None:
    """Open mesh files, or the assets in the folders given with --asset-dir, for review in the browser."""
    from betterbench.browser.server import load_viser
    from betterbench.cli.verbs.evaluate import prepare_robot
    from betterbench.review.queue import folder_queue, queue_of
    from betterbench.sim.assets.importing.registration import mesh_imports

    load_viser()
    who = person_named(author, "--author")
    of_folders = given == (Path("assets"),) and not given[0].exists()
    queue = folder_queue(_asset_folders()) if of_folders else queue_of(given, mesh_imports())
    prepare_robot()
    from betterbench.review.desk import ReviewDesk
    from betterbench.review.page import ReviewPage
    from betterbench.sim.assets.importing.review import ReviewJournal

    with ReviewJournal(out) as journal:
        _serve(ReviewPage(ReviewDesk(queue, journal, who), host=host, port=port), host)
        judged = sum(journal.history(item.content).verdict is not None for item in queue)
        say(f"stopped; {judged} of {len(queue)} objects have a verdict in {out}")


def _review_scenes(tasks: Sequence[str], author: str | None, out: Path, *, host: str, port: int) -> None:
    """Open the scenes of tasks for review in the browser."""
    from betterbench.browser.server import load_viser
    from betterbench.cli.verbs.evaluate import prepare_robots_of
    from betterbench.review.scenes.queue import scene_queue
    from betterbench.tasks.authoring.registry import task_names
    from betterbench.tasks.user_files import code_of

    load_viser()
    who = person_named(author, "--author")
    queue = scene_queue(tasks or [name for name in task_names() if code_of("task", name) is not None])
    prepare_robots_of(dict.fromkeys(scene.task.name for scene in queue))
    from betterbench.review.scenes.changes import SceneJournal
    from betterbench.review.scenes.desk import SceneDesk
    from betterbench.review.scenes.page import ScenePage
    from betterbench.sim.assets.folders.manifest import manifest_of

    movable = frozenset(name for folder in _asset_folders(required=False) for name in manifest_of(folder).assets)
    with SceneJournal(out) as journal:
        desk = SceneDesk(queue, journal, who, movable=movable)
        _serve(ScenePage(desk, host=host, port=port), host)
        judged = sum(verdict is not None for verdict in desk.verdicts())
        say(f"stopped; {judged} of {len(queue)} scenes have a verdict in {out}")


def _asset_folders(*, required: bool = True) -> list[Path]:
    """Return the folders given with --asset-dir."""
    from betterbench.tasks.user_files import loaded_files

    folders = [Path(file.path).parent for file in loaded_files() if file.is_asset_folder]
    if required and not folders:
        raise InvalidInputError("review assets", "no asset folder was given", "Pass the folder with --asset-dir")
    return folders


def _serve(page: CommandPage[Any], host: str) -> None:
    """Show a page in the browser until a signal stops the command."""
    from betterbench.cli.verbs.serve import stopped_by_signal

    try:
        if not page.server.is_local:
            say(f"On {host}, the page's token is sent unencrypted. Use SSH port forwarding instead.")
        with stopped_by_signal() as stopped:
            OUT.print(f"open {page.server.url}", markup=False, soft_wrap=True)
            page.run(stopped)
    finally:
        page.server.close()
    if page.server.is_busy:
        end_process()


def _apply(files: tuple[Path, ...], out: Path | None, *, overwrite: bool) -> None:
    """Write reviewed tasks and assets to new files."""
    from betterbench.jobs.outputs import OutputFolder
    from betterbench.review.agreement import is_scene_review
    from betterbench.review.queue import apply_to_folder
    from betterbench.review.scenes.writing import reviewed_forms, write_moved_frames, write_reviewed_tasks
    from betterbench.wording import plural

    if len(files) != 1 or out is None:
        problem = "no folder is given" if len(files) == 1 else f"{len(files)} review files are given"
        raise InvalidInputError(
            "review apply", problem, "Write, for example, `better review apply reviews.jsonl --out DIR`"
        )
    (file,) = files
    if not is_scene_review(file):
        for folder in _asset_folders():
            into = out if len(_asset_folders()) == 1 else out / folder.name
            with OutputFolder(into, "review", overwrite=overwrite):
                written, rejected = apply_to_folder(file, folder, into)
            for name, reason in rejected.items():
                say(f"{name} is left out: {reason}")
            say(f"wrote {into} with {plural(len(written), 'asset')}", whole=True)
        return
    found = reviewed_forms(file)
    with OutputFolder(out, "review", overwrite=overwrite):
        paths = [*write_reviewed_tasks(found, out), *write_moved_frames(found, _asset_folders(required=False), out)]
    for name, reviewed in found.items():
        for condition, reason in reviewed.rejected.items():
            say(f"{name}/{condition} is left out: {reason}")
    for path in paths:
        say(f"wrote {path}", whole=True)
    if any(reviewed.moved for reviewed in found.values()):
        say(
            "Slots have moved. Measure the demonstrations again for the new task files: better certify "
            "--demonstrations 120"
        )


def _agree(files: tuple[Path, ...], *, json: bool) -> None:
    """Print the agreement of two reviews."""
    from betterbench.review.agreement import agreement

    if len(files) != 2:
        problem = f"{len(files)} files are given"
        raise InvalidInputError(
            "review agree", problem, "Write, for example, `better review agree ada.jsonl bob.jsonl`"
        )
    found = agreement(*files)
    if json:
        print_json(found.to_json())
        return
    first, second = (path.stem for path in files)
    for table in (found.all, found.usable):
        rows = [[name, *map(str, row)] for name, row in zip(table.categories, table.counts, strict=True)]
        print_table([f"{first} \\ {second}", *table.categories], rows)
        OUT.print(_sentence(table, found.what))
    if found.only_first or found.only_second:
        OUT.print(
            f"Not counted: {found.only_first} {found.what} judged only in {first}, and {found.only_second} judged only "
            f"in {second}."
        )
    for name, a, b in found.apart[:20]:
        OUT.print(f"{name}: {a} and {b}", markup=False)


def _sentence(table: AgreementTable, what: str) -> str:
    kappa, interval = table.kappa, table.interval()
    agree = f"Both agree on {sum(table.counts[k][k] for k in range(len(table.categories)))} of {table.n} {what}"
    if kappa is None or interval is None:
        return f"{agree}; kappa is undefined, because both reviewers gave all of them the same verdict."
    return f"{agree}; Cohen's kappa {kappa:.2f} (95 % interval {interval.low:.2f} to {interval.high:.2f})."
