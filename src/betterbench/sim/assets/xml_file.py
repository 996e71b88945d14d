"""Reader for untrusted XML files. It rejects entities and document types, and limits the file size and the nesting."""

from __future__ import annotations

from xml.etree import ElementTree as ET
from xml.parsers import expat

from betterbench.errors import InvalidInputError, one_line

MAX_XML_BYTES = 8 << 20
"""Maximum size of a URDF or MJCF file [byte]."""
MAX_ELEMENTS = 20_000
MAX_DEPTH = 100

_CURE = "Export the object again, or leave out this file"


def parse_xml(text: bytes, where: str) -> ET.Element:
    """Return the root element of an XML document.

    The parser raises an error as soon as it meets an entity or a document type, in any encoding.

    Args:
        text: The document.
        where: Name of the file, for messages.

    Raises:
        InvalidInputError: If the text is not XML, declares a document type or entities, or exceeds a limit.
    """
    if len(text) > MAX_XML_BYTES:
        raise InvalidInputError(where, f"it has more than {MAX_XML_BYTES >> 20} MB", "Store meshes in separate files")
    builder = ET.TreeBuilder()
    parser = expat.ParserCreate(namespace_separator=None)
    parser.buffer_text = True
    depth = count = 0

    def refuse(*_: object) -> None:
        raise InvalidInputError(where, "it declares a document type or entities", "Remove the DOCTYPE")

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > MAX_DEPTH or count > MAX_ELEMENTS:
            limit = f"more than {MAX_ELEMENTS:,} elements, or elements nested deeper than {MAX_DEPTH}"
            raise InvalidInputError(where, f"it has {limit}", _CURE)
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    parser.ExternalEntityRefHandler = parser.UnparsedEntityDeclHandler = refuse  # type: ignore[assignment]
    try:
        parser.Parse(text, True)
        return builder.close()
    except (expat.ExpatError, AssertionError, ValueError, LookupError) as error:
        raise InvalidInputError(where, f"it is not XML ({one_line(error, most=120)})", _CURE) from error
