"""PNG or JPEG file that a subcommand writes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.cli.console import say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from PIL import Image


@contextmanager
def picture_file(out: Path, verb: str, *, overwrite: bool) -> Iterator[Callable[[Image.Image, Sequence[str]], None]]:
    """Check and lock the output path, and yield a function that writes an image.

    The yielded function also stores the remarks passed to it in the file header.

    Raises:
        InvalidInputError: If the file name does not end with .png, .jpg or .jpeg.
        RunConflictError: If the file exists and must not be replaced, or another process is writing it.
    """
    if out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise InvalidInputError(
            "--out", f"{out} ends with {out.suffix!r}", "Choose a file name that ends with .png or .jpg"
        )

    from betterbench.evaluation.figures.show import image_file
    from betterbench.jobs import write_durably
    from betterbench.jobs.outputs import OutputFile, mark_of

    def write(image: Image.Image, remarks: Sequence[str]) -> None:
        write_durably(out, image_file(image, out.suffix, remark="\n".join([mark_of(verb), *remarks])))
        say(f"wrote {out}", whole=True)

    with OutputFile(out, verb, overwrite=overwrite):
        yield write
