"""Messages that a live view sends to a browser."""

import json

import umsgpack


def sent(stream):
    """Yield the messages of a stream in their order: commands and notes."""
    while stream:
        size = int.from_bytes(stream[:4], "big")
        message = stream[4 : 4 + size]
        stream = stream[4 + size :]
        note = message.startswith(b"{")
        yield json.loads(message) if note else umsgpack.unpackb(message)


def parted(stream):
    """Return the commands of a stream by type and path, and its notes."""
    messages = list(sent(stream))
    commands = {(part["type"], part["path"]): part for part in messages if "type" in part}
    return commands, [part for part in messages if "type" not in part]
