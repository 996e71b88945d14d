"""``better review``: human review of imported meshes in the browser, and the agreement between two reviewers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from betterbench.cli.console import OUT, print_json, print_table, say
from betterbench.cli.person import end_process, person_named
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.statistics import AgreementTable


def review_command(
    given: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="DIR_OR_FILES")] = (),
    *,
    author: str | None = None,
    out: Path = Path("reviews.jsonl"),
    host: str = "127.0.0.1",
    port: int = 8080,
    json: bool = False,
) -> None:
    """Review imported meshes in the browser: correct pose and grasps, accept or reject.

    The page shows one object at a time, with its visual and collision shapes, a ruler and the gripper. Pose,
    size, support plane, grasps, placement frames, mass and name can be changed; keys start a simulated drop or lift.
    Every decision is appended to the file of --out, which imported(..., review=FILE) in a task file applies. The same
    command resumes where it was stopped. The command listens on this machine only: from elsewhere, forward the port
    (ssh -L 8080:127.0.0.1:8080 MACHINE). The printed address contains a token that every request needs.

    "better review agree A.jsonl B.jsonl" prints the agreement of two reviews, with Cohen's kappa.

    Example: better review meshes --author ada --out reviews.jsonl

    Args:
        given: Mesh files and folders of mesh files, by default the meshes that --task-file imports; or agree and two
            review files.
        author: Reviewer name in the file; the user's name if not given.
        out: File to which decisions are appended.
        host: Interface to listen on; on 0.0.0.0 the token of the address is sent unencrypted.
        port: Port to listen on; 0 for any free one.
        json: With agree: print one JSON document.
    """
    if given and str(given[0]) == "agree":
        _agree(given[1:], json=json)
        return
    if json:
        raise InvalidInputError("--json", "it is for better review agree", "Leave it out")
    from betterbench.browser.server import load_viser
    from betterbench.cli.verbs.evaluate import prepare_robot
    from betterbench.cli.verbs.serve import stopped_by_signal
    from betterbench.review.queue import queue_of
    from betterbench.sim.assets.importing.registration import mesh_imports

    load_viser()
    who = person_named(author, "--author")
    queue = queue_of(given, mesh_imports())
    prepare_robot("panda")
    from betterbench.review.desk import ReviewDesk
    from betterbench.review.page import ReviewPage
    from betterbench.sim.assets.importing.review import ReviewJournal

    with ReviewJournal(out) as journal:
        page = ReviewPage(ReviewDesk(queue, journal, who), host=host, port=port)
        try:
            if not page.server.is_local:
                say(f"On {host} the token of the page is sent unencrypted; forward the port by ssh instead.")
            with stopped_by_signal() as stopped:
                OUT.print(f"open {page.server.url}", markup=False, soft_wrap=True)
                page.run(stopped)
            judged = sum(journal.history(item.content).verdict is not None for item in queue)
            say(f"stopped; {judged} of {len(queue)} objects have a verdict in {out}")
        finally:
            page.server.close()
    if page.server.is_busy:
        end_process()


def _agree(files: tuple[Path, ...], *, json: bool) -> None:
    """Print the agreement of two reviews."""
    from betterbench.review.agreement import agreement

    if len(files) != 2:
        problem = f"{len(files)} files are given"
        raise InvalidInputError("review agree", problem, "Give two files: better review agree ada.jsonl bob.jsonl")
    found = agreement(*files)
    if json:
        print_json(found.to_json())
        return
    first, second = (path.stem for path in files)
    for table in (found.all, found.usable):
        rows = [[name, *map(str, row)] for name, row in zip(table.categories, table.counts, strict=True)]
        print_table([f"{first} \\ {second}", *table.categories], rows)
        OUT.print(_sentence(table))
    if found.only_first or found.only_second:
        OUT.print(f"Not counted: {found.only_first} objects judged in {first} alone, {found.only_second} in {second}.")
    for name, a, b in found.apart[:20]:
        OUT.print(f"{name}: {a} and {b}", markup=False)


def _sentence(table: AgreementTable) -> str:
    kappa, interval = table.kappa, table.interval()
    agree = f"Both agree on {sum(table.counts[k][k] for k in range(len(table.categories)))} of {table.n} objects"
    if kappa is None or interval is None:
        return f"{agree}; kappa is not defined, since both gave every object the same verdict."
    return f"{agree}; Cohen's kappa {kappa:.2f} (95 % interval {interval.low:.2f} to {interval.high:.2f})."
