"""Conversion of labels to and from JSON, for the files that the diagnosis writes."""

from typing import Annotated

from pydantic import PlainValidator

from betterbench.errors import UnknownNameError
from betterbench.tasks.labels import Label


def _label(name: object) -> Label:
    try:
        return Label(str(name))
    except UnknownNameError as error:
        raise ValueError(str(error).rstrip(".")) from error


LabelField = Annotated[Label, PlainValidator(_label)]
"""Outcome label that is stored by its name."""
