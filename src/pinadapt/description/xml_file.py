"""Reading and writing XML files."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from xml.parsers.expat import ExpatError, ParserCreate, errors

from ..exceptions import RobotError

_UNBOUND = errors.codes[errors.XML_ERROR_UNBOUND_PREFIX]


def read_xml(path: Path) -> ElementTree.Element:
    """Return the root element of an XML file, without its comments.

    Raises:
        RobotError: no such file, or not well-formed XML.
    """
    if not path.is_file():
        raise RobotError("no such file.", where=str(path), hint=_neighbours(path))
    try:
        return parse_xml(path.read_bytes(), str(path))
    except OSError as error:
        raise RobotError(f"cannot be read ({error.strerror}).", where=str(path)) from error


def parse_xml(text: bytes | str, where: str) -> ElementTree.Element:
    """Return the root element of an XML document, without its comments.

    The parser gets the document in one piece: in several, expat takes a time that is quadratic in
    the length of a comment.

    Raises:
        RobotError: not well-formed XML.
    """
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        if error.code != _UNBOUND:
            raise _malformed(error, where) from error
    except (ValueError, LookupError) as error:
        raise _malformed(error, where) from error
    try:
        return _without_namespaces(text)
    except ExpatError as error:
        raise _malformed(error, where) from error


def _malformed(error: Exception, where: str) -> RobotError:
    return RobotError(f"not well-formed XML ({error}).", where=where)


def _without_namespaces(text: bytes | str) -> ElementTree.Element:
    """Return the root element of a document that uses undeclared namespace prefixes.

    As in other URDF parsers, a prefix is part of the name.
    """
    builder, parser = ElementTree.TreeBuilder(), ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.data
    parser.Parse(text, True)
    return builder.close()


def xml_text(root: ElementTree.Element, where: str) -> str:
    """Return an XML document as text.

    Raises:
        RobotError: its elements are nested too deeply.
    """
    try:
        return ElementTree.tostring(root, encoding="unicode")
    except RecursionError as error:
        raise RobotError("its elements are nested too deeply.", where=where) from error


def _neighbours(path: Path) -> str | None:
    """Return which URDF and xacro files are in the folder of a missing one, or None."""
    if not path.parent.is_dir():
        return None
    near = sorted(str(other) for end in ("urdf", "xacro") for other in path.parent.glob(f"*.{end}"))
    return f"Robot files in that folder: {near}." if near else None
